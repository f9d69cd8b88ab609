"""The plots of a run's page, by name, from its data."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from pirlc.report.plots import STAGES
from pirlc.report.svg import drawing, svg_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Data = Mapping[str, Any]

_BLACK, _BLUE, _ORANGE, _GREEN, _RED = "#222222", "#0072b2", "#d55e00", "#007a5a", "#a3123a"
_GREY = "#777777"
MOST_STEPS = 1000
"""Of a trace that a plot shows; more would be a blur on paper."""

MOST_PANELS = 8
"""Of a counterexample's plot; all readings are in the JSON."""


def page_plots(data: Data) -> dict[str, str]:
    """The plots of the page by name. Those of counterexamples are under `counterexample POINTER`,
    with the JSON pointer to the replay."""
    found: dict[str, str] = {}
    if data["search"] is not None:
        if data["search"]["points"]:
            found["search"] = _search(data["search"], data["program"], data["returns"])
        if data["search"]["iterations"]:
            found["iterations"] = _iterations(data["search"]["iterations"])
    if data["returns"] is not None:
        found["returns"] = _returns(data["returns"]["subjects"])
    if data["front"] is not None:
        found["front"] = _front(data["front"])
    if data["traces"] is not None:
        found["traces"] = _traces(data["traces"])
    if data["verification"] is not None:
        for pointer, title, replay in counterexamples(data["verification"]["found"]):
            found[f"counterexample {pointer}"] = _counterexample(replay, title, pointer)
    return found


def counterexamples(found: Data) -> Iterator[tuple[str, str, Data]]:
    """Each replay that refutes something: its JSON pointer, what it refutes, and itself."""
    for i, property_ in enumerate(found["properties"]):
        place = f"/verification/found/properties/{i}"
        if property_["counterexample"] is not None:
            title = f"Counterexample to {property_['name']}"
            yield f"{place}/counterexample", title, property_["counterexample"]
        for j, obligation in enumerate(property_["obligations"]):
            if obligation["counterexample"] is not None:
                title = f"Counterexample to {property_['name']}, {obligation['name']}"
                replay = obligation["counterexample"]
                yield f"{place}/obligations/{j}/counterexample", title, replay


# Search


def _search(search: Data, program: Data | None, returns: Data | None) -> str:
    title = "Return against size of every program simulated"
    with drawing("search", 3.7) as figure:
        axes = figure.add_subplot()
        for prefix, label, marker, color in STAGES:
            points = [p for p in search["points"] if p["stage"].startswith(prefix)]
            if points:
                axes.scatter(
                    [p["size"] for p in points],
                    [p["mean_return"] for p in points],
                    s=20, label=label, marker=marker, color=color, alpha=0.65, linewidth=0,
                )  # fmt: skip
        known = {} if returns is None else {s["name"]: s for s in returns["subjects"]}
        if program is not None and "program" in known:
            mean = known["program"]["mean"]
            axes.plot(
                [program["size"]], [mean], "*", color=_BLACK, markersize=13, label="the program"
            )
        if "oracle" in known:
            mean = known["oracle"]["mean"]
            axes.axhline(mean, color=_GREY, linestyle="--", linewidth=1, label="the oracle")
        if search["below"]:
            bottom, top = search["lowest_shown"], max(p["mean_return"] for p in search["points"])
            axes.set_ylim(bottom, top + 0.08 * (top - bottom))
        axes.set_xlabel("size (nodes)")
        axes.set_ylabel("mean return")
        _legend(axes)
        return svg_of(figure, "search", title)


def _iterations(iterations: Sequence[Data]) -> str:
    title = "Distance to the oracle against iteration of Algorithm 1"
    with drawing("iterations", 3.0) as figure:
        axes = figure.add_subplot()
        for place, stage in enumerate(iterations):
            losses = stage["distances"]
            label = "programs tuned" if place == 0 else None
            axes.plot(
                [place] * len(losses), losses, "_", color=_GREY, markersize=14, alpha=0.5,
                label=label,
            )  # fmt: skip
        places = range(len(iterations))
        closest = [stage["closest"] for stage in iterations]
        axes.plot(places, closest, "o-", color=_BLUE, markersize=5, label="the closest")
        chosen = [(i, s["chosen"]) for i, s in enumerate(iterations) if s["chosen"] is not None]
        if chosen:
            axes.plot(
                *zip(*chosen, strict=True), "D--", color=_ORANGE, markersize=5,
                label="the one chosen, by return",
            )  # fmt: skip
        axes.set_xticks(list(places), [stage["stage"] for stage in iterations])
        axes.set_xlim(-0.5, len(iterations) - 0.5)
        axes.set_ylabel("distance to the oracle")
        axes.set_ylim(bottom=0.0)
        _legend(axes)
        return svg_of(figure, "iterations", title)


def _returns(subjects: Sequence[Data]) -> str:
    title = "Mean returns with their intervals"
    with drawing("returns", 0.7 + 0.34 * len(subjects)) as figure:
        axes = figure.add_subplot()
        for place, subject in enumerate(subjects):
            mean = subject["mean"]
            if subject["low"] is not None and subject["high"] is not None:
                axes.plot([subject["low"], subject["high"]], [place] * 2, "|-", color=_BLUE)
            axes.plot([mean], [place], "o", color=_BLACK, markersize=5)
        axes.set_yticks(range(len(subjects)), [subject["name"] for subject in subjects])
        axes.set_ylim(len(subjects) - 0.5, -0.5)
        axes.margins(x=0.1)
        axes.set_xlabel("return")
        return svg_of(figure, "returns", title)


def _front(front: Data) -> str:
    title = "The programs to choose from: return against size"
    members = sorted(front["members"], key=lambda row: row["size"])
    sizes, means = [row["size"] for row in members], [row["mean"] for row in members]
    with drawing("front", 3.0) as figure:
        axes = figure.add_subplot()
        axes.plot(sizes, means, drawstyle="steps-post", color=_GREY, linewidth=1)
        for row in members:
            if row["low"] is not None and row["high"] is not None:
                axes.plot([row["size"]] * 2, [row["low"], row["high"]], "_-", color=_BLUE)
            axes.annotate(
                str(row["number"]), (row["size"], row["mean"]), (5, 4), textcoords="offset points"
            )
        axes.plot(sizes, means, "o", color=_BLACK, markersize=5, label="on the front")
        if front["outside"] is not None:
            axes.plot(
                [front["outside"]["size"]], [front["outside"]["mean"]], "D", color=_ORANGE,
                markersize=5, label="the search's own",
            )  # fmt: skip
            _legend(axes)
        axes.margins(x=0.12, y=0.12)
        axes.set_xlabel("size (nodes)")
        axes.set_ylabel("mean return")
        return svg_of(figure, "front", title)


# Traces


def _traces(traces: Data) -> str:
    title = "Actions of the program and of the oracle over one unseen episode"
    shown = min(traces["steps"], MOST_STEPS)
    distance = traces["distance"]
    count = len(traces["actions"]) + (distance is not None)
    with drawing("traces", 0.6 + 1.5 * count) as figure:
        panels = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
        steps = range(shown)
        for axes, action in zip(panels, traces["actions"], strict=False):
            style = {"drawstyle": "steps-post", "linewidth": 0.9}
            if action["oracle"] is not None:
                axes.plot(
                    steps, _curve(action["oracle"][:shown]), color=_ORANGE, label="oracle",
                    linestyle="--", **style,
                )  # fmt: skip
            axes.plot(
                steps, _curve(action["program"][:shown]), color=_BLUE, label="program", **style
            )
            axes.set_ylabel(action["name"])
        if distance is not None:
            panels[-1].plot(
                steps, distance[:shown], color=_BLACK, linewidth=0.9, drawstyle="steps-post"
            )
            panels[-1].set_ylabel("distance")
            panels[-1].set_ylim(bottom=0.0)
        panels[-1].set_xlabel("step")
        panels[-1].set_xlim(0, max(1, shown - 1))
        if distance is not None:
            _legend(panels[0])
        return svg_of(figure, "traces", title)


def _curve(values: Sequence[float | None]) -> list[float]:
    return [float("nan") if value is None else float(value) for value in values]


# Counterexamples


def _counterexample(replay: Data, title: str, pointer: str) -> str:
    """Readings, then actions, against the step; step 0 is the first that the property speaks of."""
    readings, steps = replay["history"]["readings"], replay["steps"]
    actions = list(steps[0]["raw"]) if steps else []
    panels = ([("reading", n) for n in readings] + [("action", n) for n in actions])[-MOST_PANELS:]
    rows = (len(panels) + 1) // 2
    name = "counterexample" + re.sub(r"\D+", "-", pointer)
    with drawing(name, 0.4 + 1.35 * rows) as figure:
        grid = figure.subplots(rows, 2, sharex=True, squeeze=False)
        for axes, (kind, what) in zip(grid.flat, panels, strict=False):
            if kind == "reading":
                values = _curve(readings[what])
                first = len(steps) - len(values)
                axes.plot(range(first, len(steps)), values, "o-", color=_GREEN, markersize=3.5)
                axes.set_ylabel(what)
            else:
                raw = _curve([step["raw"][what] for step in steps])
                applied = _curve([step["applied"][what] for step in steps])
                axes.plot(range(len(steps)), raw, "s--", color=_RED, markersize=4, label="raw")
                axes.plot(
                    range(len(steps)), applied, "o-", color=_BLUE, markersize=3.5, label="applied"
                )
                axes.set_ylabel(what)
                _legend(axes)
            axes.axvline(-0.5, color=_GREY, linewidth=0.8, linestyle=":")
            axes.xaxis.get_major_locator().set_params(integer=True)
        for axes in grid.flat[len(panels) :]:
            axes.set_axis_off()
        for axes in grid[-1]:
            axes.set_xlabel("step")
        return svg_of(figure, name, title)


def _legend(axes: Axes) -> None:
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="best")
