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
from pirlc.verify.findings import PropertyFinding
from pirlc.verify.properties.asking import (
    DEFAULT_LIMITS,
    Answer,
    Found,
    Limits,
    Never,
    Undecided,
    replayed,
)
from pirlc.verify.properties.deciding import answer_to, evidence_of, perturbation, prove_perturbed
from pirlc.verify.properties.obligations import obligations
from pirlc.verify.properties.ruling import holds
from pirlc.verify.replay import as_replay

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
    shown = answer if isinstance(answer, Found) else None
    running = {}
    for precision in (BINARY64, BINARY32):
        running[precision], found = in_precision(program, claim, precision, answer, limits)
        shown = shown or found
    return PropertyFinding(
        name=claim.name,
        text=term_text(claim.body),
        steps=claim.steps,
        evidence=evidence,
        binary64=running[BINARY64],
        binary32=running[BINARY32],
        counterexample=as_replay(shown.trial, shown.steps) if shown else None,
        obligations=obligations(program, claim, evidence, limits),
        seconds=time.perf_counter() - start,
        span=_broken_part(program, claim, shown) if shown else claim.span,
    )


def in_precision(
    program: Program, claim: Property, precision: Precision, exactly: Answer, limits: Limits
) -> tuple[Evidence, Found | None]:
    """The property of what runs in a precision, given the answer over exact reals."""
    match exactly:
        case Found(trial):
            found = replayed(program, claim, trial, precision)
            if found is not None:
                return REFUTED, found
            return unknown("the history that violates it over the reals does not do so here"), None
        case Undecided():
            return unknown("not known over the reals"), None
        case Never():
            pass
        case _:
            assert_never(exactly)
    off = perturbation(program, precision)
    answer = prove_perturbed(program, claim, off, limits)
    match answer:
        case Never():
            return PROVED, None
        case Found():
            return Evidence(Kind.REFUTED, "by rounding alone: it holds over the reals"), answer
        case Undecided():
            unbounded = [a.name for a in program.interface.actions if a.name not in off.raw]
            if unbounded:
                return unknown(f"no bound on the rounding of {', '.join(unbounded)}"), None
            return unknown("rounding may take more than the property leaves"), None
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
