"""What a run comes to, in a line for each kind of evidence."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from pirlc.analyze.findings import WEAK
from pirlc.report.words import counted, in_interval

Data = Mapping[str, Any]


def verdict(
    returns: Data | None, verification: Data | None, analysis: Data | None, *, with_program: bool
) -> list[dict[str, str]]:
    """Sentences, each with what it is `about` and a `mark`: good, bad, open (not known), linear
    (holds for the linearisation), or plain (a figure, no claim)."""
    if not with_program:
        return [_said("program", "open", "No program has been found yet.")]
    lines = [
        _of_returns(returns),
        *([] if verification is None else _of_proofs(verification)),
        *([] if analysis is None else _of_loops(analysis)),
    ]
    if verification is None:
        lines.append(
            _said("proofs", "open", "No property has been proved: verification has not been run.")
        )
    return lines


def _said(about: str, mark: str, text: str) -> dict[str, str]:
    return {"about": about, "mark": mark, "text": text}


def _of_returns(returns: Data | None) -> dict[str, str]:
    if returns is None:
        return _said("returns", "open", "The return has not been measured on unseen episodes.")
    known = {subject["name"]: subject for subject in returns["subjects"]}
    program, oracle = known["program"], known.get("oracle")
    episodes = counted(program["episodes"], "unseen episode")
    text = f"Return over {episodes}: {in_interval(program)}"
    if oracle is not None:
        text += f". The oracle's: {in_interval(oracle)}"
    return _said("returns", "plain", text + ".")


def _of_proofs(verification: Data) -> Iterator[dict[str, str]]:
    found = verification["found"]
    properties = found["properties"]
    if properties:
        yield _of_properties(verification["proved"], properties)
    else:
        yield _said("proofs", "plain", "The program states no property to prove.")
    emitted = found["emitted"]
    if emitted:
        kinds = [e["evidence"]["kind"] for e in emitted]
        words = ", ".join(f"{e['evidence']['words']} for {e['real']}" for e in emitted)
        same = "That the emitted C equals the program, for all inputs and states, is"
        yield _said("emitted", _mark(kinds), f"{same} {words}.")


def _of_properties(proved: Data, properties: list[Data]) -> dict[str, str]:
    """Arithmetic that runs counts as much as real arithmetic."""
    text = (
        f"Properties proved: {proved['evidence']} of {len(properties)} in real arithmetic, "
        f"{proved['binary64']} in binary64, {proved['binary32']} in binary32"
    )
    kinds = [p[one]["kind"] for p in properties for one in ("evidence", "binary64", "binary32")]
    refuted = [
        p["name"]
        for p in properties
        if "refuted" in (p["evidence"]["kind"], p["binary64"]["kind"], p["binary32"]["kind"])
    ]
    text += f". Refuted: {', '.join(refuted)}." if refuted else "."
    return _said("proofs", _mark(kinds), text)


def _mark(kinds: list[str]) -> str:
    if "refuted" in kinds:
        return "bad"
    return "good" if all(kind == "proved" for kind in kinds) else "open"


def _of_loops(analysis: Data) -> Iterator[dict[str, str]]:
    """The loops in force at the operating point; what others are is told, but no verdict."""
    active = {leaf["name"] for leaf in analysis["leaves"] if leaf["active"]}
    loops = [loop for loop in analysis["loops"] if loop["leaf"] in active]
    others = [loop for loop in analysis["loops"] if loop["leaf"] not in active]
    if not analysis["loops"]:
        return
    stable = sum(loop["stable"] for loop in loops)
    text = f"Linearised loops in force at the operating point: {stable} of {len(loops)} stable"
    margins = [loop["margins"] for loop in loops if loop["margins"] is not None]
    if margins:
        least = {
            name: min(float(m[name]) for m in margins)
            for name in ("gain_up", "phase", "delay_samples")
        }
        text += (
            f"; smallest margins: gain {_factor(least['gain_up'])}, phase "
            f"{_amount(least['phase'], 'degrees')}, delay "
            f"{_amount(least['delay_samples'], 'samples')}"
        )
    if others:
        stable_others = sum(loop["stable"] for loop in others)
        text += f". Of leaves that are not taken there: {stable_others} of {len(others)} stable"
    mark = "linear" if loops and stable == len(loops) else "bad"
    plant = analysis["plant"]
    fits = [] if plant is None else [float(fit) for fit in plant["fit"].values()]
    if fits and min(fits) < WEAK:
        text += f". The identified plant explains as little as {min(fits):.0f} % of a reading"
        mark = "open"
    yield _said("loops", mark, text + ".")


def _factor(value: float) -> str:
    return f"times {value:.3g}" if math.isfinite(value) else "unlimited"


def _amount(value: float, unit: str) -> str:
    return f"{value:.3g} {unit}" if math.isfinite(value) else "unlimited"
