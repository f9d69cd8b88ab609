"""Properties proved by z3 over all histories, or refuted with a history that replays.

A property is asked of exact real arithmetic first. Then what runs: bounds on rounding
(`rounding`) let results and guards be off by that much, and the same question is asked again. What
z3 leaves undecided is tried on many histories.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import assert_never

from pirlc.ir.evidence import PROVED, REFUTED, Evidence, Kind, unknown
from pirlc.ir.operators import Operator
from pirlc.ir.policy import Program, Property
from pirlc.ir.printer import term_text
from pirlc.ir.terms import Apply, Term
from pirlc.semantics.precision import BINARY32, BINARY64, Precision
from pirlc.source import Span
from pirlc.verify.asking import DEFAULT_LIMITS, Found, Limits, Never, Undecided, replayed
from pirlc.verify.deciding import answer_to, evidence_of, perturbation, prove_perturbed
from pirlc.verify.findings import PropertyFinding
from pirlc.verify.obligations import obligations
from pirlc.verify.replay import Trial, as_replay
from pirlc.verify.ruling import holds

__all__ = ["Limits", "prove", "prove_one", "prove_perturbed"]


def prove(program: Program, limits: Limits = DEFAULT_LIMITS) -> tuple[PropertyFinding, ...]:
    """What is known of each property of the program, in its order."""
    return tuple(prove_one(program, claim, limits) for claim in program.properties)


def prove_one(
    program: Program, claim: Property, limits: Limits = DEFAULT_LIMITS
) -> PropertyFinding:
    """What is known of one property."""
    start = time.perf_counter()
    answer = answer_to(program, claim, limits)
    evidence = evidence_of(answer)
    counterexample, span = None, claim.span
    if isinstance(answer, Found):
        counterexample = as_replay(answer.trial, answer.steps)
        span = _broken_part(program, claim, answer)
    trial = answer.trial if isinstance(answer, Found) else None
    return PropertyFinding(
        name=claim.name,
        text=term_text(claim.body),
        steps=claim.steps,
        evidence=evidence,
        binary64=in_precision(program, claim, BINARY64, evidence, trial, limits),
        binary32=in_precision(program, claim, BINARY32, evidence, trial, limits),
        counterexample=counterexample,
        obligations=obligations(program, claim, evidence, limits),
        seconds=time.perf_counter() - start,
        span=span,
    )


def in_precision(
    program: Program,
    claim: Property,
    precision: Precision,
    exactly: Evidence,
    trial: Trial | None,
    limits: Limits,
) -> Evidence:
    """The property of what runs in a precision; `trial` violates it in binary64."""
    if trial is not None:
        if replayed(program, claim, trial, precision) is not None:
            return REFUTED
        return unknown("refuted over the reals, by a history that is none in this precision")
    if exactly.kind is not Kind.PROVED:
        return unknown("not known over the reals")
    off = perturbation(program, precision)
    answer = prove_perturbed(program, claim, off, limits)
    match answer:
        case Never():
            return PROVED
        case Found():
            return replace(REFUTED, reason="by rounding alone: it holds over the reals")
        case Undecided():
            unbounded = [a.name for a in program.interface.actions if a.name not in off.raw]
            if unbounded:
                return unknown(f"no bound on the rounding of {', '.join(unbounded)}")
            return unknown("rounding may take more than the property leaves")
        case _:
            assert_never(answer)


def _broken_part(program: Program, claim: Property, found: Found) -> Span:
    """Where the property says what is not so: the narrowest part of its conjunctions."""
    part: Term = claim.body
    while isinstance(part, Apply) and part.operator in (Operator.AND, Operator.IMPLIES):
        sides = part.arguments if part.operator is Operator.AND else part.arguments[1:]
        part = next(
            side for side in sides if not holds(program, replace(claim, body=side), found.steps)
        )
    return part.span
