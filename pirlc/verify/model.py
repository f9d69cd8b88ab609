"""A program unrolled over n steps, as z3 terms: what properties, bounds and remarks are asked of.

The model has n + window - 1 readings of each sensor, each free in its range widened outward to
binary32, and the previous actions of the first step, each free in its action's range; those of a
later step are the applied actions of the one before. `Circumstances` let windows hold something
else than good readings, and actions be `safe`, for the obligations that are proved apart; a
`Perturbation` lets results and guards be off as far as rounding may move them.

Where a raw result is not defined (a division by zero, the root of a negative number), what is
applied is free in the action's range: a NaN gives the safe value, an infinity a bound.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from fractions import Fraction
from itertools import pairwise

import z3

from pirlc.ir.policy import ActionSpec, Choice, Continuous, Hold, Program, Sensor
from pirlc.semantics.precision import BINARY64, Precision, middle, widened
from pirlc.symbolic import z3_terms as exact
from pirlc.symbolic.z3_form import BodyForm, Form, GuardKey, Inputs, Records, exactly
from pirlc.symbolic.z3_functions import Functions
from pirlc.symbolic.z3_terms import Real, Term, Truth


class Zeros(Enum):
    """Where a sensor's readings may be zeros that it never gave."""

    FIRST = "the first ones"
    ANY = "any"


@dataclass(frozen=True)
class Circumstances:
    """What else than good readings and clipped results there may be.

    `late`: no good reading in the first steps, where windows hold the middle of the range until the
    first good reading fills them. `zeros`: by sensor. `failing`: all actions may be safe in a step.
    """

    late: bool = False
    zeros: Mapping[str, Zeros] = field(default_factory=dict)
    failing: bool = False


ORDINARY = Circumstances()
"""Good readings and clipped results."""


@dataclass(frozen=True)
class Perturbation:
    """How far a precision's rounding may move raw results (by action) and the difference of the
    sides of guards. A guard that is missing may turn anywhere, an action may be anything.

    `ranges`: where raw results as computed lie in any case."""

    precision: Precision
    raw: Mapping[str, Fraction]
    guards: Mapping[GuardKey, Fraction]
    ranges: Mapping[str, tuple[Fraction, Fraction]] = field(default_factory=dict)


@dataclass(frozen=True)
class StepForm:
    """One step: actions by name, and what the walk of each body met."""

    raw: Mapping[str, Form]
    applied: Mapping[str, Form]
    records: Mapping[str, Records]
    safe: Term | None = None
    """Whether all actions take their safe values in this step, in a model of failing sensors."""


@dataclass(frozen=True)
class Model:
    """`readings` by sensor, oldest first; `previous` before the first step; all as z3 variables.

    `windows(sensor, step)` are what the program sees in step 0 ... n - 1, oldest first.
    `constraints` say what the variables may be; nothing may be concluded without them. `late` says
    by sensor how many steps go by before its first good reading.
    """

    program: Program
    context: z3.Context
    readings: Mapping[str, tuple[Term, ...]]
    previous: Mapping[str, Term]
    steps: tuple[StepForm, ...]
    constraints: tuple[Term, ...]
    seen: Mapping[str, tuple[tuple[Real, ...], ...]]
    late: Mapping[str, Term]
    zeros: Mapping[str, tuple[Term, ...]]
    functions: Functions
    scale: Term | None = None
    """In a perturbed model: the share of the rounding bounds on results that is used, 0 to 1."""

    def window(self, sensor: str, step: int) -> tuple[Real, ...]:
        return self.seen[sensor][step]

    def solver(self, work: int = 0, seed: int = 0) -> z3.Solver:
        """A solver with the constraints; `work` limits z3's own measure of it (0: no limit)."""
        solver = new_solver(self.context, self.functions.nonlinear, work, seed)
        solver.add(*self.constraints, *self.functions.axioms)
        return solver


def new_solver(context: z3.Context, nonlinear: bool, work: int = 0, seed: int = 0) -> z3.Solver:
    """The same answers for the same questions: seeds are fixed and `work` counts, not seconds."""
    solver = z3.SolverFor("QF_NRA" if nonlinear else "QF_LRA", ctx=context)
    if work:
        solver.set("rlimit", work)
    solver.set("random_seed", seed)
    return solver


def unroll(
    program: Program,
    steps: int,
    circumstances: Circumstances = ORDINARY,
    perturbation: Perturbation | None = None,
    concerned: frozenset[str] | None = None,
) -> Model:
    """The program over `steps` steps; with `concerned` only these of its actions, which must look
    at the previous ones of no others."""
    return _Unrolling(program, steps, circumstances, perturbation, concerned).model()


def working_range(spec: ActionSpec, precision: Precision = BINARY64) -> tuple[Fraction, Fraction]:
    """The bounds that a continuous action is clipped to."""
    assert isinstance(spec.domain, Continuous)
    lower, upper = spec.domain.lower, spec.domain.upper
    return Fraction(precision.round(lower)), Fraction(precision.round(upper))


def reading_range(program: Program, sensor: str) -> tuple[Fraction, Fraction]:
    """The range of a sensor's good readings, widened outward to binary32."""
    low, high = finite_range(program.interface.sensor(sensor))
    return Fraction(low), Fraction(high)


def finite_range(sensor: Sensor) -> tuple[float, float]:
    """The widened range without the infinities beyond the largest binary32 number, which are no
    good readings."""
    low, high = widened(sensor.lower, sensor.upper)
    return max(low, -sys.float_info.max), min(high, sys.float_info.max)


def failing_sensors(program: Program) -> tuple[str, ...]:
    """The sensors whose missing readings make every action safe."""
    return tuple(
        sensor.name
        for sensor in program.interface.sensors
        if isinstance(sensor.missing, Hold) and sensor.missing.limit is not None
    )


class _Unrolling:
    def __init__(
        self,
        program: Program,
        steps: int,
        circumstances: Circumstances,
        perturbation: Perturbation | None,
        concerned: frozenset[str] | None,
    ) -> None:
        self.program = program
        self.count = steps
        self.concerned = concerned
        self.circumstances = circumstances
        self.perturbation = perturbation
        self.precision = perturbation.precision if perturbation else BINARY64
        self.context = z3.Context()
        self.functions = Functions(self.context)
        self.constraints: list[Truth] = []
        self.scale: Term | None = None
        if perturbation is not None:
            self.scale = z3.Real("share of the rounding", self.context)
            self.constraints.append(exact.within(self.scale, Fraction(0), Fraction(1)))
        self.late: dict[str, Term] = {}
        self.zeros: dict[str, tuple[Term, ...]] = {}

    def model(self) -> Model:
        interface = self.program.interface
        readings = {sensor.name: self._readings(sensor.name) for sensor in interface.sensors}
        seen = {name: self._seen(name, values) for name, values in readings.items()}
        first = {spec.name: self._previous(spec) for spec in interface.actions}
        previous: Mapping[str, Real] = first
        stepped = []
        for step in range(self.count):
            stepped.append(self._step(step, seen, previous))
            previous = {name: form.value for name, form in stepped[-1].applied.items()}
        terms = [exact.as_term(c, self.context) for c in self.constraints]
        return Model(
            self.program,
            self.context,
            readings,
            first,
            tuple(stepped),
            tuple(terms),
            seen,
            self.late,
            self.zeros,
            self.functions,
            self.scale,
        )

    # Readings and windows.

    def _readings(self, name: str) -> tuple[Term, ...]:
        length = self.count + self.program.interface.window - 1
        values = tuple(z3.Real(f"{name}[{i - length}]", self.context) for i in range(length))
        low, high = reading_range(self.program, name)
        where = self.circumstances.zeros.get(name)
        if where is None or low <= 0 <= high:
            self.constraints.extend(exact.within(value, low, high) for value in values)
            return values
        zero = tuple(z3.Bool(f"{name}[{i - length}] is zero", self.context) for i in range(length))
        self.zeros[name] = zero
        for value, is_zero in zip(values, zero, strict=True):
            good = exact.within(value, low, high)
            self.constraints.append(z3.If(is_zero, value == 0, good))
        if where is Zeros.FIRST:
            for before, after in pairwise(zero):
                self.constraints.append(z3.Implies(after, before))
        return values

    def _seen(self, name: str, readings: tuple[Term, ...]) -> tuple[tuple[Real, ...], ...]:
        window, steps = self.program.interface.window, range(self.count)
        if not self.circumstances.late or self.count == 1:
            return tuple(readings[step : step + window] for step in steps)
        sensor = self.program.interface.sensor(name)
        centre = Fraction(self.precision.round(middle(sensor.lower, sensor.upper)))
        start = z3.Real(f"steps before the first reading of {name}", self.context)
        self.late[name] = start
        self.constraints.append(z3.Or(*(start == begin for begin in range(self.count))))

        def element(step: int, place: int) -> Real:
            value: Real = readings[step + place]
            for begin in range(1, self.count):
                # The reading of step `begin` fills the window; it is readings[begin + window - 1].
                newest = max(step + place - self.program.interface.latency, begin + window - 1)
                late = centre if step < begin else readings[newest]
                value = exact.choose(start == begin, late, value)
            return value

        return tuple(tuple(element(step, place) for place in range(window)) for step in steps)

    def _previous(self, spec: ActionSpec) -> Term:
        value = z3.Real(f"previous {spec.name}", self.context)
        self.constraints.append(self._in_domain(spec, value))
        return value

    def _in_domain(self, spec: ActionSpec, value: Term) -> Truth:
        match spec.domain:
            case Continuous():
                return exact.within(value, *working_range(spec, self.precision))
            case Choice(values):
                return z3.Or(*(value == number for number in values))

    # Steps.

    def _step(
        self,
        step: int,
        seen: Mapping[str, tuple[tuple[Real, ...], ...]],
        previous: Mapping[str, Real],
    ) -> StepForm:
        program = self.program
        inputs = Inputs(
            {name: Fraction(value) for name, value in program.values.items()},
            lambda sensor, index: seen[sensor][step][index],
            previous,
        )
        safe = self._failing(step, seen) if self.circumstances.failing else None
        raw: dict[str, Form] = {}
        applied: dict[str, Form] = {}
        records: dict[str, Records] = {}
        for spec, body in zip(program.interface.actions, program.bodies, strict=True):
            if self.concerned is not None and spec.name not in self.concerned:
                continue
            form = BodyForm(spec.name, inputs, self.functions, self._margin)
            result = form.run(body)
            self.constraints.extend(form.constraints)
            raw[spec.name] = self._rounded(spec, result, step)
            applied[spec.name] = self._applied(spec, raw[spec.name], step, safe)
            records[spec.name] = form.records
        return StepForm(raw, applied, records, safe)

    def _failing(self, step: int, seen: Mapping[str, tuple[tuple[Real, ...], ...]]) -> Term:
        """Whether a sensor fails in this step; what its window gets then is its last reading."""
        safe = z3.Bool(f"safe in step {step}", self.context)
        held = []
        for name in failing_sensors(self.program):
            window = seen[name][step]
            earlier = window[-2] if len(window) > 1 else seen[name][step - 1][-1] if step else None
            known = earlier is not None and self.program.interface.latency == 0
            held.append(exact.equal(window[-1], earlier) if known else True)
        self.constraints.append(exact.disjunction((z3.Not(safe), *held)))
        return safe

    def _margin(self, key: GuardKey) -> Fraction | None:
        return exactly(key) if self.perturbation is None else self.perturbation.guards.get(key)

    def _rounded(self, spec: ActionSpec, result: Form, step: int) -> Form:
        if self.perturbation is None or isinstance(spec.domain, Choice):
            return result
        bound = self.perturbation.raw.get(spec.name)
        if bound is None:
            return Form(Fraction(0), False)
        value = z3.Real(f"rounded {spec.name} {step}", self.context)
        off = exact.subtract(value, result.value)
        most = exact.multiply(bound, self.scale)
        self.constraints.append(exact.within(off, exact.negate(most), most))
        if spec.name in self.perturbation.ranges:
            self.constraints.append(exact.within(value, *self.perturbation.ranges[spec.name]))
        return Form(value, result.defined)

    def _applied(self, spec: ActionSpec, raw: Form, step: int, safe: Term | None) -> Form:
        value = raw.value
        if isinstance(spec.domain, Continuous):
            value = exact.clip(value, *working_range(spec, self.precision))
        if raw.defined is not True:
            free = z3.Real(f"applied {spec.name} {step}", self.context)
            self.constraints.append(self._in_domain(spec, free))
            value = exact.choose(raw.defined, value, free)
        if safe is not None:
            value = exact.choose(safe, Fraction(self.precision.round(spec.safe)), value)
        return Form(value, True, isinstance(spec.domain, Choice))
