"""Programs over intervals: every value that a box of readings may give.

Intervals are mpmath's, with ends of `DIGITS` bits, rounded outward. Where an operation is undefined
for some of the values (a division by zero, the root of a negative number) the interval holds what
it gives for the others, or everything. A truth is the set of the answers that there may be.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import lru_cache
from typing import Any

from mpmath import iv, mp

from pirlc.ir.operators import Operator
from pirlc.ir.policy import Program
from pirlc.ir.types import Type
from pirlc.symbolic.walk import Algebra

DIGITS = 120
"""Bits of an interval's ends; more than those of a float."""

Interval = Any
"""An `ivmpf`: mpmath has no type stubs."""

Possible = Any
"""All values that a box may give: an `Interval`, or a frozenset of truths or discrete actions."""

_TRUE, _FALSE = frozenset((True,)), frozenset((False,))
_EITHER = _TRUE | _FALSE


def _low(x: Interval) -> Any:
    return mp.make_mpf(x._mpi_[0])


def _high(x: Interval) -> Any:
    return mp.make_mpf(x._mpi_[1])


def end(x: Interval, which: int) -> Fraction | None:
    """The lower (0) or upper (1) end, where it is finite."""
    point = mp.make_mpf(x._mpi_[which])
    if not mp.isfinite(point):
        return None
    sign, mantissa, exponent, _ = point._mpf_
    return Fraction(-int(mantissa) if sign else int(mantissa)) * Fraction(2) ** int(exponent)


def _of(low: Any, high: Any) -> Interval:
    return iv.make_mpf((low._mpf_, high._mpf_))


@lru_cache(maxsize=65536)
def between(low: float, high: float) -> Interval:
    """Exact, as `DIGITS` are more than a float has."""
    return iv.mpf((low, high))


def _anything() -> Interval:
    return iv.mpf(["-inf", "inf"])


def _union(a: Interval, b: Interval) -> Interval:
    return _of(min(_low(a), _low(b)), max(_high(a), _high(b)))


def _least(a: Interval, b: Interval) -> Interval:
    return _of(min(_low(a), _low(b)), min(_high(a), _high(b)))


def _greatest(a: Interval, b: Interval) -> Interval:
    return _of(max(_low(a), _low(b)), max(_high(a), _high(b)))


def _quotient(a: Interval, b: Interval) -> Interval:
    """Where zero ends the denominators they may be as close to it as one likes."""
    if _low(b) == 0 < _high(b):
        return a * _of(_low(1 / _of(_high(b), _high(b))), mp.inf)
    if _low(b) < 0 == _high(b):
        return a * _of(-mp.inf, _high(1 / _of(_low(b), _low(b))))
    return a / b


def clip(x: Interval, low: Interval, high: Interval) -> Interval:
    if _high(low) <= _low(high):
        return _greatest(low, _least(x, high))
    return _union(x, _union(low, high))


def _root(x: Interval) -> Interval:
    """Of what has a root in the interval."""
    if _high(x) < 0:
        return _anything()
    return iv.sqrt(_of(max(_low(x), mp.zero), _high(x)))


def _tanh(x: Interval) -> Interval:
    """Rising, so that its ends are those of the interval."""

    def at(point: Any) -> Interval:
        return 1 - 2 / (iv.exp(2 * _of(point, point)) + 1)

    return _of(_low(at(_low(x))), _high(at(_high(x))))


def _sign(x: Interval) -> Interval:
    low, high = (mp.mpf((v > 0) - (v < 0)) for v in (_low(x), _high(x)))
    return _of(low, high)


def _less(a: Interval, b: Interval) -> frozenset[bool]:
    return _TRUE if _high(a) < _low(b) else _FALSE if _low(a) >= _high(b) else _EITHER


def _not(a: frozenset[bool]) -> frozenset[bool]:
    return frozenset(not x for x in a)


def _equal(a: Possible, b: Possible) -> frozenset[bool]:
    if isinstance(a, frozenset):
        return frozenset(x == y for x in a for y in b)
    if _high(a) < _low(b) or _high(b) < _low(a):
        return _FALSE
    return _TRUE if _low(a) == _high(a) == _low(b) == _high(b) else _EITHER


def _combined(operation: Callable[[bool, bool], bool]) -> Callable[..., frozenset[bool]]:
    return lambda a, b: frozenset(operation(x, y) for x in a for y in b)


def _choose(condition: Possible, a: Possible, b: Possible) -> Possible:
    if condition == _EITHER:
        return a | b if isinstance(a, frozenset) else _union(a, b)
    return a if condition == _TRUE else b


def algebra(
    program: Program,
    element: Callable[[str, int], Possible],
    previous: Callable[[str, Type], Possible],
) -> Algebra[Possible]:
    values = program.values
    return Algebra(
        literal=lambda value: between(value, value),
        discrete=lambda value, _type: frozenset((value,)),
        parameter=lambda name: between(values[name], values[name]),
        element=element,
        previous=previous,
        operators=_OPERATORS,
        choose=_choose,
    )


_OPERATORS: dict[Operator, Callable[..., Possible]] = {
    Operator.ADD: lambda a, b: a + b,
    Operator.SUBTRACT: lambda a, b: a - b,
    Operator.MULTIPLY: lambda a, b: a * b,
    Operator.DIVIDE: _quotient,
    Operator.NEGATE: lambda a: -a,
    Operator.ABS: abs,
    Operator.MIN: _least,
    Operator.MAX: _greatest,
    Operator.CLIP: clip,
    Operator.SQRT: _root,
    Operator.EXP: iv.exp,
    Operator.TANH: _tanh,
    Operator.SIGN: _sign,
    Operator.LESS: _less,
    Operator.LESS_EQUAL: lambda a, b: _not(_less(b, a)),
    Operator.GREATER: lambda a, b: _less(b, a),
    Operator.GREATER_EQUAL: lambda a, b: _not(_less(a, b)),
    Operator.EQUAL: _equal,
    Operator.NOT_EQUAL: lambda a, b: _not(_equal(a, b)),
    Operator.NOT: _not,
    Operator.AND: _combined(lambda a, b: a and b),
    Operator.OR: _combined(lambda a, b: a or b),
    Operator.IMPLIES: _combined(lambda a, b: not a or b),
}
