"""How a program was found, from the record of every program that the search met."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pirlc.diagnostics import PirlcError
from pirlc.frontend import parse_sketch
from pirlc.ir.policy import FixedParameter, Program, Sketch
from pirlc.ir.printer import parameter_text, term_text
from pirlc.report.plots import lowest_shown
from pirlc.search.candidate import Entry, from_entry
from pirlc.source import SourceText

Entries = Sequence[Mapping[str, Any]]


def search_data(
    entries: Entries, asked: Mapping[str, Any], manifest: Mapping[str, Any], sketch: str | None
) -> dict[str, Any]:
    """Return against size, distance against iteration, and the best programs of each size."""
    with_oracle = asked.get("oracle") is not None
    simulated = [entry for entry in entries if entry["mean_return"] is not None]
    enough = _enough(simulated, asked["settings"]["episodes"])
    records = _records(enough)
    parsed = _parsed(sketch)
    lowest = lowest_shown([entry["mean_return"] for entry in simulated])
    return {
        "with_oracle": with_oracle,
        "tuned": sum(entry["stage"].startswith("tune") for entry in entries),
        "simulated": len(simulated),
        "calls": manifest.get("calls_of_search"),
        "seconds": manifest.get("seconds_of_search"),
        "optimizer": _optimizer(manifest.get("optimizer")),
        "points": [
            {key: entry[key] for key in ("stage", "size", "mean_return", "episodes")}
            for entry in simulated
        ],
        "lowest_shown": lowest if math.isfinite(lowest) else None,
        "below": sum(entry["mean_return"] < lowest for entry in simulated),
        "iterations": _iterations(entries) if with_oracle else [],
        "by_size": _by_size(entries, enough, records, with_oracle),
        "records": [_record(entry, parsed, with_oracle) for entry in records],
    }


def _optimizer(choice: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Which optimiser tuned, why, and the mean distances that decided, the least first."""
    if choice is None:
        return None
    distances = choice["mean_distances"]
    return {
        "chosen": choice["chosen"],
        "why": choice["why"],
        "distances": [
            {"optimizer": name, "distance": distances[name]}
            for name in sorted(distances, key=lambda name: (distances[name], name))
        ],
    }


def _enough(simulated: Entries, episodes: int) -> Entries:
    """Those simulated on so many episodes that chance does not choose the best of them."""
    return [entry for entry in simulated if entry["episodes"] >= episodes] or simulated


def _records(entries: Entries) -> Entries:
    """Those with a higher return than every shorter one, shortest first."""
    found: list[Mapping[str, Any]] = []
    for entry in sorted(entries, key=lambda e: (e["size"], -e["mean_return"], -e["episodes"])):
        if not found or entry["mean_return"] > found[-1]["mean_return"]:
            found.append(entry)
    return found


def _iterations(entries: Entries) -> list[dict[str, Any]]:
    """Of each turn of Algorithm 1: the distances of all that were tuned in it, and which program
    it chose by return."""
    tuned: dict[str, list[float]] = defaultdict(list)
    chosen: dict[str, Mapping[str, Any]] = {}
    for entry in entries:
        stage = entry["stage"]
        if stage.startswith("tune (") and entry["loss"] is not None:
            tuned[stage[len("tune (") : -1]].append(entry["loss"])
        elif entry["mean_return"] is not None and (
            stage not in chosen or entry["mean_return"] > chosen[stage]["mean_return"]
        ):
            chosen[stage] = entry
    return [
        {
            "stage": stage,
            "tuned": len(losses),
            "distances": sorted(losses),
            "closest": min(losses),
            "chosen": chosen[stage]["loss"] if stage in chosen else None,
            "chosen_size": chosen[stage]["size"] if stage in chosen else None,
            "chosen_return": chosen[stage]["mean_return"] if stage in chosen else None,
        }
        for stage, losses in tuned.items()
    ]


def _by_size(
    entries: Entries, simulated: Entries, records: Entries, with_oracle: bool
) -> list[dict[str, Any]]:
    met: dict[int, list[Mapping[str, Any]]] = defaultdict(list)
    for entry in entries:
        met[entry["size"]].append(entry)
    rows = []
    for size in sorted(met):
        best = max(
            (entry for entry in simulated if entry["size"] == size),
            key=lambda e: (e["mean_return"], e["episodes"]),
            default=None,
        )
        losses = [e["loss"] for e in met[size] if e["loss"] is not None]
        rows.append(
            {
                "size": size,
                "met": sum(e["stage"].startswith("tune") for e in met[size]),
                "closest": min(losses, default=None) if with_oracle else None,
                "mean_return": best and best["mean_return"],
                "episodes": best and best["episodes"],
                "record": any(entry["size"] == size for entry in records),
            }
        )
    return rows


def _record(entry: Mapping[str, Any], sketch: Sketch | None, with_oracle: bool) -> dict[str, Any]:
    return {
        "size": entry["size"],
        "mean_return": entry["mean_return"],
        "episodes": entry["episodes"],
        "distance": entry["loss"] if with_oracle else None,
        "stage": entry["stage"],
        "program": None if sketch is None else _text_of(sketch, entry),
    }


def _parsed(text: str | None) -> Sketch | None:
    try:
        return None if text is None else parse_sketch(SourceText("sketch.pirl", text))
    except PirlcError:
        return None


def _text_of(sketch: Sketch, entry: Mapping[str, Any]) -> str:
    """The actions, and their parameters to four significant digits: short enough to compare."""
    plain: Entry = {
        "stage": entry["stage"],
        "size": entry["size"],
        "loss": None,
        "mean_return": None,
        "episodes": 0,
        "values": entry["values"],
        "derivations": entry["derivations"],
    }
    program = from_entry(sketch, plain).program
    return "\n".join([*_actions(program), *_parameters(program.parameters)])


def _actions(program: Program) -> Iterable[str]:
    for action, body in zip(program.interface.actions, program.bodies, strict=True):
        yield f"action {action.name} = {term_text(body)}"


def _parameters(parameters: Sequence[FixedParameter]) -> Iterable[str]:
    for parameter in parameters:
        yield parameter_text(FixedParameter(parameter.name, float(f"{parameter.value:.4g}")))
