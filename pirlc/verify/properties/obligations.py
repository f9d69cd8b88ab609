"""A property where windows hold something else than good readings, or actions are `safe`.

The proof speaks of full windows of good readings and of clipped results. What else there may be is
asked apart; where that is the same question, it is said why. Each allows what those before it do
as well, so that the last one allows everything at once.
"""

from __future__ import annotations

from dataclasses import replace

from pirlc.ir.evidence import Evidence, Kind, unknown
from pirlc.ir.policy import Fill, Program, Property, Zero
from pirlc.verify.findings import Obligation
from pirlc.verify.model import (
    ORDINARY,
    Circumstances,
    Zeros,
    failing_sensors,
    reading_range,
)
from pirlc.verify.properties.asking import Found, Limits
from pirlc.verify.properties.deciding import answer_to, evidence_of
from pirlc.verify.replay import as_replay

WARM_UP, MISSING, SAFE = "warm-up", "missing readings", "safe values"


def obligations(
    program: Program, claim: Property, evidence: Evidence, limits: Limits
) -> tuple[Obligation, ...]:
    """The obligations beside a property's proof; where there is none they are left open."""
    allowed = _starts(program, claim)
    found = [_warm_up(program, claim, evidence, allowed, limits)]
    zero = [s.name for s in program.interface.sensors if isinstance(s.missing, Zero)]
    outside = _without_zero(program, zero)
    if outside:
        zeros = {**allowed.zeros, **dict.fromkeys(outside, Zeros.ANY)}
        allowed = replace(allowed, zeros=zeros)
        found.append(_asked(MISSING, program, claim, evidence, allowed, limits))
    elif zero:
        found.append(_covered(MISSING, evidence, "zero is a reading in the range"))
    if failing_sensors(program):
        allowed = replace(allowed, failing=True)
        found.append(_asked(SAFE, program, claim, evidence, allowed, limits))
    return tuple(found)


def _starts(program: Program, claim: Property) -> Circumstances:
    """What windows may hold before they are full of good readings, beside such readings."""
    names = [sensor.name for sensor in program.interface.sensors]
    match program.interface.fill:
        case Fill.FIRST:
            # The first good reading may come late, and fills the window at one go; in one step
            # that is a window of one reading over again.
            return Circumstances(late=claim.steps > 1 and bool(names))
        case Fill.ZERO:
            return Circumstances(zeros=dict.fromkeys(_without_zero(program, names), Zeros.FIRST))


def _warm_up(
    program: Program,
    claim: Property,
    evidence: Evidence,
    allowed: Circumstances,
    limits: Limits,
) -> Obligation:
    if allowed != ORDINARY:
        return _asked(WARM_UP, program, claim, evidence, allowed, limits)
    match program.interface.fill:
        case Fill.FIRST:
            reason = (
                "a window of one reading over again, or of the middle of the range, is a history"
            )
        case Fill.ZERO:
            reason = "zero is a reading in the range"
    return _covered(WARM_UP, evidence, reason)


def _without_zero(program: Program, names: list[str]) -> list[str]:
    ranges = {name: reading_range(program, name) for name in names}
    return [name for name, (low, high) in ranges.items() if not low <= 0 <= high]


def _covered(name: str, evidence: Evidence, reason: str) -> Obligation:
    if evidence.kind is Kind.PROVED:
        return Obligation(name, Evidence(Kind.PROVED, reason))
    return Obligation(name, _open(evidence))


def _open(evidence: Evidence) -> Evidence:
    return unknown(f"the property is {evidence.kind.value} without it")


def _asked(
    name: str,
    program: Program,
    claim: Property,
    evidence: Evidence,
    allowed: Circumstances,
    limits: Limits,
) -> Obligation:
    if evidence.kind is not Kind.PROVED:
        return Obligation(name, _open(evidence))
    answer = answer_to(program, claim, limits, allowed)
    shown = as_replay(answer.trial, answer.steps) if isinstance(answer, Found) else None
    return Obligation(name, evidence_of(answer), shown)
