"""The tightest bounds of each action, raw and applied, and of its change in one step.

Over all histories of good readings in the sensors' (widened) ranges, `previous` before the first
step being free in its action's range, in exact real arithmetic. Piecewise linear actions have
exact suprema (`extremes`); others are enclosed (`enclosure`), and their bounds are proved where the
enclosure is closer than 1e-9. Every bound comes with a history that attains it or comes as near.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import z3

from pirlc.ir.evidence import PROVED, Evidence, Kind, unknown
from pirlc.ir.policy import ActionSpec, Choice, Continuous, Program, Property
from pirlc.ir.terms import Literal
from pirlc.semantics.precision import BINARY32, BINARY64
from pirlc.symbolic import z3_terms as exact
from pirlc.symbolic.z3_terms import Real, Truth
from pirlc.verify.bounds.computed import as_computed
from pirlc.verify.bounds.enclosure import Enclosure, IntervalStep, enclose, needed
from pirlc.verify.bounds.extremes import (
    CLOSE,
    ROOMS,
    Supremum,
    limited,
    settled,
    supremum,
    trial_of,
    why,
)
from pirlc.verify.bounds.intervals import Interval
from pirlc.verify.exact import NotRational, exact_steps
from pirlc.verify.findings import ActionBounds, ChoiceBounds, Extreme, Replay
from pirlc.verify.model import Model, unroll
from pirlc.verify.properties.asking import DEFAULT_LIMITS, Limits
from pirlc.verify.properties.deciding import LARGEST, cost
from pirlc.verify.replay import Trial, as_replay, run
from pirlc.verify.rounding import rounding

OPERATIONS = 150_000
"""What branch and bound may cost for one bound, in operations on intervals."""

_MOST_NONLINEAR = 500
"""Operations that a nonlinear model may have for z3 to be asked about it."""

_PARTIAL = "a division by zero or the root of a negative number is not excluded"

TOO_LARGE = unknown("too large for z3")


def bounds(
    program: Program, limits: Limits = DEFAULT_LIMITS
) -> tuple[ActionBounds | ChoiceBounds, ...]:
    """What each action can be, and how fast it can change."""
    found: list[ActionBounds | ChoiceBounds] = []
    for spec in program.interface.actions:
        match spec.domain:
            case Continuous():
                found.append(_continuous(program, spec, limits))
            case Choice(values):
                found.append(_choice(program, spec, values, limits))
    return tuple(found)


@dataclass(frozen=True)
class Quantity:
    """What is maximised: an action or its change, with a sign."""

    action: str
    applied: bool
    change: bool
    sign: int

    @property
    def steps(self) -> int:
        return 2 if self.change else 1

    def term(self, model: Model) -> tuple[Real, Truth]:
        """As a z3 term, and where it is defined."""
        forms = [step.applied if self.applied else step.raw for step in model.steps]
        last, first = forms[-1][self.action].value, forms[0][self.action].value
        value = exact.subtract(last, first) if self.change else last
        defined = exact.conjunction(step.raw[self.action].defined for step in model.steps)
        return (value if self.sign > 0 else exact.negate(value)), defined

    def exactly(self, program: Program, trial: Trial) -> Fraction:
        """On a history. Raises `NotRational`."""
        steps = exact_steps(program, trial.readings, trial.previous, self.steps)
        values = [(s.applied if self.applied else s.raw)[self.action] for s in steps]
        return self.sign * Fraction(values[-1] - values[0] if self.change else values[-1])

    def over(self, steps: Sequence[IntervalStep]) -> Interval:
        """Over a box of histories."""
        values = [(s.applied if self.applied else s.raw)[self.action] for s in steps]
        return self.sign * (values[-1] - values[0] if self.change else values[-1])


def restricted(program: Program, action: str) -> Program:
    """The program with nothing but an action and those whose earlier values it uses."""
    names = needed(program, [action])
    kept = [
        (spec, body)
        for spec, body in zip(program.interface.actions, program.bodies, strict=True)
        if spec.name in names
    ]
    interface = replace(program.interface, actions=tuple(spec for spec, _ in kept))
    return replace(
        program, interface=interface, bodies=tuple(body for _, body in kept), properties=()
    )


def operations(program: Program, steps: int) -> int:
    """About how many operations a model of so many steps has."""
    return cost(program, Property("", Literal(0.0), steps))


def _continuous(program: Program, spec: ActionSpec, limits: Limits) -> ActionBounds:
    part = restricted(program, spec.name)
    off = {p: rounding(program, p).steps[0].raw[spec.name] for p in (BINARY64, BINARY32)}
    if operations(part, 2) > LARGEST:
        no = Extreme(None, False, TOO_LARGE)
        return ActionBounds(spec.name, no, no, no, no, no, no, off[BINARY64], off[BINARY32])
    asked = _Asked(program, part, spec, limits, {n: unroll(part, n) for n in (1, 2)})
    return ActionBounds(
        action=spec.name,
        raw_lower=asked.extreme(applied=False, sign=-1),
        raw_upper=asked.extreme(applied=False, sign=1),
        raw_change=asked.change(applied=False),
        applied_lower=asked.extreme(applied=True, sign=-1),
        applied_upper=asked.extreme(applied=True, sign=1),
        applied_change=asked.change(applied=True),
        rounding64=off[BINARY64],
        rounding32=off[BINARY32],
        binary64=as_computed(part, spec, BINARY64, limits),
        binary32=as_computed(part, spec, BINARY32, limits),
    )


@dataclass(frozen=True)
class _Asked:
    """One action of a program, in the part of it that counts, unrolled over one and two steps."""

    program: Program
    part: Program
    spec: ActionSpec
    limits: Limits
    models: dict[int, Model]

    def extreme(self, *, applied: bool, sign: int) -> Extreme:
        found = self._supremum(Quantity(self.spec.name, applied, False, sign))
        return self._extreme(found, sign)

    def change(self, *, applied: bool) -> Extreme:
        """Upward or downward, whichever is larger."""
        found = []
        for sign in (1, -1):
            found.append(self._supremum(Quantity(self.spec.name, applied, True, sign)))
            if found[-1].value is None:
                return self._extreme(found[-1], 1)
        return self._extreme(max(found, key=lambda s: (s.value, s.attained)), 1)

    def _extreme(self, found: Supremum, sign: int) -> Extreme:
        value = None if found.value is None else sign * found.value
        witness = None if found.trial is None else replay_of(self.program, found.trial)
        return Extreme(value, found.attained, found.evidence, witness)

    def _supremum(self, wanted: Quantity) -> Supremum:
        model = self.models[wanted.steps]
        term, defined = wanted.term(model)
        if defined is not True:
            undefined = limited(model, self.limits)
            undefined.add(exact.negation(defined))
            if undefined.check() != z3.unsat:
                return self._partly(wanted)
        if model.functions.nonlinear or model.functions.axioms:
            return self._enclosed(wanted)
        return supremum(
            model, term, (), lambda trial: wanted.exactly(self.part, trial), self.limits
        )

    def _partly(self, wanted: Quantity) -> Supremum:
        """Where a division by zero or the root of a negative number is not excluded."""
        found = self._enclosed(wanted)
        reason = _PARTIAL
        domain = self.spec.domain
        assert isinstance(domain, Continuous)
        if wanted.applied and found.value is not None and not wanted.change:
            bound = Fraction(domain.upper if wanted.sign > 0 else domain.lower) * wanted.sign
            if bound - found.value <= CLOSE:
                return replace(found, value=bound)
        if found.value is not None:
            reason += f"; elsewhere it is {float(wanted.sign * found.value):.9g}"
        elif found.evidence.reason:
            reason += f"; elsewhere {found.evidence.reason}"
        return Supremum(None, False, unknown(reason), found.trial)

    def _enclosed(self, wanted: Quantity) -> Supremum:
        evaluations = OPERATIONS // max(1, operations(self.part, wanted.steps))
        found = enclose(self.part, [self.spec.name], wanted.steps, wanted.over, evaluations)
        trial = _trial(self.part, found, wanted.steps)
        if found.lower is None or found.upper is None:
            return Supremum(None, False, unknown(_words(found, wanted.sign)), trial)
        exactly = found.lower if found.lower == found.upper else self._attained(wanted, trial)
        if exactly is not None:
            return Supremum(exactly, True, PROVED, trial)
        if found.upper - found.lower <= CLOSE:
            evidence = Evidence(Kind.PROVED, "to within 1e-9")
            return Supremum(found.upper, False, evidence, trial)
        return Supremum(None, False, unknown(_words(found, wanted.sign)), trial)

    def _attained(self, wanted: Quantity, trial: Trial) -> Fraction | None:
        """The rational value on a history that no other exceeds."""
        if operations(self.part, wanted.steps) > _MOST_NONLINEAR:
            return None
        try:
            value = wanted.exactly(self.part, trial)
        except NotRational:
            return None
        model = self.models[wanted.steps]
        term, _ = wanted.term(model)
        if isinstance(term, Fraction):
            return term
        solver = limited(model, self.limits)
        solver.add(term > exact.number(value, model.context))
        return value if solver.check() == z3.unsat else None


def replay_of(program: Program, trial: Trial) -> Replay:
    """The interpreter's steps; actions that play no part start from their safe values."""
    previous = {a.name: trial.previous.get(a.name, a.safe) for a in program.interface.actions}
    whole = replace(trial, previous=previous)
    return as_replay(whole, run(program, whole))


def _trial(part: Program, found: Enclosure, steps: int) -> Trial:
    interface = part.interface
    readings = {
        sensor.name: tuple(found.point[sensor.name, i] for i in range(interface.window + steps - 1))
        for sensor in interface.sensors
    }
    return Trial(
        readings, {a.name: found.point.get((a.name, -1), a.safe) for a in interface.actions}
    )


def _words(found: Enclosure, sign: int) -> str:
    """The best enclosure, in words."""
    low, high = (None if x is None else float(sign * x) for x in (found.lower, found.upper))
    if sign < 0:
        low, high = high, low
    ends = ("no bound" if x is None else f"{x:.9g}" for x in (low, high))
    return f"between {next(ends)} and {next(ends)} after {found.boxes:,} boxes"


def _choice(
    program: Program, spec: ActionSpec, values: tuple[int, ...], limits: Limits
) -> ChoiceBounds:
    part = restricted(program, spec.name)
    if operations(part, 1) > LARGEST:
        return ChoiceBounds(spec.name, (), (), TOO_LARGE)
    model = unroll(part, 1)
    result = model.steps[0].raw[spec.name]
    solver = limited(model, limits)
    solver.add(exact.as_term(exact.negation(result.defined), model.context))
    total = solver.check() == z3.unsat
    reached: list[int] = []
    never: list[int] = []
    open_: list[str] = []
    for value in values:
        match _taken(program, model, spec, value, limits):
            case True:
                reached.append(value)
            case False if total:
                never.append(value)
            case False:
                open_.append(f"{value}: {_PARTIAL}")
            case why_not:
                open_.append(f"{value}: {why_not}")
    evidence = unknown("; ".join(open_)) if open_ else PROVED
    return ChoiceBounds(spec.name, tuple(reached), tuple(never), evidence)


def _taken(
    program: Program, model: Model, spec: ActionSpec, value: int, limits: Limits
) -> bool | str:
    """Whether the interpreter takes the value on some history (seen) or on none (proved), or why
    that is not known."""
    result = model.steps[0].raw[spec.name].value
    solver = limited(model, limits)
    solver.add(exact.as_term(exact.equal(result, Fraction(value)), model.context))
    rooms = [settled(model, room, None, idle=True) for room in ROOMS]
    for conditions in ([], *rooms):
        solver.push()
        solver.add(*conditions)
        answer = solver.check()
        if answer == z3.sat:
            trial = trial_of(model, solver.model())
            if replay_of(program, trial).steps[-1].applied[spec.name] == value:
                return True
        elif not conditions:
            return False if answer == z3.unsat else why(solver)
        solver.pop()
    return "taken over the reals; no history of floats was found"
