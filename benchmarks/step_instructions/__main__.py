"""Instructions a step: emitted C beside C that was written by hand for the same law.

    python -m benchmarks.step_instructions [--steps N]

Both are compiled with the flags that emitted headers name, fed the same readings (a few of them
missing or outside their ranges), must give the same answers, and are counted by callgrind inside
their step functions alone. The bar is a ratio of 1.1.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from pirlc.backend.emit import emit, write
from pirlc.backend.toolchain import FLAGS
from pirlc.frontend import parse_sketch
from pirlc.ir.expansion import close
from pirlc.source import SourceText

FOLDER = Path(__file__).parent
BAR = 1.1


@dataclass(frozen=True)
class Law:
    """A program and its hand-written twin; `ranges` are those of the readings it is fed."""

    name: str
    sensors: tuple[str, ...]
    action: str
    ranges: tuple[tuple[float, float], ...]


LAWS = (
    # TrackPos stays near the guard's edges, so that both sides are taken.
    Law("switched_pid", ("TrackPos", "RPM"), "Accel", ((-0.002, 0.002), (0.0, 1.0))),
    Law(
        "linear_guard",
        ("position", "velocity", "angle", "angular_velocity"),
        "push",
        ((-4.8, 4.8), (-10.0, 10.0), (-0.418, 0.418), (-10.0, 10.0)),
    ),
)


def main() -> int:
    arguments = argparse.ArgumentParser(prog="python -m benchmarks.step_instructions")
    arguments.add_argument("--steps", type=int, default=20_000)
    arguments.add_argument("--compiler", default="gcc")
    options = arguments.parse_args()
    for tool in (options.compiler, "valgrind"):
        if shutil.which(tool) is None:
            print(f"needs {tool}", file=sys.stderr)
            return 2
    print(f"{'law':<14}{'by hand':>10}{'emitted':>10}{'ratio':>8}   instructions a step")
    worst = 0.0
    with tempfile.TemporaryDirectory() as place:
        for law in LAWS:
            hand, emitted = (
                instructions(law, source, prefix, options.compiler, options.steps, Path(place))
                for source, prefix in (
                    (FOLDER / "hand" / f"{law.name}.c", "hand"),
                    (emitted_source(law, Path(place)), law.name),
                )
            )
            if hand[1] != emitted[1]:
                print(f"{law.name}: the two give different answers", file=sys.stderr)
                return 1
            ratio = emitted[0] / hand[0]
            worst = max(worst, ratio)
            print(f"{law.name:<14}{hand[0]:>10.1f}{emitted[0]:>10.1f}{ratio:>8.3f}")
    print(f"bar: {BAR}; {'met' if worst <= BAR else 'missed'}")
    return 0 if worst <= BAR else 1


def emitted_source(law: Law, folder: Path) -> Path:
    text = (FOLDER / f"{law.name}.pirl").read_text(encoding="utf-8")
    program = close(parse_sketch(SourceText(f"{law.name}.pirl", text)))
    assert program is not None
    paths = write(emit(program, ["c"]), folder)
    return next(path for path in paths if path.suffix == ".c")


def instructions(
    law: Law, source: Path, prefix: str, compiler: str, steps: int, folder: Path
) -> tuple[float, str]:
    """Instructions a step inside the step function, and the digest of all answers."""
    built = folder / f"{prefix}-{law.name}"
    reads = " ".join(f"(in).{sensor} = (readings)[k++];" for sensor in law.sensors)
    ranges = ", ".join(f"{{{low!r}, {high!r}}}" for low, high in law.ranges)
    objects = []
    for part, extra in (
        (source, []),
        (
            FOLDER / "driver.c",
            [
                f'-DHEADER="{source.stem}.h"',
                f"-DNAME(x)={prefix}_##x",
                f"-DREAD(in, readings)={reads}",
                f"-DACTION={law.action}",
                f"-DRANGES={{{ranges}}}",
                f"-I{source.parent}",
            ],
        ),
    ):
        objects.append(f"{built}-{part.stem}.o")
        run([compiler, *FLAGS, *extra, "-c", str(part), "-o", objects[-1]])
    run([compiler, "-o", str(built), *objects, "-lm"])
    answer = run(
        [
            "valgrind",
            "--tool=callgrind",
            f"--toggle-collect={prefix}_step",
            "--callgrind-out-file=/dev/null",
            str(built),
            str(steps),
        ]
    )
    collected = re.search(r"Collected : (\d+)", answer.stderr)
    assert collected is not None, answer.stderr
    return int(collected[1]) / steps, answer.stdout.strip()


def run(command: list[str]) -> subprocess.CompletedProcess[str]:
    answer = subprocess.run(command, capture_output=True, text=True, check=False)
    if answer.returncode != 0:
        raise SystemExit(f"{command[0]} failed:\n{answer.stderr}")
    return answer


if __name__ == "__main__":
    sys.exit(main())
