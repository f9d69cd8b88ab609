"""Where violations are looked for: z3's models as trials, and many histories at random.

Nothing here decides; what is found is replayed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from fractions import Fraction
from typing import Any

import numpy as np
import z3
from numpy.typing import NDArray

from pirlc.ir.operators import Operator
from pirlc.ir.policy import Choice, Continuous, Hold, Program, Property
from pirlc.ir.types import Type
from pirlc.semantics.histories import HistorySet, Layout
from pirlc.semantics.precision import BINARY32, BINARY64, Precision, middle
from pirlc.semantics.vectorised import apply_actions, compile_plan
from pirlc.symbolic.walk import Algebra, walk
from pirlc.symbolic.z3_terms import Term, fraction
from pirlc.verify.model import Model, failing_sensors, finite_range
from pirlc.verify.replay import Trial, near_action, near_reading

Reals = NDArray[np.float64]


def trials_of(model: Model, answer: z3.ModelRef) -> Iterator[Trial]:
    """What z3 found in numbers that controllers meet: short ones first, then all of binary32, as
    most readings are, then of binary64.
    """
    for digits in (2, 3, 4, 6, None):
        yield _trial(model, answer, BINARY32, digits)
    yield _trial(model, answer, BINARY64, None)


def _value(answer: z3.ModelRef, term: Term) -> Fraction:
    value = answer.eval(term, model_completion=True)
    return fraction(value if z3.is_rational_value(value) else value.approx(30))


def _is_true(answer: z3.ModelRef, term: Term) -> bool:
    return bool(z3.is_true(answer.eval(term, model_completion=True)))


def _trial(model: Model, answer: z3.ModelRef, precision: Precision, digits: int | None) -> Trial:
    program, window = model.program, model.program.interface.window
    readings: dict[str, tuple[float, ...]] = {}
    late: set[str] = set()
    for sensor in program.interface.sensors:
        given = [
            near_reading(sensor, _value(answer, term), precision, digits)
            for term in model.readings[sensor.name]
        ]
        for place, is_zero in enumerate(model.zeros.get(sensor.name, ())):
            if _is_true(answer, is_zero):
                given[place] = 0.0 if place < window - 1 else math.nan
        start = model.late.get(sensor.name)
        begin = int(_value(answer, start)) if start is not None else 0
        if begin:
            late.add(sensor.name)
            given[: window - 1] = [middle(sensor.lower, sensor.upper)] * (window - 1)
            given[window - 1 : window - 1 + begin] = [math.nan] * begin
        readings[sensor.name] = tuple(given)
    previous = {
        spec.name: near_action(spec, _value(answer, model.previous[spec.name]), precision, digits)
        for spec in program.interface.actions
    }
    failed = [
        number
        for number, step in enumerate(model.steps)
        if step.safe is not None and _is_true(answer, step.safe)
    ]
    missing: dict[str, frozenset[int]] = {}
    absent: dict[str, int] = {}
    if failed:
        name = _held(program, readings, failed)
        policy = program.interface.sensor(name).missing
        assert isinstance(policy, Hold)
        missing[name] = frozenset(failed)
        absent[name] = policy.limit or 0
    return Trial(readings, previous, frozenset(late), absent, missing)


def _held(program: Program, readings: Mapping[str, tuple[float, ...]], failed: list[int]) -> str:
    """A sensor that may fail and whose readings repeat in these steps; else just one of them."""
    names, place = failing_sensors(program), program.interface.window - 1
    for name in names:
        given = readings[name]
        if all(given[place + s] == given[max(place + s - 1, 0)] for s in failed):
            return name
    return names[0]


def random_trials(program: Program, claim: Property, count: int) -> Iterator[Trial]:
    """The histories among `count` on which the property seems to be violated, a few at most.

    Some are anywhere in the ranges, some at their corners, some vary slowly, some not at all.
    """
    generator = np.random.default_rng(0)
    readings = _random_readings(program, claim.steps, count, generator)
    previous = _random_previous(program, count, generator)
    broken = _broken(program, claim, readings, previous, count)
    for number in np.flatnonzero(broken)[:20]:
        yield Trial(
            {name: tuple(map(float, values[:, number])) for name, values in readings.items()},
            {name: float(values[number]) for name, values in previous.items()},
        )


def _random_readings(
    program: Program, steps: int, count: int, generator: np.random.Generator
) -> dict[str, Reals]:
    """By sensor (steps + window - 1, count), all binary32 numbers in the range."""
    length = steps + program.interface.window - 1
    found = {}
    for sensor in program.interface.sensors:
        low, high = finite_range(sensor)
        anywhere = generator.random((length, count))
        corners = generator.integers(0, 2, (length, count)).astype(np.float64)
        slope = generator.normal(size=count) * 10.0 ** -generator.integers(0, 6, count)
        wander = generator.normal(size=(length, count)) * 10.0 ** -generator.integers(1, 8, count)
        slow = generator.random(count) + np.linspace(0, 1, length)[:, None] * slope + wander
        still = np.repeat(generator.random((1, count)), length, axis=0)
        kind = generator.integers(0, 8, count)
        share = np.select(
            [kind < 3, kind < 5, kind < 7], [anywhere, corners, np.clip(slow, 0, 1)], still
        )
        values = (low * (1 - share) + high * share).astype(np.float32).astype(np.float64)
        found[sensor.name] = np.clip(values, low, high)
    return found


def _random_previous(
    program: Program, count: int, generator: np.random.Generator
) -> dict[str, Reals]:
    found: dict[str, Reals] = {}
    for spec in program.interface.actions:
        match spec.domain:
            case Continuous(low, high):
                share = np.clip(generator.random(count) * 1.5 - 0.25, 0, 1)
                found[spec.name] = np.clip(low * (1 - share) + high * share, low, high)
            case Choice(values):
                found[spec.name] = generator.choice(np.array(values, np.float64), count)
    return found


def _broken(
    program: Program,
    claim: Property,
    readings: Mapping[str, Reals],
    previous: Mapping[str, Reals],
    count: int,
) -> NDArray[np.bool_]:
    """Where the property is false, computed in binary64 throughout."""
    window = program.interface.window
    plan = compile_plan(program, BINARY64, Layout.GATHERED)
    names = [spec.name for spec in program.interface.actions]
    befores, raws, applieds = [], [], []
    for step in range(claim.steps):
        histories = HistorySet(
            interface=program.interface,
            precision=BINARY64,
            layout=Layout.GATHERED,
            sensors={name: values[step : step + window] for name, values in readings.items()},
            previous=previous,
            status=np.zeros(count, np.uint8),
            failed=np.zeros(count, np.bool_),
            places=np.arange(count, dtype=np.intp),
        )
        raw = plan.run({}, histories)
        applied = apply_actions(raw, histories).actions
        befores.append(previous)
        raws.append({name: raw[:, i].copy() for i, name in enumerate(names)})
        applieds.append({name: applied[:, i].copy() for i, name in enumerate(names)})
        previous = applieds[-1]

    def values(columns: list[Mapping[str, Reals]], name: str) -> Any:
        return tuple(c[name] for c in columns) if claim.ranged else columns[-1][name]

    def action(name: str, raw: bool, _: Type) -> Any:
        return values(list(raws if raw else applieds), name)

    algebra: Algebra[Any] = Algebra(
        literal=float,
        discrete=lambda value, _: float(value),
        parameter=lambda name: program.values[name],
        element=lambda sensor, index: readings[sensor][index],
        previous=lambda name, _: values(befores, name),
        operators=_ARRAYS,
        choose=np.where,
        action=action,
    )
    with np.errstate(all="ignore"):
        return ~np.broadcast_to(np.asarray(walk(claim.body, algebra), np.bool_), (count,))


_ARRAYS: dict[Operator, Callable[..., Any]] = {
    Operator.IMPLIES: lambda a, b: np.logical_or(np.logical_not(a), b),
    Operator.OR: np.logical_or,
    Operator.AND: np.logical_and,
    Operator.NOT: np.logical_not,
    Operator.LESS: np.less,
    Operator.LESS_EQUAL: np.less_equal,
    Operator.GREATER: np.greater,
    Operator.GREATER_EQUAL: np.greater_equal,
    Operator.EQUAL: np.equal,
    Operator.NOT_EQUAL: np.not_equal,
    Operator.ADD: np.add,
    Operator.SUBTRACT: np.subtract,
    Operator.MULTIPLY: np.multiply,
    Operator.DIVIDE: np.divide,
    Operator.NEGATE: np.negative,
    Operator.ABS: np.absolute,
    Operator.MIN: lambda a, b: np.where(np.less(a, b), a, b),
    Operator.MAX: lambda a, b: np.where(np.greater(a, b), a, b),
    Operator.CLIP: lambda x, low, high: np.where(x < low, low, np.where(x > high, high, x)),
    Operator.SQRT: np.sqrt,
    Operator.EXP: np.exp,
    Operator.TANH: np.tanh,
    Operator.SIGN: np.sign,
}
