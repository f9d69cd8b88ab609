"""The whole benchmark, its tables and its plot.

    python -m benchmarks.growth [--quick] [--runs N] [--only WORD] [--output FOLDER]

Writes growth.md, growth.json and growth.png. Exit status 1 where a bar is missed.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from benchmarks.growth.findings import (
    MEMORY_LIMIT,
    Curve,
    Point,
    as_json,
    markdown,
    memory,
    seconds,
)
from benchmarks.growth.measure import Figure, Server

COSTLY = 3.0
"""Seconds; what takes longer needs no repetition to be told from noise."""

RESULTS = Path(__file__).resolve().parent.parent / "results"


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.growth", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="three small sizes of each, one run")
    parser.add_argument("--runs", type=int, default=3, help="processes for each figure")
    parser.add_argument("--only", default="", help="stages with this in their name or axis")
    parser.add_argument("--output", type=Path, default=RESULTS)
    options = parser.parse_args(words)
    if options.runs < 1:
        parser.error("--runs must be at least 1")
    started = time.monotonic()
    curves, baseline = measured(options.quick, options.runs, options.only)
    if not curves:
        parser.error(f"no stage has {options.only!r} in its name or axis")
    options.output.mkdir(parents=True, exist_ok=True)
    largest = max(point.peak for curve in curves for point in curve.points)
    preface = (
        f"Processor time of one core, and peak memory of the whole process, of which "
        f"{memory(baseline)} are libraries. Median of {options.runs} processes for each size. "
        f"Exponents with 95 % intervals; the upper half are the sizes above the middle of the "
        f"range in logarithms. Largest process: {memory(largest)} (at most "
        f"{memory(MEMORY_LIMIT)} wanted). Made by `python -m benchmarks.growth` with Python "
        f"{platform.python_version()} in {time.monotonic() - started:.0f} s."
    )
    text = markdown(curves, preface)
    (options.output / "growth.md").write_text(text, encoding="utf-8")
    found = {
        "date": datetime.now(UTC).date().isoformat(),
        "machine": platform.machine(),
        "python": platform.python_version(),
        "runs": options.runs,
        "quick": options.quick,
        "libraries_bytes": baseline,
        "curves": as_json(curves, baseline),
    }
    (options.output / "growth.json").write_text(json.dumps(found, indent=1) + "\n", "utf-8")
    # Last: what this process holds, a child would count as its own.
    from benchmarks.growth.drawing import draw

    draw(curves, options.output / "growth.png")
    print(text)
    missed = [curve for curve in curves if curve.within is False]
    return 1 if missed or largest > MEMORY_LIMIT else 0


def measured(quick: bool, runs: int, only: str) -> tuple[list[Curve], int]:
    """The curves, and the peak memory of an empty job.

    Every size of every stage once, then all of them again: what disturbs the machine for a while
    disturbs no size more than the others. What is long or costly is run once.
    """
    from benchmarks.growth.suite import STAGES

    chosen = [
        (number, stage)
        for number, stage in enumerate(STAGES)
        if only.lower() in f"{stage.name} {stage.axis.value}".lower()
        and not (quick and len(stage.sizes) == 1)
    ]
    sizes = {number: stage.sizes[: 3 if quick else None] for number, stage in chosen}
    figures: dict[tuple[int, int], list[Figure]] = {}
    with Server() as server:
        baseline = server.measure(-1, 0).peak
        for run in range(1 if quick else runs):
            for number, stage in chosen:
                for size in sizes[number]:
                    if run and (stage.long or figures[number, size][0].seconds > COSTLY):
                        continue
                    figure = server.measure(number, size)
                    figures.setdefault((number, size), []).append(figure)
                    line = f"{stage.name}, {stage.axis.value}, {size:,}: "
                    line += f"{seconds(figure.seconds)}, {memory(figure.peak)}"
                    print(line, file=sys.stderr)
    curves = [
        Curve(
            stage.name,
            stage.axis.value,
            stage.limit,
            tuple(_point(size, figures[number, size]) for size in sizes[number]),
        )
        for number, stage in chosen
    ]
    return curves, baseline


def _point(size: int, figures: Sequence[Figure]) -> Point:
    return Point(size, tuple(f.seconds for f in figures), tuple(f.peak for f in figures))


if __name__ == "__main__":
    raise SystemExit(main())
