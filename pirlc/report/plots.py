"""Plots of a run."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pirlc.backend.files import write_bytes

if TYPE_CHECKING:
    from pirlc.search.context import Record
    from pirlc.simulation.rollout import ReturnEstimate

STAGES = (
    ("initialize", "initialize", "o", "#4c72b0"),
    ("iteration", "Algorithm 1's loop", "s", "#55a868"),
    ("refine", "refined on return", "^", "#dd8452"),
    ("validate", "finalists", "D", "#c44e52"),
)


_TAIL = 0.25
"""The share of the programs that may be left out at the bottom of a plot, at most."""


def lowest_shown(means: list[float]) -> float:
    """Where the axis of returns may end, so that single very bad programs do not stretch it.

    Minus infinity unless the worst quarter takes up more room than all others.
    """
    if not means:
        return -math.inf
    low, cut, high = np.quantile(means, [0.0, _TAIL, 1.0])
    if high - cut <= 0.0 or cut - low <= high - cut:
        return -math.inf
    return float(cut - 0.5 * (high - cut))


def plot_search(
    met: Record, size: int, program: ReturnEstimate | None, oracle: ReturnEstimate | None, to: Path
) -> Path:
    """Return against size of every simulated program, with the result's and the oracle's."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 4.5), layout="constrained")
    axes = figure.add_subplot()
    shown: list[float] = []
    for prefix, label, marker, color in STAGES:
        points = [(c.size, c.mean) for stage, c in met if stage.startswith(prefix) and c.returns]
        if points:
            sizes, means = zip(*points, strict=True)
            shown += means
            axes.scatter(sizes, means, s=22, label=label, marker=marker, color=color, alpha=0.6)
    if program is not None:
        axes.errorbar(
            [size],
            [program.mean],
            [[program.mean - program.low], [program.high - program.mean]],
            fmt="*",
            color="black",
            markersize=13,
            capsize=4,
            label=f"program: {program.mean:.2f}",
        )
    if program is not None:
        shown.append(program.mean)
    if oracle is not None:
        shown.append(oracle.mean)
        axes.axhline(oracle.mean, color="grey", linestyle="--", label=f"oracle: {oracle.mean:.2f}")
    lowest = lowest_shown(shown)
    hidden = sum(mean < lowest for mean in shown)
    if hidden:
        axes.set_ylim(bottom=lowest)
        axes.set_title(f"{hidden} of {len(shown)} are below", fontsize="small", loc="right")
    axes.set_xlabel("size (nodes)")
    axes.set_ylabel("mean return")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small")
    FigureCanvasAgg(figure)
    image = io.BytesIO()
    # No date in the file: the same run gives the same bytes.
    figure.savefig(image, format="png", dpi=130, metadata={"Software": None})
    return write_bytes(to, image.getvalue())
