"""One question about a property, from terms to an answer: over reals, or as far off as rounding."""

from __future__ import annotations

from fractions import Fraction
from typing import assert_never

from pirlc.ir.evidence import PROVED, REFUTED, Evidence, unknown
from pirlc.ir.policy import Program, Property
from pirlc.ir.terms import Fold, FoldLambda, Term, children, type_of
from pirlc.ir.types import Sequence
from pirlc.semantics.precision import BINARY64, Precision
from pirlc.symbolic.z3_form import GuardKey
from pirlc.verify.model import ORDINARY, Circumstances, Perturbation, unroll
from pirlc.verify.properties.asking import (
    DEFAULT_LIMITS,
    Answer,
    Found,
    Limits,
    Never,
    Undecided,
    ask,
    replayed,
)
from pirlc.verify.properties.claims import question
from pirlc.verify.properties.cone import concerned
from pirlc.verify.properties.trials import random_trials
from pirlc.verify.ranges import running_ranges
from pirlc.verify.rounding import rounding

LARGEST = 100_000
"""Operations that a model may have, over all its steps."""

_MOST_OPERATIONS = 500_000_000
"""Those of all tests together, a few seconds' worth."""


def answer_to(
    program: Program,
    claim: Property,
    limits: Limits = DEFAULT_LIMITS,
    circumstances: Circumstances = ORDINARY,
) -> Answer:
    """Proved, refuted or neither, over exact reals; tried on random histories if neither.

    (Random histories are good readings, whatever the circumstances.)
    """
    size = cost(program, claim)
    if size > LARGEST:
        answer: Answer = Undecided(f"too large for z3: {size:,} operations over the steps")
    else:
        asked = question(
            claim, unroll(program, claim.steps, circumstances, None, concerned(program, claim))
        )
        answer = ask(asked, claim, limits, BINARY64)
    if not isinstance(answer, Undecided) or circumstances != ORDINARY:
        return answer
    count = min(limits.tests, _MOST_OPERATIONS // size)
    for trial in random_trials(program, claim, count) if count else ():
        found = replayed(program, claim, trial, BINARY64)
        if found is not None:
            return found
    return Undecided(f"{answer.reason}; not violated on {count:,} histories")


def evidence_of(answer: Answer) -> Evidence:
    match answer:
        case Never():
            return PROVED
        case Found():
            return REFUTED
        case Undecided(reason):
            return unknown(reason)
        case _:
            assert_never(answer)


def perturbation(program: Program, precision: Precision) -> Perturbation:
    """How far a precision's rounding may move one step of the program."""
    (step,) = rounding(program, precision).steps
    raw = {name: Fraction(bound) for name, bound in step.raw.items() if bound is not None}
    guards = {
        GuardKey(name, number): Fraction(margin)
        for name, margins in step.margins.items()
        for number, margin in enumerate(margins)
        if margin is not None
    }
    ranges = {
        name: (Fraction(ends.low), Fraction(ends.high))
        for name, ends in running_ranges(program, precision).items()
    }
    return Perturbation(precision, raw, guards, ranges)


def prove_perturbed(
    program: Program, claim: Property, off: Perturbation, limits: Limits = DEFAULT_LIMITS
) -> Answer:
    """The property where results and guards may be off: `Never` holds for all that runs so."""
    size = cost(program, claim)
    if size > LARGEST:
        return Undecided(f"too large for z3: {size:,} operations over the steps")
    asked = question(claim, unroll(program, claim.steps, ORDINARY, off, concerned(program, claim)))
    return ask(asked, claim, limits, off.precision)


def cost(program: Program, claim: Property) -> int:
    """About how many operations the model of a property has."""
    return claim.steps * sum(map(_cost, program.bodies)) + _cost(claim.body)


def _cost(term: Term) -> int:
    below = sum(_cost(child) for child in children(term))
    match term:
        case FoldLambda(_, _, body, sequence):
            return below + _cost(body) * (_length(sequence) - 1)
        case Fold(_, sequence):
            return below + _length(sequence)
        case _:
            return below + _length(term)


def _length(term: Term) -> int:
    type_ = type_of(term)
    return type_.length if isinstance(type_, Sequence) else 1
