"""Terms as affine laws: exact over the rationals, or the tangent at an operating point.

Forward differentiation over `symbolic.walk`: each real is its value at the operating point and its
gradient by the inputs, as fractions, and whether it is affine there everywhere. What needs libm
(sqrt, exp, tanh) is rounded to binary64 before it becomes a fraction: these are tangents anyway.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import assert_never

from pirlc.ir.operators import Operator
from pirlc.ir.policy import Program
from pirlc.ir.terms import Term
from pirlc.ir.types import Discrete, Type
from pirlc.symbolic.walk import Algebra, walk


@dataclass(frozen=True, slots=True)
class Reading:
    """A reading `age` steps older than the newest that the program sees."""

    sensor: str
    age: int


@dataclass(frozen=True, slots=True)
class Earlier:
    """The action of the step before."""

    action: str


Input = Reading | Earlier


@dataclass(frozen=True)
class OperatingPoint:
    """Readings by sensor and actions by name, at rest: all elements of a window are the same."""

    readings: Mapping[str, Fraction]
    actions: Mapping[str, Fraction]

    def of(self, which: Input) -> Fraction:
        match which:
            case Reading(sensor):
                return self.readings[sensor]
            case Earlier(action):
                return self.actions[action]
            case _:
                assert_never(which)


@dataclass(frozen=True)
class Real:
    """`bent` names what keeps it from being affine; empty: it is affine everywhere. `broken` says
    why it has a value here but no gradient: a corner, a jump."""

    value: Fraction
    gradient: Mapping[Input, Fraction]
    bent: frozenset[str] = frozenset()
    broken: str = ""

    @property
    def constant(self) -> bool:
        return not (self.gradient or self.bent or self.broken)


@dataclass(frozen=True)
class Truth:
    """At the operating point."""

    holds: bool


Value = Real | Truth


class NoTangentError(Exception):
    """The term has no value or no derivative at the operating point; the text says why."""


def tangent(term: Term, program: Program, at: OperatingPoint) -> Real:
    """The value and the gradient of a real term. Raises NoTangentError."""
    result = walk(term, _algebra(program, at))
    assert isinstance(result, Real)
    if result.broken:
        raise NoTangentError(result.broken)
    return result


def holds(term: Term, program: Program, at: OperatingPoint) -> bool:
    """Whether a condition holds at the operating point. Raises NoTangentError."""
    result = walk(term, _algebra(program, at))
    assert isinstance(result, Truth)
    return result.holds


def _algebra(program: Program, at: OperatingPoint) -> Algebra[Value]:
    values = program.values

    def element(sensor: str, index: int) -> Value:
        reading = Reading(sensor, -1 - index)
        return Real(at.of(reading), {reading: Fraction(1)})

    def previous(action: str, type_: Type) -> Value:
        earlier = Earlier(action)
        # A discrete one is only ever compared: it has no slope.
        slope: dict[Input, Fraction] = {} if isinstance(type_, Discrete) else {earlier: _ONE}
        return Real(at.of(earlier), slope)

    def discrete(value: int, type_: Discrete) -> Value:
        del type_
        return _number(value)

    return Algebra(
        literal=_number,
        discrete=discrete,
        parameter=lambda name: _number(values[name]),
        element=element,
        previous=previous,
        operators=_OPERATORS,
        choose=_choose,
    )


def _number(value: float) -> Real:
    return Real(Fraction(value), {})


def _joined(
    value: Fraction,
    a: Real,
    by_a: Fraction,
    b: Real,
    by_b: Fraction,
    bent: frozenset[str] = frozenset(),
) -> Real:
    """A function of a and b with these derivatives by them."""
    gradient = {name: by_a * slope for name, slope in a.gradient.items()}
    for name, slope in b.gradient.items():
        gradient[name] = gradient.get(name, Fraction(0)) + by_b * slope
    return Real(
        value,
        {name: slope for name, slope in gradient.items() if slope},
        a.bent | b.bent | bent,
        a.broken or b.broken,
    )


_ONE, _MINUS = Fraction(1), Fraction(-1)
_NOTHING = _number(0)


def _add(a: Real, b: Real) -> Real:
    return _joined(a.value + b.value, a, _ONE, b, _ONE)


def _subtract(a: Real, b: Real) -> Real:
    return _joined(a.value - b.value, a, _ONE, b, _MINUS)


def _multiply(a: Real, b: Real) -> Real:
    # A factor that is the number 0 leaves nothing, however bent the other is.
    if (a.constant and not a.value) or (b.constant and not b.value):
        return _NOTHING
    product = frozenset[str]() if a.constant or b.constant else frozenset({"a product"})
    return _joined(a.value * b.value, a, b.value, b, a.value, product)


def _divide(a: Real, b: Real) -> Real:
    if not b.value:
        raise NoTangentError("a division by zero")
    quotient = frozenset[str]() if b.constant else frozenset({"a quotient"})
    return _joined(a.value / b.value, a, 1 / b.value, b, -a.value / b.value**2, quotient)


def _negate(a: Real) -> Real:
    return _joined(-a.value, a, _MINUS, _NOTHING, _ONE)


def _pick(chosen: Real, others: tuple[Real, ...], what: str, corner: bool = False) -> Real:
    """`chosen`, known to be one of several by a comparison at the operating point."""
    if all(other == chosen for other in others):
        return chosen
    everything = (chosen, *others)
    if all(value.constant for value in everything):
        return chosen
    broken = next((value.broken for value in everything if value.broken), "")
    if corner:
        broken = broken or f"the corner of {what}"
    bent = frozenset[str]().union(*(value.bent for value in everything))
    return Real(chosen.value, chosen.gradient, bent | {what}, broken)


def _tied(a: Real, b: Real) -> bool:
    return a.value == b.value and a.gradient != b.gradient


def _abs(a: Real) -> Real:
    negative = _negate(a)
    if a.value < 0:
        return _pick(negative, (a,), "an abs")
    return _pick(a, (negative,), "an abs", _tied(a, negative))


def _min(a: Real, b: Real) -> Real:
    return _pick(*((a, (b,)) if a.value < b.value else (b, (a,))), "a min", _tied(a, b))


def _max(a: Real, b: Real) -> Real:
    return _pick(*((a, (b,)) if a.value > b.value else (b, (a,))), "a max", _tied(a, b))


def _clip(x: Real, low: Real, high: Real) -> Real:
    if x.value < low.value:
        return _pick(low, (x, high), "a clip")
    if x.value > high.value:
        return _pick(high, (x, low), "a clip", _tied(x, low))
    return _pick(x, (low, high), "a clip", _tied(x, low) or _tied(x, high))


def _sign(a: Real) -> Real:
    value = Fraction((a.value > 0) - (a.value < 0))
    if a.constant:
        return Real(value, {})
    jump = "" if a.value or not a.gradient else "the jump of a sign"
    return Real(value, {}, a.bent | {"a sign"}, a.broken or jump)


def _function(
    name: str, compute: Callable[[float], float], slope: Callable[[float, float], float]
) -> Callable[[Real], Real]:
    """A function of one real; `slope(x, f(x))` is its derivative."""

    def apply(a: Real) -> Real:
        try:
            x = float(a.value)
            result = compute(x)
        except (ValueError, OverflowError):
            raise NoTangentError(f"{name} of {_short(a.value)}") from None
        value = Fraction(result)
        if a.constant:
            return Real(value, {})
        try:
            by = Fraction(slope(x, result))
        except ZeroDivisionError:
            return Real(value, {}, a.bent | {name}, a.broken or f"{name} of {x:g}")
        return _joined(value, a, by, _NOTHING, _ONE, frozenset({name}))

    return apply


def _short(value: Fraction) -> str:
    try:
        return f"{float(value):g}"
    except OverflowError:
        return "a number that is too large"


def _compare(decide: Callable[[Fraction, Fraction], bool]) -> Callable[[Real, Real], Truth]:
    return lambda a, b: Truth(decide(a.value, b.value))


def _choose(condition: Value, yes: Value, no: Value) -> Value:
    assert isinstance(condition, Truth)
    if isinstance(yes, Truth):
        return yes if condition.holds else no
    assert isinstance(yes, Real) and isinstance(no, Real)
    chosen, other = (yes, no) if condition.holds else (no, yes)
    return _pick(chosen, (other,), "an if")


_OPERATORS: dict[Operator, Callable[..., Value]] = {
    Operator.ADD: _add,
    Operator.SUBTRACT: _subtract,
    Operator.MULTIPLY: _multiply,
    Operator.DIVIDE: _divide,
    Operator.NEGATE: _negate,
    Operator.ABS: _abs,
    Operator.MIN: _min,
    Operator.MAX: _max,
    Operator.CLIP: _clip,
    Operator.SIGN: _sign,
    Operator.SQRT: _function("a square root", math.sqrt, lambda _, y: 0.5 / y),
    Operator.EXP: _function("an exp", math.exp, lambda _, y: y),
    Operator.TANH: _function("a tanh", math.tanh, lambda _, y: 1.0 - y * y),
    Operator.LESS: _compare(lambda a, b: a < b),
    Operator.LESS_EQUAL: _compare(lambda a, b: a <= b),
    Operator.GREATER: _compare(lambda a, b: a > b),
    Operator.GREATER_EQUAL: _compare(lambda a, b: a >= b),
    Operator.EQUAL: _compare(lambda a, b: a == b),
    Operator.NOT_EQUAL: _compare(lambda a, b: a != b),
    Operator.NOT: lambda a: Truth(not a.holds),
    Operator.AND: lambda a, b: Truth(a.holds and b.holds),
    Operator.OR: lambda a, b: Truth(a.holds or b.holds),
    Operator.IMPLIES: lambda a, b: Truth(not a.holds or b.holds),
}
