"""Returns, sizes and times of `pirlc synth` on the four classic-control examples.

    python -m benchmarks.classic [--seeds 0 1 2] [--examples cartpole ...] [--folder runs/classic]

Each row is a whole run of the command: the oracle is trained (or found in the cache), the search
runs, the result is evaluated on 1,000 unseen episodes. Finished runs are only read again.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

EXAMPLES = ("cartpole", "mountain_car", "acrobot", "pendulum")


def synthesize(example: str, seed: int, folder: Path) -> dict[str, Any]:
    """The manifest of a run, which is made if it is not there yet."""
    run = folder / f"{example}-{seed}"
    sketch = f"examples/{example}/{example}.pirl"
    command = [sys.executable, "-m", "pirlc", "synth", sketch, "-o", str(run), "--seed", str(seed)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    manifest: dict[str, Any] = json.loads((run / "manifest.json").read_text(encoding="utf-8"))
    return manifest


def cell(manifest: dict[str, Any], name: str) -> str:
    found = manifest["evaluation"]["returns"].get(name)
    return f"{found['mean']:.2f} ± {found['high'] - found['mean']:.2f}" if found else "-"


def row(example: str, seed: int, manifest: dict[str, Any]) -> str:
    cells = [
        example,
        str(seed),
        cell(manifest, "program"),
        cell(manifest, "emitted C"),
        cell(manifest, "without refinement"),
        str(manifest["imitated"]["size"]),
        cell(manifest, "oracle"),
        str(manifest["program"]["size"]),
        f"{manifest['seconds_of_search']:.0f}",
    ]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--examples", nargs="+", default=list(EXAMPLES), choices=EXAMPLES)
    parser.add_argument("--folder", type=Path, default=Path("runs/classic"))
    chosen = parser.parse_args()
    print(
        "| example | seed | program | emitted C | without refinement | its nodes | oracle "
        "| nodes | search, s |"
    )
    print("|---" * 9 + "|")
    for example in chosen.examples:
        for seed in chosen.seeds:
            print(row(example, seed, synthesize(example, seed, chosen.folder)), flush=True)


if __name__ == "__main__":
    main()
