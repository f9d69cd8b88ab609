"""What was measured, and what follows from it: exponents, bars, tables."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from benchmarks.growth.fitting import Exponent, exponent, upper_half

MEBIBYTE = 2**20
MEMORY_LIMIT = 4 * 2**30
"""Of every process that was measured."""


@dataclass(frozen=True)
class Point:
    """One stage at one size: the processor seconds and the peak memory of several processes."""

    size: int
    seconds: tuple[float, ...]
    peaks: tuple[int, ...]

    @property
    def time(self) -> float:
        return statistics.median(self.seconds)

    @property
    def peak(self) -> int:
        return max(self.peaks)


@dataclass(frozen=True)
class Curve:
    """A stage along its axis. `limit`: the bar on the exponent, None where there is none."""

    name: str
    axis: str
    limit: float | None
    points: tuple[Point, ...]

    def time_exponent(self, sizes: Sequence[float] | None = None) -> Exponent | None:
        """Of the time, every process a point of its own, at these sizes (None: all)."""
        pairs = [
            (point.size, seconds)
            for point in self.points
            if sizes is None or point.size in sizes
            for seconds in point.seconds
        ]
        return _fitted(pairs)

    def upper_exponent(self) -> Exponent | None:
        return self.time_exponent(upper_half([p.size for p in self.points]))

    def memory_exponent(self, baseline: int) -> Exponent | None:
        """Of the memory above what an empty job takes, where that is a mebibyte or more."""
        pairs = [
            (point.size, peak - baseline)
            for point in self.points
            for peak in point.peaks
            if peak - baseline >= MEBIBYTE
        ]
        return _fitted(pairs)

    @property
    def within(self) -> bool | None:
        """Whether the exponent over the upper half meets the bar, its interval considered.

        Above the bar by less than the interval is not told from the bar.
        """
        found = self.upper_exponent()
        if self.limit is None or found is None:
            return None
        return found.value - min(found.half, 0.1) <= self.limit


def _fitted(pairs: Sequence[tuple[float, float]]) -> Exponent | None:
    if len({size for size, _ in pairs}) < 2:
        return None
    return exponent([size for size, _ in pairs], [cost for _, cost in pairs])


def as_json(curves: Iterable[Curve], baseline: int) -> list[dict[str, Any]]:
    return [
        {
            "stage": curve.name,
            "axis": curve.axis,
            "limit": curve.limit,
            "within": curve.within,
            "time_exponent": _pair(curve.time_exponent()),
            "time_exponent_upper": _pair(curve.upper_exponent()),
            "memory_exponent": _pair(curve.memory_exponent(baseline)),
            "points": [
                {"size": p.size, "seconds": list(p.seconds), "peak_bytes": list(p.peaks)}
                for p in curve.points
            ],
        }
        for curve in curves
    ]


def _pair(found: Exponent | None) -> list[float] | None:
    return None if found is None else [found.value, found.half]


def markdown(curves: Sequence[Curve], preface: str) -> str:
    """A table for each axis."""
    lines = ["# Growth", "", preface, ""]
    for axis in dict.fromkeys(curve.axis for curve in curves):
        lines += [f"## {axis[0].upper()}{axis[1:]}", ""]
        lines += [
            "| stage | sizes | time | exponent | of the upper half | bar | peak memory |",
            "|---|---|---|---|---|---|---|",
        ]
        lines += [_row(curve) for curve in curves if curve.axis == axis]
        lines.append("")
    return "\n".join(lines)


def _row(curve: Curve) -> str:
    first, last = curve.points[0], curve.points[-1]
    one = len(curve.points) == 1
    whole, upper = curve.time_exponent(), curve.upper_exponent() if not one else None
    cells = [
        curve.name,
        f"{last.size:,}" if one else f"{first.size:,} to {last.size:,}",
        seconds(last.time) if one else f"{seconds(first.time)} to {seconds(last.time)}",
        "" if whole is None else str(whole),
        "" if upper is None else str(upper),
        _bar(curve),
        memory(last.peak) if one else f"{memory(first.peak)} to {memory(last.peak)}",
    ]
    return f"| {' | '.join(cells)} |"


def _bar(curve: Curve) -> str:
    if curve.limit is None or curve.within is None:
        return ""
    return f"{'met' if curve.within else 'MISSED'} (≤ {curve.limit})"


def seconds(value: float) -> str:
    for unit, scale in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if value >= scale:
            return f"{value / scale:.3g} {unit}"
    return f"{value / 1e-9:.3g} ns"


def memory(value: int) -> str:
    if value >= 2**30:
        return f"{value / 2**30:.2f} GiB"
    return f"{value / MEBIBYTE:.0f} MiB"
