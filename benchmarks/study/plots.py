"""Plots from records alone; the same records give the same bytes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.study.peers_tables import OURS, TITLES, stem
from benchmarks.study.records import Record
from benchmarks.study.rows import REFINED
from benchmarks.study.summing import front
from benchmarks.study.tables import ENVIRONMENTS, OPENAI
from benchmarks.torcs.telling import save

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Records = Sequence[Record]
COLUMNS = 3
MARKS = "osD^vP*X<>hd"


def plots(classic: Records, peers: Records, folder: Path) -> list[Path]:
    """All that there are records for: the files written."""
    made = []
    if classic or peers:
        size = sized(classic, peers)
        made.append(save(size, folder / "return-size.png"))
    if classic:
        made.append(save(timed(classic, peers), folder / "return-time.png"))
    if any(record.figures.get("pairs") for record in classic):
        made.append(save(imitated(classic), folder / "distance-return.png"))
    return made


def _figure(title: str, records: Records) -> tuple[Figure, dict[str, Axes]]:
    from matplotlib.figure import Figure

    names = [name for name in ENVIRONMENTS if any(r.environment == name for r in records)]
    columns = min(max(len(names), 1), COLUMNS)
    rows = -(-max(len(names), 1) // columns)
    figure = Figure(figsize=(4.2 * columns, 3.8 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).flatten()
    figure.suptitle(title)
    for spare in axes[len(names) :]:
        spare.set_visible(False)
    for name, axis in zip(names, axes, strict=False):
        axis.set_title(name)
        axis.grid(alpha=0.3)
    return figure, dict(zip(names, axes, strict=False))


def _points(
    records: Records, axes: dict[str, Axes], cost: Callable[[Record], float | None]
) -> dict[str, list[tuple[float, float]]]:
    """Draws each method in its own colour; the points by environment."""
    methods = list(dict.fromkeys(_title(r) for r in records))
    drawn: dict[str, list[tuple[float, float]]] = {name: [] for name in axes}
    for number, method in enumerate(methods):
        for name, axis in axes.items():
            found = [
                (value, r.returns)
                for r in records
                if _title(r) == method
                and r.environment == name
                and r.returns is not None
                and (value := cost(r)) is not None
            ]
            # Empty ones too: then every legend has every method, in the same colour.
            means = [returns.mean for _, returns in found]
            halves = [(returns.high - returns.low) / 2 for _, returns in found]
            axis.errorbar(
                [value for value, _ in found],
                means,
                yerr=halves if halves else None,
                fmt=MARKS[number % len(MARKS)],
                color=f"C{number % 10}",
                markersize=6,
                label=method,
            )
            drawn[name] += [(value, returns.mean) for value, returns in found]
    if axes:
        figure = next(iter(axes.values())).figure
        handles, labels = next(iter(axes.values())).get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=6, fontsize="small")
    return drawn


def _title(record: Record) -> str:
    if record.suite == "peers":
        # One method may come in several sizes.
        return stem(record.method)
    return TITLES.get(record.method, record.method)


def sized(classic: Records, peers: Records) -> Figure:
    """Return against size, and the front of those that nothing shorter equals."""
    records = [r for r in (*classic, *peers) if r.size is not None and r.method != "minimum"]
    records = [r for r in records if r.suite == "peers" or r.method in (*OURS, *OPENAI)]
    figure, axes = _figure("return against size", records)
    drawn = _points(records, axes, lambda r: None if r.size is None else float(r.size))
    for name, axis in axes.items():
        best = front(drawn[name])
        axis.step(
            [cost for cost, _ in best],
            [gain for _, gain in best],
            where="post",
            color="0.5",
            linewidth=1,
            zorder=0,
        )
        axis.set_xlabel("nodes")
        axis.set_xscale("log")
    _first(axes, "return")
    return figure


def timed(classic: Records, peers: Records) -> Figure:
    """Return against the core seconds that the search took."""
    records = [
        r
        for r in (*classic, *peers)
        if r.core_seconds is not None and not (r.suite == "classic" and r.method.endswith(REFINED))
    ]
    figure, axes = _figure("return against search time", records)
    _points(records, axes, lambda r: r.core_seconds)
    for axis in axes.values():
        axis.set_xlabel("core seconds")
        axis.set_xscale("log")
    _first(axes, "return")
    return figure


def imitated(classic: Records) -> Figure:
    """Distance to the oracle against return, for all programs that Algorithm 1 simulated."""
    records = [r for r in classic if r.figures.get("pairs") and r.method in OPENAI]
    figure, axes = _figure("does imitation predict return?", records)
    for number, method in enumerate(OPENAI):
        for name, axis in axes.items():
            found = [
                pair
                for r in records
                if r.method == method and r.environment == name
                for pair in r.figures["pairs"]
            ]
            axis.scatter(
                [distance for distance, _ in found],
                [mean for _, mean in found],
                s=14,
                alpha=0.6,
                marker=MARKS[number],
                color=f"C{number}",
                label=method if found else None,
            )
    for axis in axes.values():
        axis.set_xlabel("distance to the oracle")
        axis.legend(fontsize="small")
    _first(axes, "return")
    return figure


def _first(axes: dict[str, Axes], label: str) -> None:
    for axis in list(axes.values())[:1]:
        axis.set_ylabel(label)
