"""Several seeds of one row in a few figures."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from benchmarks.study.records import Record, Return

AT_CEILING = 0.001
"""A return this close to the ceiling, as a part of it, is at the ceiling."""


@dataclass(frozen=True)
class Pooled:
    """The mean over seeds of what a row earns.

    `half`: of the 95 % interval for these very programs (the episodes' chance, not the seeds').
    `least`, `most`: of the seeds' means.
    """

    mean: float
    half: float
    least: float
    most: float
    seeds: int

    @property
    def low(self) -> float:
        return self.mean - self.half

    @property
    def high(self) -> float:
        return self.mean + self.half


def pooled(returns: Sequence[Return]) -> Pooled:
    """Raises ValueError for none at all."""
    means = [found.mean for found in returns]
    halves = [(found.high - found.low) / 2 for found in returns]
    half = math.sqrt(math.fsum(h * h for h in halves)) / len(halves) if halves else 0.0
    return Pooled(statistics.fmean(means), half, min(means), max(means), len(means))


def of(records: Iterable[Record], method: str, environment: str) -> list[Record]:
    """A row's records, by seed."""
    found = [r for r in records if r.method == method and r.environment == environment]
    return sorted(found, key=lambda record: record.seed)


def pool(records: Iterable[Record], method: str, environment: str) -> Pooled | None:
    """A row's return; None if it has none."""
    returns = [r.returns for r in of(records, method, environment) if r.returns is not None]
    return pooled(returns) if returns else None


def methods(records: Iterable[Record], environment: str | None = None) -> list[str]:
    """Those that there are records of, in order of their names."""
    return sorted({r.method for r in records if environment in (None, r.environment)})


def at_ceiling(found: Return, ceiling: float | None) -> bool:
    return ceiling is not None and found.mean >= ceiling * (1 - AT_CEILING)


def against(ours: Return, theirs: Return, ceiling: float | None) -> str:
    """How one return compares with another, in a word or two."""
    if at_ceiling(ours, ceiling) and at_ceiling(theirs, ceiling):
        return "both at the ceiling"
    if ours.low > theirs.high:
        return "higher"
    if ours.high < theirs.low:
        return "lower"
    return "intervals overlap"


def front(points: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Of (cost, gain), those that none of the others is cheaper than without gaining less."""
    kept: list[tuple[float, float]] = []
    for cost, gain in sorted(points, key=lambda point: (point[0], -point[1])):
        if not kept or gain > kept[-1][1]:
            kept.append((cost, gain))
    return kept
