"""From a run's folder to a record."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.study.records import Return, finite
from pirlc.ir.policy import Program

ALGORITHM_1 = re.compile(r"initialize|iteration \d+")
"""The stages in which a candidate has the distance that it was tuned for, and a return."""


def return_of(manifest: dict[str, Any], subject: str) -> Return | None:
    """What an evaluation at the end of a run found for `program`, `oracle`, ..."""
    evaluation = manifest["evaluation"]
    found = evaluation["returns"].get(subject)
    if found is None:
        return None
    names = ("mean", "low", "high")
    mean, low, high = (float(f"{found[name]:.8g}") for name in names)
    return Return(mean, low, high, int(found["episodes"]), int(evaluation["first_seed"]))


def pairs(folder: Path) -> list[list[float]]:
    """Distance and mean return of all that Algorithm 1 simulated in a run, in order."""
    found: list[list[float]] = []
    try:
        lines = (folder / "candidates.jsonl").read_text("utf-8").splitlines()
    except OSError:
        return found
    for line in lines:
        entry = json.loads(line)
        loss, mean = finite(entry["loss"]), finite(entry["mean_return"])
        if ALGORITHM_1.fullmatch(entry["stage"]) and loss is not None and mean is not None:
            found.append([loss, mean])
    return found


def provable(folder: Path) -> str | None:
    """What a run has proved of its program, in words."""
    try:
        found = json.loads((folder / "verification.json").read_text("utf-8"))
    except (OSError, ValueError):
        return None
    kinds: dict[str, list[str]] = {}
    for each in found["properties"]:
        kinds.setdefault(each["binary64"]["kind"], []).append(each["name"])
    told = [f"{', '.join(names)} {kind}" for kind, names in kinds.items()]
    if found["bounds"] and all(kind == "proved" for kind in _evidence(found["bounds"])):
        told.append("bounds proved")
    same = {kind for each in found["emitted"] for kind in _evidence(each)}
    if same:
        told.append(f"emitted C equal to it: {' or '.join(sorted(same))}")
    return "; ".join(told) or "nothing"


def _evidence(found: Any) -> Iterator[str]:
    """The kinds of all evidence in a finding."""
    match found:
        case dict():
            if "evidence" in found:
                yield found["evidence"]["kind"]
            for value in found.values():
                yield from _evidence(value)
        case list():
            for value in found:
                yield from _evidence(value)


def oracle_of(manifest: dict[str, Any]) -> str | None:
    oracle = manifest.get("oracle")
    return None if oracle is None else str(oracle["weights_sha256"])


def optimizer_of(manifest: dict[str, Any]) -> dict[str, Any] | None:
    """Which optimiser a run took, and why; None for a run without an oracle."""
    found = manifest.get("optimizer")
    if found is None:
        return None
    return {key: found[key] for key in ("chosen", "why", "mean_distances")}


def program(text: str, name: str = "the program of a record") -> Program:
    """The program in a record's text."""
    from pirlc.cli.files import program_in
    from pirlc.frontend import parse_sketch
    from pirlc.source import SourceText

    source = SourceText(name, text)
    return program_in(source, parse_sketch(source))


def cost(text: str) -> tuple[int, float]:
    """Bytes of code and nanoseconds a step of a program's emitted C."""
    from benchmarks.peers.footprint import measure_program

    code, step = measure_program(program(text))
    return code, float(f"{step:.4g}")


def correlation(points: list[list[float]]) -> float | None:
    """Spearman's rank correlation of the first with the second; None for fewer than five points,
    or if one does not vary."""
    from scipy.stats import spearmanr

    first, second = zip(*points, strict=True) if points else ((), ())
    if len(points) < 5 or len(set(first)) == 1 or len(set(second)) == 1:
        return None
    return finite(float(spearmanr(first, second).statistic), 4)
