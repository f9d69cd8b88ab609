"""A run's folder as the data of its page: everything that the page shows, and nothing that it does
not have. What is missing is said.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import pirlc
from pirlc.diagnostics import PirlcError
from pirlc.frontend import parse_sketch
from pirlc.ir.policy import Environment, Interface
from pirlc.ir.printer import environment_text
from pirlc.report.front_table import front_page
from pirlc.report.omissions import left_out
from pirlc.report.page_plots import MOST_STEPS
from pirlc.report.page_search import search_data
from pirlc.report.run import ANALYSIS, FRONT, READING, TRACES, VERIFICATION
from pirlc.report.stored import Stored, understanding
from pirlc.report.verdict import verdict
from pirlc.report.words import interval
from pirlc.source import SourceText

FORMAT = 1

_STATES = {
    "finished": "The search went to its end.",
    "budget used up": "The search used up its budget before its end; the program is the best that "
    "it had met.",
    "timeout": "The search used up its budget before it had any program. The same `pirlc synth` "
    "command with a larger one goes on from here.",
    "interrupted": "The run was interrupted; the program is the best that it had met. The same "
    "`pirlc synth` command goes on from here.",
    "running": "The run has not ended: it is still going, or was broken off. The same `pirlc "
    "synth` command goes on from here.",
}


_NOTHING = (
    "The run was interrupted before it had any program. The same `pirlc synth` command goes on "
    "from here."
)


def page_data(stored: Stored) -> dict[str, Any]:
    """The data of the page, as plain values for JSON. Raises PirlcError E0741."""
    manifest = stored.manifest
    with understanding("manifest.json"):
        returns = _returns(manifest)
        program = _program(stored)
        head = _head(stored, program)
        resources = _resources(stored)
    search = None
    if stored.candidates:
        with understanding("candidates.jsonl"):
            search = search_data(stored.candidates, manifest["asked"], manifest, stored.sketch)
    with understanding(VERIFICATION):
        verification = None if stored.verification is None else _verification(stored.verification)
    with understanding(ANALYSIS):
        head["verdict"] = verdict(
            returns, verification, stored.analysis, with_program=program is not None
        )
    with understanding(READING):
        reading = None if stored.reading is None else {"sections": stored.reading["sections"]}
    with understanding(FRONT):
        front = None if stored.front is None else front_page(stored.front)
    return {
        "format": FORMAT,
        "head": head,
        "missing": list(_missing(stored, program, returns, search)),
        "program": program,
        "reading": reading,
        "returns": returns,
        "front": front,
        "search": search,
        "traces": stored.traces,
        "limits": _limits(stored.traces),
        "verification": verification,
        "analysis": stored.analysis,
        "resources": resources,
        "sketch": stored.sketch,
    }


def _interface(stored: Stored) -> Interface | None:
    for text in (stored.program_file, stored.sketch):
        try:
            if text is not None:
                return parse_sketch(SourceText("sketch.pirl", text)).interface
        except PirlcError:
            continue
    return None


def _head(stored: Stored, program: Mapping[str, Any] | None) -> dict[str, Any]:
    manifest, asked = stored.manifest, stored.manifest["asked"]
    interface = _interface(stored)
    state = str(manifest["state"])
    return {
        "policy": stored.folder.resolve().name if interface is None else interface.name,
        "environment": _environment(manifest, interface),
        "state": state,
        "state_words": _STATES.get(state, "") if program or state != "interrupted" else _NOTHING,
        "verdict": [],
        "pirlc": manifest.get("versions", {}).get("pirlc", pirlc.__version__),
        "seed": asked["settings"]["seed"],
        "oracle": _oracle(manifest),
        "left_out": list(left_out(asked.get("oracle"), asked.get("plan", {}))),
        "sketch_sha256": asked["sketch"],
        "program_sha256": None if program is None else program["sha256"],
    }


def _environment(manifest: Mapping[str, Any], interface: Interface | None) -> str | None:
    known = manifest.get("environment")
    if known is not None:
        environment = Environment(known["id"], tuple(known["arguments"].items()))
    elif interface is not None and interface.environment is not None:
        given = tuple(manifest["asked"].get("arguments", {}).items())
        environment = interface.environment.with_arguments(given)
    else:
        return None
    return " ".join(environment_text(environment).removeprefix("environment ").split())


def _oracle(manifest: Mapping[str, Any]) -> str:
    known, origin = manifest.get("oracle"), manifest.get("oracle_from")
    if known is not None:
        trained = f"{known['algorithm']}, seed {known['seed']}"
        weights = known["weights_sha256"][:12]
        weighed = f"{trained}, weights {weights}" if weights else trained
        return weighed if origin in (None, "trained") else f"{origin} ({weighed})"
    if manifest["asked"].get("oracle") is None:
        return "none: the search went by simulated return alone"
    if manifest["state"] == "running":
        return "not recorded before the end of a run"
    return str(origin or "a given one")


def _program(stored: Stored) -> dict[str, Any] | None:
    known = stored.manifest.get("program")
    if known is None:
        return None
    return {
        "text": known["text"],
        "size": known["size"],
        "sha256": known["sha256"],
        "distance": known["loss"] if stored.manifest["asked"].get("oracle") is not None else None,
        "parameters": [{"name": k, "value": v} for k, v in known["values"].items()],
    }


_ABOUT = {
    "program": "the program, run by the reference interpreter",
    "emitted C": "the C made from it, compiled",
    "oracle": "the neural network that the search imitated",
    "without refinement": "what the imitation alone found, before parameters were refined on "
    "return",
}


def _returns(manifest: Mapping[str, Any]) -> dict[str, Any] | None:
    evaluation = manifest.get("evaluation")
    if evaluation is None or not evaluation["returns"]:
        return None
    first = evaluation["first_seed"]
    return {
        "first_seed": first,
        "subjects": [
            {
                "name": name,
                "about": _ABOUT.get(name, ""),
                **{key: _finite(found[key]) for key in ("mean", "low", "high", "std")},
                "episodes": found["episodes"],
                "interval": interval(found),
                "last_seed": first + found["episodes"] - 1,
            }
            for name, found in evaluation["returns"].items()
        ],
    }


def _finite(value: float | str) -> float | None:
    return None if isinstance(value, str) else value


def _verification(found: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "properties": len(found["properties"]),
        "proved": {
            arithmetic: sum(p[arithmetic]["kind"] == "proved" for p in found["properties"])
            for arithmetic in ("evidence", "binary64", "binary32")
        },
        "found": found,
    }


_COSTS = re.compile(
    r"State: (?P<bytes>\d+) bytes.*?"
    r"step: (?P<operations>\d+) operations.*?and (?P<checks>\d+) that",
    re.DOTALL,
)
"""In the comment at the head of an emitted C header."""


def _resources(stored: Stored) -> dict[str, Any]:
    manifest = stored.manifest
    oracle = manifest.get("oracle") or {}
    costs = None if stored.header is None else _COSTS.search(stored.header)
    return {
        "operations": costs and int(costs["operations"]),
        "checks": costs and int(costs["checks"]),
        "state_bytes": costs and int(costs["bytes"]),
        "files": [{"path": path, "bytes": size} for path, size in stored.emitted],
        "search_seconds": manifest.get("seconds_of_search"),
        "search_calls": manifest.get("calls_of_search"),
        "oracle_seconds": oracle.get("seconds"),
        "oracle_steps": oracle.get("steps"),
        "versions": [
            {"name": name, "version": version}
            for name, version in manifest.get("versions", {}).items()
        ],
    }


def _limits(traces: Mapping[str, Any] | None) -> dict[str, Any]:
    """Where a plot shows less than there is."""
    with understanding(TRACES):
        cut = traces is not None and traces["steps"] > MOST_STEPS
    return {"trace_steps": MOST_STEPS, "traces_cut": cut}


def _missing(
    stored: Stored,
    program: Mapping[str, Any] | None,
    returns: Mapping[str, Any] | None,
    search: Mapping[str, Any] | None,
) -> Iterator[str]:
    if search is None:
        yield "No program has been recorded: the search has not met any yet."
    if program is None:
        yield "There is no program yet, so nothing can be said about one."
    elif returns is None:
        yield "Returns were not measured: the run ended before its evaluation."
    if stored.traces is None:
        yield f"There are no action traces: {_where(stored, TRACES)}."
    if stored.verification is None:
        yield (
            f"Nothing is proved here: {_where(stored, VERIFICATION)}. `pirlc verify` proves the "
            "properties of a program by itself."
        )
    if stored.reading is None:
        yield (
            f"The program is not told in words: {_where(stored, READING)}. `pirlc explain-program` "
            "does so for a program by itself."
        )
    if stored.analysis is None:
        yield (
            f"No control-theory figures: {_where(stored, ANALYSIS)}. `pirlc analyze` finds them "
            "for a program by itself."
        )


def _where(stored: Stored, name: str) -> str:
    if name in stored.others:
        return f"`{name}` is about another program, which this run had before"
    return f"`{name}` is not there; it is written at the end of `pirlc synth`"
