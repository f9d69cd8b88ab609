"""Synthesises the programs that the experiments race, with the command that a user would give.

    python -m benchmarks.torcs.synthesise [--sketch paper racer noif] [--track g-track-1 aalborg]
                                          [--seed 0 1 2] [--label WORD] [--runs DIR]
                                          [-- OPTIONS OF pirlc synth]

Each is `pirlc synth examples/torcs/SKETCH.pirl --argument track=TRACK --seed N -o DIR/...`. What is
finished is not run again, and what was interrupted goes on. The program goes to
examples/torcs/synthesised/SKETCH-TRACK-SEED.pirl, and a line about the run to runs.jsonl beside it.
With a label, SKETCH-TRACK-LABEL-SEED: programs that were made with options of their own.
"""

from __future__ import annotations

import argparse
import json
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks.torcs import paper
from benchmarks.torcs.drivers import EXAMPLES, ROOT, SKETCHES, SYNTHESISED, nodes_of, read_program
from pirlc.backend.files import write_text
from pirlc.search.synthesis import Ending

RUNS = ROOT / "runs" / "torcs"
LINES = "runs.jsonl"
FINISHED = (Ending.FINISHED.value, Ending.BUDGET.value)
"""Endings of a search that leave nothing to go on with."""


def command(sketch: Path, track: str, seed: int, run: Path, options: list[str]) -> list[str]:
    """The words of the command line, after `pirlc`."""
    given = ["--argument", f"track={track}", "--seed", str(seed), "-o", str(run)]
    return ["synth", str(sketch), *given, *options]


def manifest_of(run: Path) -> dict[str, Any] | None:
    """What is known of a run; None if it is not finished."""
    try:
        manifest: dict[str, Any] = json.loads((run / "manifest.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    return manifest if manifest.get("state") in FINISHED else None


def synthesise(asked: list[str], run: Path) -> dict[str, Any]:
    """Runs the command unless it is finished: what it took, in s. Raises SystemExit if it fails."""
    if manifest_of(run) is not None:
        return {}
    resumed = run.exists()
    start, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, "-m", "pirlc", *asked], cwd=ROOT, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != 0 or manifest_of(run) is None:
        raise SystemExit(f"pirlc {' '.join(asked)}\nended with {done.returncode}")
    cores = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {
        "wall_seconds": round(time.perf_counter() - start, 1),
        "core_seconds": round(cores, 1),
        "resumed": resumed,
    }


def program_of(run: Path) -> Path:
    """The program that a run has left."""
    return next(path for path in sorted(run.glob("*.pirl")) if path.name != "sketch.pirl")


def line_of(name: str, run: Path, took: dict[str, Any]) -> dict[str, Any]:
    """What is told about a run."""
    manifest = manifest_of(run)
    assert manifest is not None
    oracle, returns = manifest["oracle"], manifest["evaluation"]["returns"]
    return {
        "name": name,
        "state": manifest["state"],
        "search_seconds": manifest["seconds_of_search"],
        "calls": manifest["calls_of_search"],
        **took,
        "nodes": nodes_of(read_program(program_of(run))),
        "oracle": oracle
        and {
            "algorithm": oracle["algorithm"],
            "seed": oracle["seed"],
            "environment": oracle["environment"],
            "weights_sha256": oracle["weights_sha256"],
        },
        "returns": {subject: found["mean"] for subject, found in returns.items()},
    }


def record(line: dict[str, Any], folder: Path) -> None:
    """Puts a line in the place of the one with its name. Of a run that was not run, the times that
    are known stay."""
    path = folder / LINES
    known: dict[str, dict[str, Any]] = {}
    if path.exists():
        for text in path.read_text(encoding="utf-8").splitlines():
            other = json.loads(text)
            known[other["name"]] = other
    name = line["name"]
    if "wall_seconds" not in line and name in known:
        times = ("wall_seconds", "core_seconds", "resumed")
        line = {**line, **{key: known[name][key] for key in times if key in known[name]}}
    known[name] = line
    text = "".join(json.dumps(known[key], sort_keys=True) + "\n" for key in sorted(known))
    write_text(path, text)


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.torcs.synthesise",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--sketch", nargs="+", default=list(SKETCHES), choices=SKETCHES)
    parser.add_argument("--track", nargs="+", default=list(paper.TRAINING), choices=paper.TRAINING)
    parser.add_argument("--seed", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--label", default="", help="in the names, where options are given")
    parser.add_argument("--runs", type=Path, default=RUNS, help="folder of the runs")
    parser.add_argument("--sketches", type=Path, default=EXAMPLES, help="folder of the sketches")
    parser.add_argument("--output", type=Path, default=SYNTHESISED, help="folder of the programs")
    parser.add_argument("options", nargs="*", help="given to pirlc synth")
    chosen = parser.parse_args(words)
    chosen.output.mkdir(parents=True, exist_ok=True)
    for seed in chosen.seed:
        for track in chosen.track:
            for sketch in chosen.sketch:
                name = "-".join(filter(None, (sketch, track, chosen.label, str(seed))))
                run = (chosen.runs / name).resolve()
                file = chosen.sketches.resolve() / f"{sketch}.pirl"
                shown = file.relative_to(ROOT) if file.is_relative_to(ROOT) else file
                print(f"== {name}", flush=True)
                took = synthesise(command(shown, track, seed, run, chosen.options), run)
                shutil.copyfile(program_of(run), chosen.output / f"{name}.pirl")
                record(line_of(name, run, took), chosen.output)


if __name__ == "__main__":
    main()
