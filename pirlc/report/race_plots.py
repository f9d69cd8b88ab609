"""Plots of a race in TORCS: the line that was driven, and what the driver did."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pirlc.backend.files import write_bytes
from pirlc.simulation.torcs.protocol import Trace

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LAPS = ("#4c72b0", "#dd8452", "#55a868", "#c44e52", "#8172b3", "#937860")


def plot_line(trace: Trace, edges: NDArray[np.float64], title: str, to: Path) -> Path:
    """The line on the map of the track, coloured by speed.

    `edges` has shape (n, 4): x and y (m) of the left and of the right edge, around the track.
    """
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 7), layout="constrained")
    axes = figure.add_subplot()
    around = np.vstack([edges, edges[:1]])
    for side in (0, 2):
        axes.plot(around[:, side], around[:, side + 1], color="grey", linewidth=0.7)
    x, y = trace["x"], trace["y"]
    points = np.column_stack([x, y])
    line = LineCollection(list(np.stack([points[:-1], points[1:]], axis=1)), cmap="viridis")
    line.set_array(trace["speed"][:-1] * 3.6)
    line.set_linewidth(1.2)
    axes.add_collection(line)
    figure.colorbar(line, ax=axes, label="speed (km/h)", shrink=0.8)
    axes.plot(x[0], y[0], "o", color="#c44e52", markersize=7, label="start")
    axes.plot(x[-1], y[-1], "s", color="black", markersize=5, label="end")
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.set_title(title)
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small")
    return _save(figure, to)


def plot_actions(trace: Trace, length: float, title: str, to: Path) -> Path:
    """Steering, accelerator, brake where it was used, and speed over the distance of each lap.

    `length`: of the track, in m. The grid is some way before the line, at a negative distance.
    """
    from matplotlib.figure import Figure

    actions = trace.actions
    rows = [("steer", actions[:, 0]), ("accel", actions[:, 1])]
    if actions[:, 2].any():
        rows.append(("brake", actions[:, 2]))
    rows.append(("speed (km/h)", trace["speed"][:-1] * 3.6))
    figure = Figure(figsize=(9, 2.0 * len(rows) + 0.6), layout="constrained")
    panels = figure.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0]
    laps = trace["laps"][:-1]
    for lap in np.unique(laps):
        here = laps == lap
        along = trace["distance"][:-1][here] - _begin(trace, int(lap), length)
        for axes, (_, values) in zip(panels, rows, strict=True):
            color = _LAPS[int(lap) % len(_LAPS)]
            axes.plot(along, values[here], linewidth=0.7, color=color, label=f"lap {int(lap) + 1}")
    for axes, (name, _) in zip(panels, rows, strict=True):
        axes.set_ylabel(name)
        axes.grid(alpha=0.3)
    panels[-1].set_xlabel("distance in the lap (m)")
    panels[0].set_title(title)
    panels[0].legend(fontsize="small", loc="upper right", ncols=6)
    return _save(figure, to)


def _begin(trace: Trace, lap: int, length: float) -> float:
    """The distance driven (m) where a lap, counted from 0, begins: for the first, at the line."""
    if lap:
        return float(trace["distance"][trace["laps"] == lap][0])
    later = trace["distance"][trace["laps"] == 1]
    return float(later[0]) - length if len(later) else 0.0


def _save(figure: Figure, to: Path) -> Path:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure)
    image = io.BytesIO()
    # No date in the file: the same race gives the same bytes.
    figure.savefig(image, format="png", dpi=130, metadata={"Software": None})
    return write_bytes(to, image.getvalue())
