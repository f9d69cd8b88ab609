"""Asking z3 one question: is a property violated in a model, and what is the history?

z3 answers over the reals. `Found` is a history that the interpreter was seen to violate the
property on; everything short of that is told in words.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

import z3

from pirlc.ir.policy import Program, Property
from pirlc.semantics.precision import Precision
from pirlc.symbolic import z3_terms as exact
from pirlc.verify.properties.claims import Question
from pirlc.verify.properties.ruling import holds
from pirlc.verify.properties.trials import trials_of
from pirlc.verify.replay import Observed, Trial, run


@dataclass(frozen=True)
class Limits:
    """`work` is z3's own measure of what one question may cost, so that the same question gets the
    same answer; a million is a few seconds. `seconds` (None: no limit) depends on the machine.
    `tests` is the number of histories that undecided properties are tried on."""

    work: int = 2_000_000
    seconds: float | None = None
    tests: int = 10_000


DEFAULT_LIMITS = Limits()


@dataclass(frozen=True)
class Never:
    """No history violates the property."""


@dataclass(frozen=True)
class Found:
    """The interpreter violates the property on this trial, in this precision."""

    trial: Trial
    steps: tuple[Observed, ...]
    precision: Precision


@dataclass(frozen=True)
class Undecided:
    reason: str


Answer = Never | Found | Undecided

_SLACKS = (Fraction(1, 3), *(Fraction(1, 10**n) for n in (1, 2, 3, 4, 5, 6, 8, 10, 12)))

_SHARES = (Fraction(0), Fraction(1, 1000), Fraction(1, 30), Fraction(1, 3))


def ask(asked: Question, claim: Property, limits: Limits, precision: Precision) -> Answer:
    """Whether some history of the model violates the property, replayed in the precision."""
    model = asked.model
    solver = model.solver(limits.work)
    if limits.seconds is not None:
        solver.set("timeout", max(1, round(limits.seconds * 1000)))
    solver.add(asked.slack >= 0)
    match _check(solver, asked.wrong):
        case z3.unsat:
            return Never()
        case z3.unknown:
            return Undecided(_reason(solver, limits))
        case _:
            pass
    # What makes a counterexample a good one is worth less than knowing that there is one.
    solver.set("rlimit", max(1, limits.work // 10))
    for trial in _models(solver, asked):
        found = replayed(model.program, claim, trial, precision)
        if found is not None:
            return found
    return Undecided(_short(solver, asked, limits))


def replayed(program: Program, claim: Property, trial: Trial, precision: Precision) -> Found | None:
    """What the interpreter does on a trial, if that violates the property."""
    steps = run(program, trial, precision)
    return None if holds(program, claim, steps) else Found(trial, steps, precision)


def _check(solver: z3.Solver, *conditions: exact.Truth) -> z3.CheckSatResult:
    solver.push()
    try:
        solver.add(*conditions)
        return solver.check()
    finally:
        solver.pop()


def _models(solver: z3.Solver, asked: Question) -> Iterator[Trial]:
    """Violations, the most promising first: numbers rounded to floats may lose the others.

    Over the reals those with the most room; with rounding those that need the least of it.
    """
    hints: list[tuple[exact.Truth, ...]]
    if asked.model.scale is None:
        hints = [(exact.equal(asked.slack, slack), asked.clear) for slack in _SLACKS]
    else:
        hints = [(exact.equal(asked.model.scale, s), asked.violated) for s in _SHARES]
    for conditions in (*hints, (asked.violated,), (asked.undefined,)):
        solver.push()
        solver.add(*conditions)
        if solver.check() == z3.sat:
            yield from trials_of(asked.model, solver.model())
        solver.pop()


def _short(solver: z3.Solver, asked: Question, limits: Limits) -> str:
    """Why a question with an answer over the reals has no counterexample."""
    if asked.undefined is not False:
        match _check(solver, asked.violated):
            case z3.unsat:
                return "a division by zero or the root of a negative number is possible"
            case z3.unknown:
                return _reason(solver, limits)
    if asked.model.functions.axioms:
        return "z3 knows sqrt, exp and tanh by bounds only, and what it found does not replay"
    return "violated in exact arithmetic, but on no history that binary64 numbers replay"


def _reason(solver: z3.Solver, limits: Limits) -> str:
    reason = solver.reason_unknown()
    if "timeout" in reason or ("cancel" in reason and limits.seconds is not None):
        return f"z3's limit of {limits.seconds:g} s reached"
    if "resource" in reason or "cancel" in reason:
        return f"z3's limit of {limits.work:,} units of work reached"
    return f"z3 does not know: {reason}"
