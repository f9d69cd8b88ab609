"""A property where windows hold something else than good readings, or actions are `safe`.

The proof speaks of full windows of good readings and of clipped results. What else there may be is
asked apart; where that is the same question, it is said why.
"""

from __future__ import annotations

from pirlc.ir.evidence import Evidence, Kind, unknown
from pirlc.ir.policy import Fill, Program, Property, Zero
from pirlc.verify.asking import Found, Limits
from pirlc.verify.deciding import answer_to, evidence_of
from pirlc.verify.findings import Obligation
from pirlc.verify.model import Circumstances, Zeros, failing_sensors, reading_range
from pirlc.verify.replay import as_replay

WARM_UP, MISSING, SAFE = "warm-up", "missing readings", "safe values"


def obligations(
    program: Program, claim: Property, evidence: Evidence, limits: Limits
) -> tuple[Obligation, ...]:
    """The obligations beside a property's proof; where there is none they are left open."""
    found = [_warm_up(program, claim, evidence, limits)]
    zero = [s.name for s in program.interface.sensors if isinstance(s.missing, Zero)]
    if zero:
        outside = _without_zero(program, zero)
        if outside:
            allowed = Circumstances(zeros=dict.fromkeys(outside, Zeros.ANY))
            found.append(_asked(MISSING, program, claim, evidence, allowed, limits))
        else:
            reason = "zero is a reading in the range"
            found.append(_covered(MISSING, evidence, reason))
    failing = failing_sensors(program)
    if failing:
        allowed = Circumstances(failing=True)
        found.append(_asked(SAFE, program, claim, evidence, allowed, limits))
    return tuple(found)


def _warm_up(program: Program, claim: Property, evidence: Evidence, limits: Limits) -> Obligation:
    names = [sensor.name for sensor in program.interface.sensors]
    match program.interface.fill:
        case Fill.FIRST if claim.steps == 1 or not names:
            return _covered(
                WARM_UP,
                evidence,
                "a window of one reading over again, or of the middle of the range, is a history",
            )
        case Fill.FIRST:
            # The first good reading may come late, and fills the window at one go.
            return _asked(WARM_UP, program, claim, evidence, Circumstances(late=True), limits)
        case Fill.ZERO:
            outside = _without_zero(program, names)
            if not outside:
                return _covered(WARM_UP, evidence, "zero is a reading in the range")
            allowed = Circumstances(zeros=dict.fromkeys(outside, Zeros.FIRST))
            return _asked(WARM_UP, program, claim, evidence, allowed, limits)


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
