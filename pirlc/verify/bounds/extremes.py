"""Suprema of piecewise linear terms over a model: exact, each checked by the solver.

z3's optimiser proposes the value. It counts only where the plain solver then proves that nothing is
larger, and shows a history that reaches it, or comes as near as 1e-30 where it is not attained.
A history is turned into readings that a sensor can give, floats, by asking for one that stays clear
of every guard; the value there is computed again, exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction

import z3

from pirlc.ir.evidence import PROVED, Evidence, unknown
from pirlc.ir.policy import Continuous
from pirlc.semantics.precision import BINARY64
from pirlc.symbolic import z3_terms as exact
from pirlc.symbolic.z3_form import GuardKey
from pirlc.symbolic.z3_terms import Real, Term, Truth
from pirlc.verify.exact import NotRational
from pirlc.verify.findings import Extreme, Replay
from pirlc.verify.model import Model
from pirlc.verify.properties.asking import Limits
from pirlc.verify.replay import Trial, as_replay, near_reading, run

CLOSE = Fraction(1, 10**9)
"""How near a witness comes to a supremum."""

_PATIENCE = 1.0
"""Seconds for one nonlinear question."""

_HAIR = Fraction(1, 10**30)
ROOMS = (Fraction(1, 10**6), Fraction(1, 10**9), Fraction(1, 10**12), Fraction(1, 10**14))
"""How far a witness is asked to stay from where guards turn."""


Measure = Callable[[Trial], Fraction]
"""The exact value of what is maximised, on a history of floats. May raise `NotRational`."""


@dataclass(frozen=True)
class Supremum:
    """`value` is None where nothing satisfies the conditions, or nothing was found (`evidence`)."""

    value: Fraction | None
    attained: bool
    evidence: Evidence
    trial: Trial | None


def supremum(
    model: Model,
    term: Real,
    where: Sequence[Truth],
    measure: Measure,
    limits: Limits,
    turning: GuardKey | None = None,
) -> Supremum:
    """The supremum of a linear term (with choices) over a model's histories.

    `turning` is the guard on whose boundary they are, if they are on one.
    """
    solver = limited(model, limits)
    solver.add(*(exact.as_term(w, model.context) for w in where))
    value, evidence = greatest(model, solver, term, where, limits)
    if value is None:
        return Supremum(None, False, evidence, None)
    attained, reached = _reached(solver, term, value)
    if reached is None:
        return Supremum(None, False, unknown("z3's optimiser and its solver disagree"), None)
    rooms = [settled(model, room, turning, idle=idle) for room in ROOMS for idle in (True, False)]
    solver.set("rlimit", max(1, limits.work // 10))
    trial = _clear_of_guards(model, solver, term, value, reached, measure, rooms)
    return Supremum(value, attained, PROVED, trial)


def greatest(
    model: Model, solver: z3.Solver, term: Real, where: Sequence[Truth], limits: Limits
) -> tuple[Fraction | None, Evidence]:
    """The supremum, which nothing exceeds; or None, and why."""
    possible = solver.check()
    if possible != z3.sat:
        reason = "no history satisfies the conditions" if possible == z3.unsat else why(solver)
        return None, PROVED if possible == z3.unsat else unknown(reason)
    if isinstance(term, Fraction):
        return term, PROVED
    optimiser = z3.Optimize(ctx=model.context)
    optimiser.set("rlimit", limits.work)
    optimiser.add(*model.constraints, *model.functions.axioms)
    optimiser.add(*(exact.as_term(w, model.context) for w in where))
    goal = optimiser.maximize(term)
    if optimiser.check() != z3.sat:
        return None, unknown(optimiser.reason_unknown())
    infinite, value, _ = map(_numeral, optimiser.upper_values(goal))
    if infinite != 0 or value is None:
        return None, unknown("z3's optimiser found no finite value")
    found = value
    beyond = _ask(solver, term > exact.number(found, model.context))
    if beyond == z3.unsat:
        return found, PROVED
    if beyond == z3.sat:
        return None, unknown("z3's optimiser and its solver disagree")
    return None, unknown(why(solver))


def _numeral(value: Term) -> Fraction | None:
    """z3's optimiser answers with integers and with rationals."""
    if z3.is_int_value(value):
        return Fraction(value.as_long())
    return exact.fraction(value) if z3.is_rational_value(value) else None


def limited(model: Model, limits: Limits) -> z3.Solver:
    """A solver with the model's constraints, under the limits.

    z3's count of its work says little of nonlinear questions, which get some time at most.
    """
    solver = model.solver(limits.work)
    seconds = limits.seconds
    if model.functions.nonlinear:
        seconds = min(_PATIENCE, seconds or _PATIENCE)
    if seconds is not None:
        solver.set("timeout", max(1, round(seconds * 1000)))
    return solver


def why(solver: z3.Solver) -> str:
    """Why there was no answer."""
    reason = solver.reason_unknown()
    if any(word in reason for word in ("resource", "timeout", "cancel")):
        return "z3's limit reached"
    return f"z3 does not know: {reason}"


def _ask(solver: z3.Solver, *conditions: Truth) -> z3.CheckSatResult:
    solver.push()
    solver.add(*conditions)
    answer = solver.check()
    solver.pop()
    return answer


def _model_of(solver: z3.Solver, *conditions: Truth) -> z3.ModelRef | None:
    solver.push()
    solver.add(*conditions)
    found = solver.model() if solver.check() == z3.sat else None
    solver.pop()
    return found


def _reached(solver: z3.Solver, term: Real, value: Fraction) -> tuple[bool, z3.ModelRef | None]:
    if isinstance(term, Fraction):
        return True, _model_of(solver)
    at = _model_of(solver, term == exact.number(value, term.ctx))
    if at is not None:
        return True, at
    return False, _model_of(solver, term > exact.number(value - _HAIR, term.ctx))


def _clear_of_guards(
    model: Model,
    solver: z3.Solver,
    term: Real,
    value: Fraction,
    reached: z3.ModelRef,
    measure: Measure,
    rooms: Sequence[Sequence[Term]],
) -> Trial | None:
    """A history of floats that comes within `CLOSE`; None if none was found."""
    trial = trial_of(model, reached)
    if _near(trial, value, measure):
        return trial
    if isinstance(term, Fraction):
        return None
    near = term > exact.number(value - CLOSE / 2, model.context)
    for clear in rooms:
        found = _model_of(solver, near, *clear)
        if found is not None and _near(trial := trial_of(model, found), value, measure):
            return trial
    return None


def _near(trial: Trial, value: Fraction, measure: Measure) -> bool:
    try:
        return abs(value - measure(trial)) <= CLOSE
    except NotRational:
        return False


def settled(model: Model, room: Fraction, turning: GuardKey | None, *, idle: bool) -> list[Term]:
    """No guard is nearer to turning than `room`, but the one that is `turning`, and those that do
    not count if they may be `idle`."""
    conditions = []
    for step in model.steps:
        for records in step.records.values():
            for guard in records.guards:
                if guard.discrete or guard.key in (None, turning):
                    continue
                apart = exact.absolute(exact.subtract(guard.a, guard.b))
                settles = exact.at_most(room, apart)
                if idle:
                    counts = exact.conjunction((guard.path, guard.defined))
                    settles = exact.disjunction((exact.negation(counts), settles))
                conditions.append(exact.as_term(settles, model.context))
    return conditions


def trial_of(model: Model, found: z3.ModelRef) -> Trial:
    """The floats nearest to a model's readings and previous actions."""

    def value(term: Term) -> Fraction:
        number = found.eval(term, model_completion=True)
        if z3.is_algebraic_value(number):
            number = number.approx(25)
        return exact.fraction(number)

    interface = model.program.interface
    readings = {
        sensor.name: tuple(
            near_reading(sensor, value(term), BINARY64) for term in model.readings[sensor.name]
        )
        for sensor in interface.sensors
    }
    previous = {}
    for action in interface.actions:
        before = float(value(model.previous[action.name]))
        if isinstance(action.domain, Continuous):
            before = min(max(before, action.domain.lower), action.domain.upper)
        previous[action.name] = before
    return Trial(readings, previous)


def replayed(model: Model, trial: Trial | None) -> Replay | None:
    return None if trial is None else as_replay(trial, run(model.program, trial))


def as_extreme(model: Model, found: Supremum, sign: int = 1) -> Extreme:
    """The supremum, or with sign -1 the infimum of the term with the other sign."""
    value = None if found.value is None else sign * found.value
    return Extreme(value, found.attained, found.evidence, replayed(model, found.trial))
