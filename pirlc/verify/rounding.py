"""How far what runs in binary64 or binary32 can be from real arithmetic.

Goals: for every action, and for the two sides of every comparison, a bound on the distance between
what the interpreter computes and what the same expressions give in real arithmetic on the same
readings, on the condition that all comparisons decide alike. Then a proof about reals carries
over: an action is off by at most its bound, and a comparison can be decided otherwise only where
its sides are closer than its margin.
Non-goals: the tightest bound there is; expressions whose ranges overlap a division by zero or an
overflow (they have no bound here).

The standard model of floating-point arithmetic: each operation is off by half a unit in the last
place of the largest result it may have, or by half the smallest denormal number (N. Higham,
"Accuracy and Stability of Numerical Algorithms", 2nd ed., SIAM 2002, section 2). Readings are
numbers of the working precision in the sensors' (widened) ranges; in real arithmetic constants and
parameters are the binary64 numbers, so that in binary32 their rounding counts. `min max abs clip`
and the choice between branches move no further apart than what they choose from. Ranges and errors
are Arb's balls (rigorous, rounded outward).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction

from flint import arb

from pirlc.ir.operators import COMPARISONS, Operator
from pirlc.ir.policy import ActionSpec, Choice, Continuous, Program
from pirlc.semantics.precision import Precision, widened
from pirlc.symbolic.walk import Algebra, walk

EXP_UNITS = 2
"""The most units in the last place that `exp` of a C library may be off (docs/semantics.md)."""
TANH_UNITS = 4
"""The same for `tanh`."""


@dataclass(frozen=True)
class StepRounding:
    """Bounds for one step, by action; None where no finite bound was found.

    `raw` and `applied`: the distance before and after clipping. `margins`: for each occurrence of a
    comparison or a `sign`, as `symbolic.z3_form.GuardKey` counts them, the sides' distance up to
    which rounding may turn it (0: never). `partials`: for each occurrence of a division or a square
    root, as `symbolic.z3_form.Records` lists them, how far off the denominator is, or what the root
    is taken of (0 too where that is not negative in either arithmetic).
    """

    raw: Mapping[str, float | None]
    applied: Mapping[str, float]
    margins: Mapping[str, tuple[float | None, ...]]
    partials: Mapping[str, tuple[float | None, ...]]


@dataclass(frozen=True)
class RoundingBounds:
    """`steps` in a row, oldest first: what a step applied is the next one's `previous`."""

    precision: Precision
    steps: tuple[StepRounding, ...]


def rounding(program: Program, precision: Precision, steps: int = 1) -> RoundingBounds:
    """Bounds over all histories of good readings, `previous` before the first step being any
    number of the working precision between the action's bounds."""
    numbers = _NUMBERS[precision]
    previous = {
        action.name: _free_previous(action, precision) for action in program.interface.actions
    }
    found = []
    for _ in range(steps):
        raw: dict[str, float | None] = {}
        applied: dict[str, float] = {}
        margins: dict[str, tuple[float | None, ...]] = {}
        partials: dict[str, tuple[float | None, ...]] = {}
        following: dict[str, Value] = {}
        for action, body in zip(program.interface.actions, program.bodies, strict=True):
            met = _Met([], [])
            result = walk(body, _algebra(program, precision, numbers, previous, met))
            margins[action.name] = tuple(met.margins)
            partials[action.name] = tuple(met.partials)
            following[action.name] = after = _applied(action, result, precision)
            match action.domain:
                case Continuous():
                    assert isinstance(after, Ball)
                    raw[action.name] = _upward(result.error) if isinstance(result, Ball) else None
                    applied[action.name] = _upward(after.error)
                case Choice():
                    raw[action.name] = applied[action.name] = 0.0
        found.append(StepRounding(raw, applied, margins, partials))
        previous = following
    return RoundingBounds(precision, tuple(found))


@dataclass(frozen=True, slots=True)
class Ball:
    """Encloses the value in real arithmetic; `error` bounds the distance of the computed one.

    `nonnegative`: neither the real nor the computed value is below zero (a ball cannot end at
    exactly zero).
    """

    range: arb
    error: arb
    nonnegative: bool = False

    @property
    def largest(self) -> arb:
        """No value, real or computed, is larger in size."""
        return (self.range.abs_upper() + self.error).upper()


class Decided:
    """A truth value or a discrete action: the same in both arithmetics."""


Value = Ball | Decided | None
"""None: no finite bound."""

_DECIDED = Decided()
_ZERO = arb(0)


@dataclass(frozen=True)
class _Numbers:
    """A binary format: digits of the significand, exponent of the smallest denormal, largest."""

    digits: int
    smallest: int
    largest: float

    def unit(self, size: arb) -> arb:
        """The distance of neighbouring numbers that are `size` at most."""
        mantissa, exponent = size.upper().man_exp()
        if not mantissa:
            return arb(2) ** self.smallest
        place = int(exponent) + int(mantissa).bit_length() - self.digits
        return arb(2) ** max(place, self.smallest)

    def half_unit(self, size: arb) -> arb:
        """Bounds the rounding of a result that is `size` at most."""
        relative = size * arb(2) ** -self.digits
        return relative.min(self.unit(size) / 2).max(arb(2) ** (self.smallest - 1)).upper()


_NUMBERS = {
    Precision.BINARY64: _Numbers(53, -1074, math.ldexp(1.0 - 2.0**-53, 1024)),
    Precision.BINARY32: _Numbers(24, -149, math.ldexp(1.0 - 2.0**-24, 128)),
}


def _between(lower: float, upper: float) -> arb:
    return arb(lower).union(arb(upper))


def _free_previous(action: ActionSpec, precision: Precision) -> Value:
    match action.domain:
        case Continuous(lower, upper):
            error = _bound_error(lower, upper, precision)
            return Ball(_bounds(lower, upper, precision), error, lower >= 0)
        case Choice():
            return _DECIDED


def _bound_error(lower: float, upper: float, precision: Precision) -> arb:
    """How far an action's bounds move when they are rounded to the working precision."""
    return _constant_error(lower, precision).max(_constant_error(upper, precision))


def _bounds(lower: float, upper: float, precision: Precision) -> arb:
    """What the action may be, in real arithmetic and in the working precision."""
    rounded = _between(precision.round(lower), precision.round(upper))
    return _between(lower, upper).union(rounded)


def _constant_error(x: float, precision: Precision) -> arb:
    return abs(arb(precision.round(x)) - arb(x)).upper()


def _applied(action: ActionSpec, result: Value, precision: Precision) -> Value:
    """The action after clipping: inside its bounds whatever happened before."""
    match action.domain:
        case Continuous(lower, upper):
            bounds = _bound_error(lower, upper, precision)
            error = (arb(upper) - arb(lower) + bounds).upper()
            if isinstance(result, Ball):
                error = error.min(result.error.max(bounds)).upper()
            return Ball(_bounds(lower, upper, precision), error, lower >= 0)
        case Choice():
            return _DECIDED


def _upward(x: arb) -> float:
    """The least binary64 number found that is not below `x`."""
    mantissa, exponent = x.upper().man_exp()
    exact = Fraction(int(mantissa)) * Fraction(2) ** int(exponent)
    near = float(exact)
    return near if Fraction(near) >= exact else math.nextafter(near, math.inf)


@dataclass(frozen=True)
class _Met:
    """What a walk has met so far: see `StepRounding`."""

    margins: list[float | None]
    partials: list[float | None]


def _algebra(
    program: Program,
    precision: Precision,
    numbers: _Numbers,
    previous: Mapping[str, Value],
    met: _Met,
) -> Algebra[Value]:
    ranges = {
        sensor.name: widened(sensor.lower, sensor.upper) for sensor in program.interface.sensors
    }
    values = program.values

    def settle(exact: arb, error: arb, nonnegative: bool) -> Value:
        """The value, unless it may leave the format's numbers."""
        value = Ball(exact, error.upper(), nonnegative)
        return value if value.largest <= numbers.largest else None

    def constant(x: float) -> Value:
        if not math.isfinite(precision.round(x)):
            return None
        return Ball(arb(x), _constant_error(x, precision), x >= 0)

    def element(sensor: str, _index: int) -> Value:
        lower, upper = ranges[sensor]
        if not (math.isfinite(lower) and math.isfinite(upper)):
            return None
        return Ball(_between(lower, upper), _ZERO, lower >= 0)

    def rounded(exact: arb, carried: arb, nonnegative: bool, loses: bool = True) -> Value:
        """A result whose operands' errors have moved it by `carried`, rounded (if it `loses`)."""
        size = (exact.abs_upper() + carried).upper()
        if not size.is_finite():
            return None
        return settle(exact, carried + numbers.half_unit(size) if loses else carried, nonnegative)

    def add(a: Ball, b: Ball) -> Value:
        loses = not (_is_zero(a) or _is_zero(b))
        both = a.nonnegative and b.nonnegative
        return rounded(a.range + b.range, a.error + b.error, both, loses)

    def subtract(a: Ball, b: Ball) -> Value:
        loses = not (_is_zero(a) or _is_zero(b))
        return rounded(a.range - b.range, a.error + b.error, False, loses)

    def multiply(a: Ball, b: Ball) -> Value:
        carried = a.largest * b.error + b.range.abs_upper() * a.error
        loses = not any(_is_constant(x) and abs(x.range) in (arb(0), arb(1)) for x in (a, b))
        both = a.nonnegative and b.nonnegative
        return rounded(a.range * b.range, carried.upper(), both, loses)

    def divide(a: Value, b: Value) -> Value:
        met.partials.append(_upward(b.error) if isinstance(b, Ball) else None)
        return quotient(a, b) if isinstance(a, Ball) and isinstance(b, Ball) else None

    def quotient(a: Ball, b: Ball) -> Value:
        least = b.range.abs_lower().lower()
        nearest = (least - b.error).lower()
        if not nearest > 0:
            return None
        exact = a.range / b.range
        carried = ((a.error + a.range.abs_upper() / least * b.error) / nearest).upper()
        both = a.nonnegative and b.nonnegative
        return rounded(exact, carried, both)

    def absolute(a: Ball) -> Value:
        return Ball(abs(a.range), a.error, True)

    def least(a: Ball, b: Ball) -> Value:
        both = a.nonnegative and b.nonnegative
        return Ball(a.range.min(b.range), a.error.max(b.error), both)

    def greatest(a: Ball, b: Ball) -> Value:
        either = a.nonnegative or b.nonnegative
        return Ball(a.range.max(b.range), a.error.max(b.error), either)

    def clip(x: Ball, low: Ball, high: Ball) -> Value:
        error = x.error.max(low.error).max(high.error)
        # Where the bounds may be crossed, `clip` jumps between them.
        crossed = (low.range.upper() - high.range.lower() + low.error + high.error).upper()
        if not crossed > 0:
            return Ball(x.range.min(high.range).max(low.range), error, low.nonnegative)
        hull = low.range.union(high.range).union(x.range)
        nonnegative = x.nonnegative and low.nonnegative and high.nonnegative
        return Ball(hull, (error + 2 * crossed).upper(), nonnegative)

    def square_root(a: Value) -> Value:
        if not isinstance(a, Ball):
            met.partials.append(None)
            return None
        met.partials.append(0.0 if a.nonnegative else _upward(a.error))
        return root(a)

    def root(a: Ball) -> Value:
        low = (a.range.lower() - a.error).lower()
        if not (a.nonnegative or low >= 0):
            return None
        carried = a.error.sqrt().upper()
        if low > 0:
            carried = carried.min(a.error / (2 * low.sqrt())).upper()
        top = a.range.upper().sqrt()
        bottom = a.range.lower().sqrt() if low > 0 else _ZERO
        return rounded(bottom.union(top), carried, True)

    def exponential(a: Ball) -> Value:
        top = (a.range.upper() + a.error).exp()
        exact = a.range.lower().exp().union(a.range.upper().exp())
        return libm(exact, (top * a.error).upper(), EXP_UNITS, True)

    def hyperbolic(a: Ball) -> Value:
        exact = a.range.lower().tanh().union(a.range.upper().tanh())
        return libm(exact, a.error, TANH_UNITS, a.nonnegative)

    def libm(exact: arb, carried: arb, units: int, nonnegative: bool) -> Value:
        # A little more than the largest result, so that its neighbours have the same unit.
        size = (exact.abs_upper() + carried).upper() * (1 + arb(2) ** -16)
        unit = numbers.unit(size) if size.is_finite() else arb.pos_inf()
        return settle(exact, carried + units * unit, nonnegative)

    def negate(a: Ball) -> Value:
        return Ball(-a.range, a.error)

    def sign(a: Value) -> Value:
        met.margins.append(_upward(a.error) if isinstance(a, Ball) else None)
        return Ball(_between(-1.0, 1.0), _ZERO, isinstance(a, Ball) and a.nonnegative)

    def compare(a: Value, b: Value) -> Value:
        if isinstance(a, Decided):
            met.margins.append(0.0)
        elif isinstance(a, Ball) and isinstance(b, Ball):
            met.margins.append(_upward(a.error + b.error))
        else:
            met.margins.append(None)
        return _DECIDED

    def choose(_condition: Value, a: Value, b: Value) -> Value:
        if isinstance(a, Decided):
            return _DECIDED
        if a is None or b is None:
            return None
        assert isinstance(b, Ball)
        both = a.nonnegative and b.nonnegative
        return Ball(a.range.union(b.range), a.error.max(b.error), both)

    def strict(operation: Callable[..., Value]) -> Callable[..., Value]:
        """No bound comes of no bound."""
        return lambda *values: None if None in values else operation(*values)

    return Algebra(
        literal=constant,
        discrete=lambda _value, _type: _DECIDED,
        parameter=lambda name: constant(values[name]),
        element=element,
        previous=lambda action, _type: previous[action],
        operators={
            Operator.ADD: strict(add),
            Operator.SUBTRACT: strict(subtract),
            Operator.MULTIPLY: strict(multiply),
            Operator.DIVIDE: divide,
            Operator.NEGATE: strict(negate),
            Operator.ABS: strict(absolute),
            Operator.MIN: strict(least),
            Operator.MAX: strict(greatest),
            Operator.CLIP: strict(clip),
            Operator.SQRT: square_root,
            Operator.EXP: strict(exponential),
            Operator.TANH: strict(hyperbolic),
            Operator.SIGN: sign,
            **dict.fromkeys(COMPARISONS, compare),
            **dict.fromkeys(_LOGIC, lambda *_truths: _DECIDED),
        },
        choose=choose,
    )


_LOGIC = (Operator.NOT, Operator.AND, Operator.OR, Operator.IMPLIES)


def _is_constant(a: Ball) -> bool:
    return bool(a.range.is_exact()) and bool(a.error == 0)


def _is_zero(a: Ball) -> bool:
    return _is_constant(a) and bool(a.range == 0)
