"""Plots of an analysis, from its data as JSON holds it: Bode, Nyquist, step response, poles."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pirlc.backend.files import write_bytes
from pirlc.report.svg import WIDTH, drawing, svg_of

Data = Mapping[str, Any]

_BLUE, _ORANGE, _GREEN, _RED, _GREY = "#4c72b0", "#dd8452", "#55a868", "#c44e52", "#8c8c8c"


MOST_LOOPS = 4
"""Whose plots are shown on a page; the figures of all are in its tables."""


@dataclass(frozen=True)
class Plot:
    """A plot before it is drawn; `pointer` is the JSON pointer, in the analysis, to its data."""

    name: str
    title: str
    pointer: str
    draw: Callable[[Any], None]


def plots(analysis: Data, most_loops: int = MOST_LOOPS) -> dict[str, tuple[str, str]]:
    """JSON pointer and inline SVG by name ("steer-bode", "steer-nyquist", "steer-step",
    "steer-poles", "steer-simulated"), in the order of the loops. The same data give the same text.

    Of many loops those are drawn first whose leaves are taken at the operating point.
    """
    found = {}
    for plot in _plots(analysis, most_loops):
        with drawing(f"analysis-{plot.name}", 3.0, WIDTH / 2) as figure:
            plot.draw(figure)
            found[plot.name] = plot.pointer, svg_of(figure, f"analysis-{plot.name}", plot.title)
    return found


def write_plots(analysis: Data, folder: Path) -> list[Path]:
    """The same of all loops as PNG files in a folder, which is made if it is not there."""
    return [
        write_bytes(folder / f"{plot.name}.png", _png(plot.draw))
        for plot in _plots(analysis, len(analysis["loops"]))
    ]


def _plots(analysis: Data, most_loops: int) -> Iterator[Plot]:
    unit = "s" if analysis["sample_time"] is not None else "steps"
    rate = "rad/s" if analysis["sample_time"] is not None else "rad/step"
    active = [leaf["name"] for leaf in analysis["leaves"] if leaf["active"]]
    # A loop whose action moves nothing that it reads has no response to draw.
    numbered = [
        (i, loop) for i, loop in enumerate(analysis["loops"]) if loop["response"]["frequencies"]
    ]
    first = sorted(numbered, key=lambda pair: pair[1]["leaf"] not in active)[:most_loops]
    for i, loop in sorted(first, key=lambda pair: pair[0]):
        leaf, at = loop["leaf"], f"/loops/{i}"
        name = _file_name(leaf)
        bode = partial(_bode, loop=loop, rate=rate)
        yield Plot(f"{name}-bode", f"Bode plot of {leaf}", f"{at}/response", bode)
        nyquist = partial(_nyquist, loop=loop)
        yield Plot(f"{name}-nyquist", f"Nyquist plot of {leaf}", f"{at}/response", nyquist)
        if loop["step"] is not None:
            step = partial(_step, loop=loop, unit=unit)
            yield Plot(f"{name}-step", f"Step response of {leaf}", f"{at}/step", step)
        poles = partial(_poles, loop=loop)
        yield Plot(f"{name}-poles", f"Poles of {leaf}", f"{at}/poles", poles)
    for i, response in enumerate(analysis["responses"]):
        if response["times"]:
            name = f"{_file_name(response['leaf'])}-simulated"
            title = f"{response['leaf']} predicted and simulated"
            simulated = partial(_simulated, response=response, unit=unit)
            yield Plot(name, title, f"/responses/{i}", simulated)


def _file_name(leaf: str) -> str:
    return re.sub(r"[^A-Za-z0-9_]+", "-", leaf).strip("-")


def _png(draw: Callable[[Any], None]) -> bytes:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    draw(figure)
    out = io.BytesIO()
    # Nothing in the file tells when it was made: the same data give the same bytes.
    figure.savefig(out, format="png", dpi=130, metadata={"Software": None})
    return out.getvalue()


def _numbers(values: Sequence[Any]) -> Any:
    """JSON has texts for infinities."""
    return np.array([float(value) for value in values], dtype=np.float64)


def _bode(figure: Any, loop: Data, rate: str) -> None:
    """Size and phase of L, with the crossovers."""
    upper, lower = figure.subplots(2, 1, sharex=True)
    response = loop["response"]
    w = _numbers(response["frequencies"])
    values = _numbers(response["real"]) + 1j * _numbers(response["imaginary"])
    with np.errstate(divide="ignore"):
        size = 20.0 * np.log10(np.abs(values))
    phase = np.degrees(np.unwrap(np.angle(values)))
    phase -= 360.0 * round((phase[0] + 90.0) / 360.0)
    upper.semilogx(w, size, color=_BLUE)
    lower.semilogx(w, phase, color=_BLUE)
    upper.axhline(0.0, color=_GREY, linewidth=0.8)
    for turn in range(math.floor(phase.min() / 360.0) - 1, math.ceil(phase.max() / 360.0) + 1):
        level = 360.0 * turn - 180.0
        if phase.min() - 30.0 <= level <= phase.max() + 30.0:
            lower.axhline(level, color=_GREY, linewidth=0.8)
    finite = size[np.isfinite(size)]
    upper.set_ylim(max(finite.min(), -80.0) - 5.0, min(finite.max(), 80.0) + 5.0)
    margins = loop["margins"]
    title = f"L of {loop['leaf']}"
    if margins is not None:
        title += f"\n{_margin_words(margins)}"
        for key, axes, color in (
            ("phase_frequency", lower, _ORANGE),
            ("gain_up_frequency", upper, _RED),
            ("gain_down_frequency", upper, _RED),
        ):
            at = margins[key]
            if not at or at < w[0]:
                continue
            for both in (upper, lower):
                both.axvline(at, color=color, linewidth=0.9, linestyle="--")
            i = int(np.argmin(np.abs(w - at)))
            axes.plot([at], [(phase if axes is lower else size)[i]], "o", color=color, markersize=5)
    upper.set_title(title, fontsize="medium")
    upper.set_ylabel("|L|, dB")
    lower.set_ylabel("phase of L, degrees")
    lower.set_xlabel(f"frequency, {rate}")
    for axes in (upper, lower):
        axes.grid(alpha=0.3, which="both")
        axes.margins(x=0.0)
    _plain_powers(lower)


def _plain_powers(axes: Any) -> None:
    """Ticks of a logarithmic axis without matplotlib's formulas, which pages do not parse."""
    from matplotlib.ticker import NullFormatter

    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())


def _margin_words(margins: Data) -> str:
    parts = []
    up, down, phase = (float(margins[key]) for key in ("gain_up", "gain_down", "phase"))
    if math.isfinite(up):
        parts.append(f"gain × {up:.3g}")
    if down > 0.0:
        parts.append(f"gain × {down:.3g}")
    if math.isfinite(phase):
        parts.append(f"phase {phase:.3g}°")
    return ", ".join(parts) or "no crossovers"


def _nyquist(figure: Any, loop: Data) -> None:
    """L for positive and negative frequencies, -1, and the disk that it keeps out of."""
    from matplotlib.patches import Circle

    axes = figure.add_subplot()
    response = loop["response"]
    real, imaginary = _numbers(response["real"]), _numbers(response["imaginary"])
    axes.plot(real, imaginary, color=_BLUE, label="L")
    axes.plot(real, -imaginary, color=_BLUE, linestyle=":", label="negative frequencies")
    axes.add_patch(Circle((0.0, 0.0), 1.0, fill=False, color=_GREY, linewidth=0.8, linestyle="--"))
    axes.plot([-1.0], [0.0], "+", color=_RED, markersize=11, markeredgewidth=2, label="-1")
    view = 2.2
    if loop["margins"] is not None:
        low, high = (float(value) for value in loop["margins"]["disk_gain"])
        if math.isfinite(high):
            view = max(view, min(1.25 * high, 8.0))
            disk = Circle(
                (-0.5 * (low + high), 0.0), 0.5 * (high - low), color=_RED, alpha=0.15,
                label=f"disk margin {float(loop['margins']['disk']):.3g}",
            )  # fmt: skip
            axes.add_patch(disk)
    axes.set_xlim(-view, max(1.2, view * 0.6))
    axes.set_ylim(-view * 0.8, view * 0.8)
    axes.set_aspect("equal", adjustable="box")
    axes.axhline(0.0, color=_GREY, linewidth=0.5)
    axes.axvline(0.0, color=_GREY, linewidth=0.5)
    axes.set_title(f"Nyquist plot of {loop['leaf']}", fontsize="medium")
    axes.set_xlabel("real part")
    axes.set_ylabel("imaginary part")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small", loc="upper right")


def _step(figure: Any, loop: Data, unit: str) -> None:
    step = loop["step"]
    upper, lower = figure.subplots(2, 1, sharex=True)
    times = _numbers(step["times"])
    upper.step(times, _numbers(step["outputs"][step["sensor"]]), where="post", color=_BLUE)
    final = step["final"]
    if final is not None:
        upper.axhline(float(final), color=_GREY, linewidth=0.8, linestyle="--")
    if step["settling_time"] is not None:
        upper.axvline(float(step["settling_time"]), color=_GREEN, linewidth=0.9, linestyle="--")
    lower.step(times, _numbers(step["action"]), where="post", color=_ORANGE)
    upper.set_title(f"{loop['leaf']}: unit step of {step['what']}", fontsize="medium")
    upper.set_ylabel(step["sensor"])
    lower.set_ylabel(f"{loop['action']} (unclipped)")
    lower.set_xlabel(f"time, {unit}")
    shown = float(times[-1])
    if step["settling_time"]:
        shown = min(shown, 2.5 * float(step["settling_time"]))
    for axes in (upper, lower):
        axes.grid(alpha=0.3)
        axes.set_xlim(0.0, max(shown, float(times[1])))


def _poles(figure: Any, loop: Data) -> None:
    """Closed and open loop, with lines of equal damping inside the unit circle."""
    axes = figure.add_subplot()
    turn = np.linspace(0.0, 2.0 * np.pi, 361)
    axes.plot(np.cos(turn), np.sin(turn), color=_GREY, linewidth=1.0)
    angle = np.linspace(0.0, np.pi, 200)
    for damping in (0.2, 0.4, 0.6, 0.8):
        spiral = np.exp(angle * (-damping / math.sqrt(1.0 - damping**2) + 1j))
        for side in (spiral, spiral.conj()):
            axes.plot(side.real, side.imag, color=_GREY, linewidth=0.5, alpha=0.6)
        axes.annotate(f"{damping}", (spiral[60].real, spiral[60].imag), fontsize=7, color=_GREY)
    for key, mark, color, label in (
        ("open_poles", "o", _ORANGE, "open loop"),
        ("poles", "x", _BLUE, "closed loop"),
    ):
        axes.plot(
            [pole["real"] for pole in loop[key]],
            [pole["imaginary"] for pole in loop[key]],
            mark, color=color, markerfacecolor="none", markersize=7, label=label,
        )  # fmt: skip
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title(
        f"Poles of {loop['leaf']}: {'stable' if loop['stable'] else 'unstable'}", fontsize="medium"
    )
    axes.set_xlabel("real part of z")
    axes.set_ylabel("imaginary part of z")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small", loc="upper left")


def _simulated(figure: Any, response: Data, unit: str) -> None:
    """What the linear loop predicts beside what the simulator did."""
    names = list(response["predicted"])[:4]
    grid = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    times = _numbers(response["times"])
    for axes, name in zip(grid, names, strict=True):
        axes.plot(times, _numbers(response["simulated"][name]), color=_ORANGE, label="simulated")
        axes.plot(
            times, _numbers(response["predicted"][name]), "--", color=_BLUE, label="predicted"
        )
        axes.set_ylabel(name)
        axes.grid(alpha=0.3)
        axes.margins(x=0.0)
    grid[0].set_title(f"{response['leaf']}: {response['what']}", fontsize="medium")
    grid[0].legend(fontsize="small")
    grid[-1].set_xlabel(f"time, {unit}")
