"""Whether a property holds of steps that were run: exact arithmetic on the numbers that came out.

A property is a statement about numbers, so its own arithmetic is not rounded: sums and differences
of the readings and actions are taken as fractions. Where a number is infinite or NaN, or a function
has no rational value, the interpreter's rules for binary64 take over.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction

from pirlc.ir.operators import COMPARISONS, Operator
from pirlc.ir.policy import Program, Property
from pirlc.ir.terms import Term
from pirlc.ir.types import Type
from pirlc.semantics.interpreter import ARITHMETIC, TRUTH
from pirlc.symbolic.walk import Algebra, walk
from pirlc.symbolic.z3_functions import sqrt_enclosure
from pirlc.verify.replay import Observed

Number = Fraction | float | bool
"""A real: a fraction where it is finite and known exactly, else a float. Or a truth value."""


def holds(program: Program, claim: Property, steps: Sequence[Observed]) -> bool:
    """Whether the property is true of these steps, oldest first."""
    return bool(value_of(program, claim, claim.body, steps))


def value_of(program: Program, claim: Property, part: Term, steps: Sequence[Observed]) -> Number:
    """The value of a part of the property (an atom without local names of the rest)."""
    parameters = {name: _number(value) for name, value in program.values.items()}

    def element(sensor: str, index: int) -> Number:
        if not claim.ranged:
            return _number(steps[-1].windows[sensor][index])
        return _number(steps[index].windows[sensor][-1])

    def values(numbers: Sequence[float]) -> Number | tuple[Number, ...]:
        return tuple(map(_number, numbers)) if claim.ranged else _number(numbers[-1])

    def action(name: str, raw: bool, _: Type) -> Number | tuple[Number, ...]:
        return values([(step.raw if raw else step.applied)[name] for step in steps])

    algebra: Algebra[Number] = Algebra(
        literal=_number,
        discrete=lambda value, _: Fraction(value),
        parameter=lambda name: parameters[name],
        element=element,
        previous=lambda name, _: values([step.previous[name] for step in steps]),
        operators=OPERATORS,
        choose=lambda condition, yes, no: yes if condition else no,
        action=action,
    )
    return walk(part, algebra)


def _number(value: float) -> Number:
    return Fraction(value) if math.isfinite(value) else value


def _rounded(operator: Operator, *values: Number) -> Number:
    return _number(ARITHMETIC[operator](*(_float(value) for value in values)))


def _float(value: Number) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def _exactly(
    operator: Operator, operation: Callable[..., Fraction | None]
) -> Callable[..., Number]:
    """The operation on fractions; the interpreter's where it has no answer or a float comes in."""

    def computed(*values: Number) -> Number:
        if all(isinstance(value, Fraction) for value in values):
            result = operation(*values)
            if result is not None:
                return result
        return _rounded(operator, *values)

    return computed


def _root(x: Fraction) -> Fraction | None:
    if x < 0:
        return None
    low, high = sqrt_enclosure(x)
    return low if low == high else None


_EXACT: dict[Operator, Callable[..., Fraction | None]] = {
    Operator.ADD: lambda a, b: a + b,
    Operator.SUBTRACT: lambda a, b: a - b,
    Operator.MULTIPLY: lambda a, b: a * b,
    Operator.DIVIDE: lambda a, b: None if b == 0 else a / b,
    Operator.NEGATE: lambda a: -a,
    Operator.ABS: abs,
    Operator.MIN: lambda a, b: a if a < b else b,
    Operator.MAX: lambda a, b: a if a > b else b,
    Operator.CLIP: lambda x, low, high: low if x < low else high if x > high else x,
    Operator.SQRT: _root,
    Operator.EXP: lambda _: None,
    Operator.TANH: lambda _: None,
    Operator.SIGN: lambda a: Fraction((a > 0) - (a < 0)),
}

OPERATORS: dict[Operator, Callable[..., Number]] = {
    **{operator: _exactly(operator, operation) for operator, operation in _EXACT.items()},
    **{operator: TRUTH[operator] for operator in COMPARISONS},
    Operator.NOT: lambda a: not a,
    Operator.AND: lambda a, b: a and b,
    Operator.OR: lambda a, b: a or b,
    Operator.IMPLIES: lambda a, b: not a or b,
}
"""Python compares fractions and floats exactly, NaN as IEEE does."""
