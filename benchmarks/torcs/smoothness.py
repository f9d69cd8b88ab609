"""How quietly drivers steer: the paper's Table smoothness and its scatter plot.

    python -m benchmarks.torcs.smoothness

The table gives the population standard deviation of the steering over the whole race of three laps.
The plot shows the steering of an oracle and of programs in the same slice of CG-Speedway-1.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.torcs import paper
from benchmarks.torcs.drivers import Driver, oracles, printed, synthesised
from benchmarks.torcs.racing import WHOLE, race
from benchmarks.torcs.telling import ending, number, racing_parser, save, table, tell
from pirlc.simulation.torcs.protocol import Trace
from pirlc.simulation.torcs.summary import summary

HEAD = (
    "driver",
    "steering deviation",
    "mean lap, s",
    "ended early",
    "paper's row",
    "its deviation",
)

SLICE = (0.0, 700.0)
"""Metres of the second lap."""

_COLORS = ("#c44e52", "#4c72b0", "#55a868", "#dd8452", "#8172b3", "#937860")


def field(programs: Path, trained: Path, libraries: Path) -> Iterator[Driver]:
    yield from oracles(trained)
    yield from synthesised(programs, libraries, ("paper",))
    yield from printed(libraries)
    yield from synthesised(programs, libraries, ("racer",))


def plot(traces: Mapping[str, Trace], to: Path) -> Path:
    """The steering over the slice, a panel a driver."""
    from matplotlib.figure import Figure

    count = len(traces)
    figure = Figure(figsize=(9, 1.7 * count + 0.7), layout="constrained")
    panels = figure.subplots(count, 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for axes, (name, trace), color in zip(panels, traces.items(), _COLORS, strict=False):
        # A driver that did not finish its first lap is shown in it.
        lap = min(1.0, float(trace["laps"].max()))
        along = trace["distance"][:-1] - trace["distance"][trace["laps"] == lap][0]
        here = (trace["laps"][:-1] == lap) & (along >= SLICE[0]) & (along <= SLICE[1])
        axes.scatter(along[here], trace.actions[here, 0], s=3, color=color)
        axes.set_title(f"{name}, lap {lap + 1:.0f}", fontsize="small")
        axes.set_ylabel("steer")
        axes.set_ylim(-1.05, 1.05)
        axes.grid(alpha=0.3)
    panels[-1].set_xlabel("distance in the lap (m)")
    return save(figure, to)


def shown(traces: Mapping[str, Trace]) -> dict[str, Trace]:
    """One driver of each kind, the first; of oracles all."""
    kinds: dict[str, str] = {}
    for name in traces:
        kinds.setdefault(name if name.startswith("oracle") else name.split(",")[0], name)
    return {name: traces[name] for name in list(kinds.values())[: len(_COLORS)]}


def main(words: list[str] | None = None) -> None:
    chosen = racing_parser("benchmarks.torcs.smoothness", __doc__).parse_args(words)
    texts, data = [], []
    with TemporaryDirectory(prefix="pirlc-") as libraries:
        drivers = list(field(chosen.programs, chosen.oracles, Path(libraries)))
        for track in paper.TRAINING:
            rows, traces = [], {}
            for driver in drivers:
                if not driver.fits(track):
                    continue
                trace = traces[driver.name] = race(driver, track, WHOLE, chosen.laps)
                figures, rival = summary(trace), driver.rival
                known = paper.SMOOTHNESS.get((rival, track)) if rival else None
                rows.append(
                    (
                        driver.name,
                        number(figures.steering_deviation, 4),
                        number(figures.mean_lap, 2),
                        ending(figures),
                        rival or "-",
                        number(np.nan if known is None else known, 4),
                    )
                )
                data.append(
                    {
                        "track": track,
                        "driver": driver.name,
                        "steering_deviation": figures.steering_deviation,
                        "mean_lap": figures.mean_lap,
                    }
                )
            texts.append(f"## {paper.TITLES[track]}\n\n{table(HEAD, rows)}")
            if track == paper.G_TRACK_1 and traces:
                plot(shown(traces), chosen.output / "smoothness.png")
    tell("smoothness", "\n".join(texts), data, chosen.output)


if __name__ == "__main__":
    main()
