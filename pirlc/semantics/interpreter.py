"""The reference interpreter: the definition of what a program does.

One step takes in an observation, appends each sensor's reading to its window, evaluates every
action from the same windows, and clips. The state is an explicit value; nothing is kept elsewhere.
It favours being read over being fast; `vectorised` and emitted code must agree with it bit for
bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, assert_never

from pirlc.ir.operators import Operator
from pirlc.ir.policy import (
    ActionSpec,
    Choice,
    Continuous,
    Fill,
    Hold,
    Interface,
    Program,
    Sensor,
    Zero,
)
from pirlc.ir.terms import (
    ActionRef,
    Apply,
    Diff,
    DiscreteLiteral,
    Fold,
    FoldLambda,
    Hole,
    If,
    Let,
    Literal,
    LocalRef,
    ParameterRef,
    Peek,
    PreviousAction,
    RuleCall,
    SensorRef,
    Term,
)
from pirlc.semantics.precision import BINARY64, Precision, middle, widened

if TYPE_CHECKING:
    from pirlc.ir.observation import Observation

MISSING = 1
"""Status bit, and a sensor's flag: the reading was NaN or infinite."""
OUT_OF_RANGE = 2
"""Status bit, and a sensor's flag: a good reading lay outside the sensor's (widened) range."""
SAFE_USED = 4
"""Status bit: some action took its `safe` value."""

Value = float | int | bool | tuple[float, ...]
"""A real, a discrete action, a truth value, or a sequence (oldest first)."""


@dataclass(frozen=True, slots=True)
class SensorState:
    """`buffer` holds window + latency readings, oldest first.

    `started` tells whether there was a good reading yet; `absent` counts the missing readings
    since the last good one, up to one more than the sensor's staleness limit.
    """

    buffer: tuple[float, ...]
    last_good: float
    started: bool = False
    absent: int = 0
    flags: int = 0


@dataclass(frozen=True, slots=True)
class State:
    """Sensors and applied actions of the step before, each in declaration order."""

    sensors: tuple[SensorState, ...]
    previous: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class StepResult:
    """`actions` (applied) and `raw` (before clipping) are in declaration order."""

    state: State
    actions: tuple[float, ...]
    status: int
    flags: tuple[int, ...]
    raw: tuple[float, ...]


def initial_state(program: Program, precision: Precision = BINARY64) -> State:
    """The state at reset."""
    interface = program.interface
    length = interface.window + interface.latency
    sensors = []
    for sensor in interface.sensors:
        match interface.fill:
            case Fill.FIRST:
                start = precision.round(middle(sensor.lower, sensor.upper))
            case Fill.ZERO:
                start = 0.0
        sensors.append(SensorState(buffer=(start,) * length, last_good=start))
    return State(tuple(sensors), tuple(_safe(action, precision) for action in interface.actions))


def step(
    program: Program, state: State, observation: Observation, precision: Precision = BINARY64
) -> StepResult:
    """One step on an observation vector (a sensor reads its component `index`)."""
    interface = program.interface
    sensors = tuple(
        take_in(interface, sensor, before, float(observation[sensor.index]), precision)
        for sensor, before in zip(interface.sensors, state.sensors, strict=True)
    )
    status = 0
    for after in sensors:
        status |= after.flags
    failed = any(
        isinstance(sensor.missing, Hold)
        and sensor.missing.limit is not None
        and after.absent > sensor.missing.limit
        for sensor, after in zip(interface.sensors, sensors, strict=True)
    )
    scope = Scope(
        parameters={name: precision.round(value) for name, value in program.values.items()},
        windows={
            sensor.name: after.buffer[: interface.window]
            for sensor, after in zip(interface.sensors, sensors, strict=True)
        },
        previous={
            action.name: value
            for action, value in zip(interface.actions, state.previous, strict=True)
        },
        locals={},
    )
    raw, actions = [], []
    for action, body in zip(interface.actions, program.bodies, strict=True):
        result = evaluate(body, scope, precision)
        assert not isinstance(result, tuple)
        raw.append(result)
        if failed or result != result:
            actions.append(_safe(action, precision))
            status |= SAFE_USED
        else:
            actions.append(applied(action, result, precision))
    return StepResult(
        state=State(sensors, tuple(actions)),
        actions=tuple(actions),
        status=status,
        flags=tuple(after.flags for after in sensors),
        raw=tuple(raw),
    )


def take_in(
    interface: Interface, sensor: Sensor, before: SensorState, reading: float, precision: Precision
) -> SensorState:
    """The sensor's state after one more reading."""
    reading = precision.round(reading)
    if not math.isfinite(reading):
        limit = sensor.missing.limit if isinstance(sensor.missing, Hold) else None
        absent = 0 if limit is None else min(before.absent + 1, limit + 1)
        if not before.started and interface.fill is Fill.FIRST:
            return replace(before, absent=absent, flags=MISSING)
        match sensor.missing:
            case Hold():
                stand_in = before.last_good
            case Zero():
                stand_in = 0.0
        return replace(before, buffer=(*before.buffer[1:], stand_in), absent=absent, flags=MISSING)
    if not before.started and interface.fill is Fill.FIRST:
        buffer = (reading,) * len(before.buffer)
    else:
        buffer = (*before.buffer[1:], reading)
    low, high = widened(sensor.lower, sensor.upper)
    return SensorState(
        buffer=buffer,
        last_good=reading,
        started=True,
        absent=0,
        flags=0 if low <= reading <= high else OUT_OF_RANGE,
    )


def applied(action: ActionSpec, result: float, precision: Precision) -> float:
    """What leaves the controller for a result that is not NaN."""
    match action.domain:
        case Continuous(lower, upper):
            return _clip(result, precision.round(lower), precision.round(upper))
        case Choice():
            return result


def _safe(action: ActionSpec, precision: Precision) -> float:
    match action.domain:
        case Continuous():
            return precision.round(action.safe)
        case Choice():
            return int(action.safe)


@dataclass(frozen=True, slots=True)
class Scope:
    """What the names in a term stand for."""

    parameters: Mapping[str, float]
    windows: Mapping[str, tuple[float, ...]]
    previous: Mapping[str, float]
    locals: Mapping[str, Value]

    def bind(self, name: str, value: Value) -> Scope:
        return Scope(self.parameters, self.windows, self.previous, {**self.locals, name: value})


def evaluate(term: Term, scope: Scope, precision: Precision) -> Value:
    """The value of a closed-over term. Total: nothing here raises on any number."""
    match term:
        case Apply(operator, arguments):
            values = [evaluate(argument, scope, precision) for argument in arguments]
            return _broadcast(operator, values, precision)
        case Literal(value):
            return precision.round(value)
        case DiscreteLiteral(value):
            return value
        case ParameterRef(name):
            return scope.parameters[name]
        case SensorRef(name):
            return scope.windows[name]
        case LocalRef(name):
            return scope.locals[name]
        case PreviousAction(action):
            return scope.previous[action]
        case Peek(sequence, index):
            return _sequence(sequence, scope, precision)[index]
        case Fold(operator, sequence):
            first, *rest = _sequence(sequence, scope, precision)
            folded = first
            for element in rest:
                folded = _real(operator, (element, folded), precision)
            return folded
        case FoldLambda(element_name, accumulator_name, body, sequence, initial):
            accumulator = evaluate(initial, scope, precision)
            for element in _sequence(sequence, scope, precision):
                inner = scope.bind(element_name, element).bind(accumulator_name, accumulator)
                accumulator = evaluate(body, inner, precision)
            return accumulator
        case Diff(sequence):
            elements = _sequence(sequence, scope, precision)
            return tuple(
                _real(Operator.SUBTRACT, (newer, older), precision)
                for older, newer in pairwise(elements)
            )
        case If(condition, consequent, alternative):
            taken = consequent if evaluate(condition, scope, precision) else alternative
            return evaluate(taken, scope, precision)
        case Let(name, value, body):
            return evaluate(body, scope.bind(name, evaluate(value, scope, precision)), precision)
        case Hole() | RuleCall() | ActionRef():
            raise AssertionError("a program's actions hold no choice and no reference to actions")
        case _:
            assert_never(term)


def _sequence(term: Term, scope: Scope, precision: Precision) -> tuple[float, ...]:
    value = evaluate(term, scope, precision)
    assert isinstance(value, tuple)
    return value


def _broadcast(operator: Operator, values: list[Value], precision: Precision) -> Value:
    """Elementwise where an argument is a sequence; atoms stand beside every element."""
    if operator in TRUTH:
        return TRUTH[operator](*values)
    lengths = [len(value) for value in values if isinstance(value, tuple)]
    if not lengths:
        return _real(operator, values, precision)
    return tuple(
        _real(operator, [v[i] if isinstance(v, tuple) else v for v in values], precision)
        for i in range(lengths[0])
    )


def _real(operator: Operator, values: Sequence[Value], precision: Precision) -> float:
    return precision.round(ARITHMETIC[operator](*values))


def _divide(a: float, b: float) -> float:
    if b != 0.0:
        return a / b
    if a == 0.0 or math.isnan(a):
        return math.nan
    return math.copysign(math.inf, a) * math.copysign(1.0, b)


def _clip(x: float, low: float, high: float) -> float:
    return low if x < low else high if x > high else x


def _sqrt(x: float) -> float:
    return math.nan if x < 0.0 else math.sqrt(x)


def _exp(x: float) -> float:
    try:
        return math.exp(x)
    except OverflowError:
        return math.inf


def _sign(x: float) -> float:
    return 1.0 if x > 0.0 else -1.0 if x < 0.0 else 0.0 if x == 0.0 else math.nan


ARITHMETIC: dict[Operator, Callable[..., float]] = {
    Operator.ADD: lambda a, b: a + b,
    Operator.SUBTRACT: lambda a, b: a - b,
    Operator.MULTIPLY: lambda a, b: a * b,
    Operator.DIVIDE: _divide,
    Operator.NEGATE: lambda a: -a,
    Operator.ABS: abs,
    Operator.MIN: lambda a, b: a if a < b else b,
    Operator.MAX: lambda a, b: a if a > b else b,
    Operator.CLIP: _clip,
    Operator.SQRT: _sqrt,
    Operator.EXP: _exp,
    Operator.TANH: math.tanh,
    Operator.SIGN: _sign,
}
"""The operators whose results are reals, exact or rounded once to binary64."""

TRUTH: dict[Operator, Callable[..., bool]] = {
    Operator.LESS: lambda a, b: a < b,
    Operator.LESS_EQUAL: lambda a, b: a <= b,
    Operator.GREATER: lambda a, b: a > b,
    Operator.GREATER_EQUAL: lambda a, b: a >= b,
    Operator.EQUAL: lambda a, b: a == b,
    Operator.NOT_EQUAL: lambda a, b: not a == b,  # noqa: SIM201 -- the definition
    Operator.NOT: lambda a: not a,
    Operator.AND: lambda a, b: a and b,
    Operator.OR: lambda a, b: a or b,
    Operator.IMPLIES: lambda a, b: not a or b,
}
"""The operators whose results are truth values."""
