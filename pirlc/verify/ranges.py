"""Between which numbers an action computed in floats can lie.

Rounding to nearest never turns the order of two results around, so an operation on intervals of
floats is the operation on their ends, rounded as the program rounds. Unlike a bound on rounding
errors this loses nothing where a value cannot pass a number that floats hit exactly: three readings
of at most 1 add up to at most 3.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import product

from pirlc.ir.operators import COMPARISONS, Operator
from pirlc.ir.policy import ActionSpec, Choice, Continuous, Program
from pirlc.semantics.interpreter import ARITHMETIC
from pirlc.semantics.precision import Precision, widened
from pirlc.symbolic.walk import Algebra, walk


@dataclass(frozen=True, slots=True)
class Ends:
    """The least and the largest number that a result can be; both finite."""

    low: float
    high: float


Range = Ends | None
"""None: not known, or not a real."""


def running_ranges(program: Program, precision: Precision) -> Mapping[str, Ends]:
    """By continuous action the range of its raw result, computed in the precision from readings in
    the sensors' widened ranges; without those for which none was found."""
    found = {}
    algebra = _algebra(program, precision)
    for spec, body in zip(program.interface.actions, program.bodies, strict=True):
        if isinstance(spec.domain, Continuous):
            ends = walk(body, algebra)
            if ends is not None:
                found[spec.name] = ends
    return found


def _algebra(program: Program, precision: Precision) -> Algebra[Range]:
    sensors = {s.name: widened(s.lower, s.upper) for s in program.interface.sensors}
    parameters = {name: precision.round(value) for name, value in program.values.items()}
    actions = {spec.name: _domain(spec, precision) for spec in program.interface.actions}

    def corners(operator: Operator) -> Callable[..., Range]:
        """An operator that rises or falls in each argument: its extremes are at the ends."""
        operation = ARITHMETIC[operator]

        def applied(*ranges: Range) -> Range:
            known = [(ends.low, ends.high) for ends in ranges if ends is not None]
            if len(known) < len(ranges):
                return None
            return _known(precision.round(operation(*ends)) for ends in product(*known))

        return applied

    def divide(a: Range, b: Range) -> Range:
        # Also a denominator of either sign, where the quotient is not monotone.
        return None if b is None or b.low <= 0.0 <= b.high else corners(Operator.DIVIDE)(a, b)

    def absolute(a: Range) -> Range:
        if a is None:
            return None
        least = 0.0 if a.low <= 0.0 <= a.high else min(abs(a.low), abs(a.high))
        return Ends(least, max(abs(a.low), abs(a.high)))

    def clip(x: Range, low: Range, high: Range) -> Range:
        # Where the bounds cross, `clip` is not monotone.
        if low is None or high is None or low.high > high.low:
            return None
        return corners(Operator.CLIP)(x, low, high)

    def choose(_: Range, yes: Range, no: Range) -> Range:
        if yes is None or no is None:
            return None
        return Ends(min(yes.low, no.low), max(yes.high, no.high))

    monotone = (
        Operator.ADD,
        Operator.SUBTRACT,
        Operator.MULTIPLY,
        Operator.NEGATE,
        Operator.MIN,
        Operator.MAX,
        Operator.SQRT,
        Operator.SIGN,
    )
    truths = (*COMPARISONS, Operator.NOT, Operator.AND, Operator.OR, Operator.IMPLIES)
    return Algebra(
        literal=lambda value: _known([precision.round(value)]),
        discrete=lambda *_: None,
        parameter=lambda name: _known([parameters[name]]),
        element=lambda sensor, _: _known(sensors[sensor]),
        previous=lambda action, _: actions[action],
        operators={
            **{operator: corners(operator) for operator in monotone},
            **dict.fromkeys(truths, lambda *_: None),
            # What a C library answers need not be monotone.
            **dict.fromkeys((Operator.EXP, Operator.TANH), lambda _: None),
            Operator.DIVIDE: divide,
            Operator.ABS: absolute,
            Operator.CLIP: clip,
        },
        choose=choose,
    )


def _domain(spec: ActionSpec, precision: Precision) -> Range:
    match spec.domain:
        case Continuous(lower, upper):
            return _known([precision.round(lower), precision.round(upper)])
        case Choice():
            return None


def _known(numbers: Iterable[float]) -> Range:
    values = list(numbers)
    return Ends(min(values), max(values)) if all(map(math.isfinite, values)) else None
