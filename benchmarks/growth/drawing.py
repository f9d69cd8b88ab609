"""Time and memory against size, in logarithms: a column an axis."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchmarks.growth.findings import Curve


def draw(curves: Sequence[Curve], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    lines = [curve for curve in curves if len(curve.points) > 1]
    axes = list(dict.fromkeys(curve.axis for curve in lines))
    figure, places = plt.subplots(
        2, len(axes), figsize=(4.6 * len(axes), 9), squeeze=False, layout="constrained"
    )
    for column, axis in enumerate(axes):
        time, memory = places[0][column], places[1][column]
        here = [curve for curve in lines if curve.axis == axis]
        for curve in here:
            sizes = [point.size for point in curve.points]
            times = [point.time for point in curve.points]
            found = curve.time_exponent()
            label = curve.name if found is None else f"{curve.name}: {found}"
            time.plot(sizes, times, marker="o", markersize=3, label=label)
            peaks = [point.peak / 2**20 for point in curve.points]
            memory.plot(sizes, peaks, marker="o", markersize=3, label=curve.name)
        _linear(time, here)
        time.set_ylabel("processor time (s)")
        memory.set_ylabel("peak memory of the process (MiB)")
        for place in (time, memory):
            place.set(xscale="log", yscale="log", xlabel=axis)
            place.grid(visible=True, which="major", alpha=0.3)
            place.legend(fontsize=6)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _linear(place: object, curves: Sequence[Curve]) -> None:
    """A line of exponent 1 below the others, to compare with."""
    first = min(point.size for curve in curves for point in curve.points)
    last = max(point.size for curve in curves for point in curve.points)
    lowest = min(curve.points[-1].time * first / last for curve in curves)
    place.plot(  # type: ignore[attr-defined]
        [first, last], [lowest, lowest * last / first], "k:", linewidth=1, label="linear"
    )
