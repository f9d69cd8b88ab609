"""Where a template agrees with the oracle, as a formula over guards that are affine in parameters.

Symbolic execution over N histories at once. What depends on the histories alone is computed in
binary64; what depends on parameters is affine in them, with other coefficients in each history, or
a choice among such. The shape of the formula is the same in all histories, so that it is made once
and read off for any of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pirlc.ir.operators import Operator
from pirlc.ir.policy import ActionSpec, Choice, FixedParameter, ProgramTemplate
from pirlc.ir.types import Discrete, Type
from pirlc.semantics.histories import HistorySet
from pirlc.symbolic.walk import Algebra, walk

Numbers = NDArray[np.float64]
Flags = NDArray[np.bool_]

MOST_CASES = 64
"""The cases that one value may have; `min`, `abs`, `if` and the like make them."""


class BeyondReachError(Exception):
    """A template that is not piecewise affine in the parameters; the message says why."""


@dataclass(frozen=True, eq=False)
class Affine:
    """`offset` (N,) plus, for a parameter's number, `slopes[number]` (N,) times the parameter."""

    offset: Numbers
    slopes: Mapping[int, Numbers] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Known:
    """Truth values (N,) that no parameter changes."""

    values: Flags


@dataclass(frozen=True, eq=False)
class Guard:
    """Whether `left` is positive; with `at_zero`, whether it is not negative."""

    left: Affine
    at_zero: bool


@dataclass(frozen=True, eq=False)
class Not:
    of: Truth


@dataclass(frozen=True, eq=False)
class Both:
    a: Truth
    b: Truth


@dataclass(frozen=True, eq=False)
class Cases:
    """`yes` where the condition holds, else `no`; reals or discrete actions."""

    condition: Truth
    yes: Real
    no: Real


Truth = Known | Guard | Not | Both
Real = Affine | Cases


def negation(a: Truth) -> Truth:
    match a:
        case Known(values):
            return Known(~values)
        case Not(of):
            return of
        case _:
            return Not(a)


def both(a: Truth, b: Truth) -> Truth:
    if isinstance(a, Known) and isinstance(b, Known):
        return Known(a.values & b.values)
    for known, other in ((a, b), (b, a)):
        if isinstance(known, Known):
            if known.values.all():
                return other
            if not known.values.any():
                return known
    return Both(a, b)


def either(a: Truth, b: Truth) -> Truth:
    return negation(both(negation(a), negation(b)))


def by_cases(condition: Truth, yes: Truth, no: Truth) -> Truth:
    return either(both(condition, yes), both(negation(condition), no))


def choose(condition: Truth, yes: Real, no: Real) -> Real:
    if isinstance(condition, Known) and isinstance(yes, Affine) and isinstance(no, Affine):
        at = condition.values
        zero = np.zeros(1)
        slopes = {
            j: np.where(at, yes.slopes.get(j, zero), no.slopes.get(j, zero))
            for j in sorted(yes.slopes.keys() | no.slopes.keys())
        }
        return Affine(np.where(at, yes.offset, no.offset), slopes)
    found = Cases(condition, yes, no)
    if _cases(found) > MOST_CASES:
        raise BeyondReachError(f"a value of more than {MOST_CASES} cases")
    return found


def _cases(value: Real) -> int:
    return _cases(value.yes) + _cases(value.no) if isinstance(value, Cases) else 1


def _each(change: Callable[[Affine], Real], value: Real) -> Real:
    if isinstance(value, Cases):
        return choose(value.condition, _each(change, value.yes), _each(change, value.no))
    return change(value)


def _pairs(change: Callable[[Affine, Affine], Real], a: Real, b: Real) -> Real:
    return _each(lambda x: _each(lambda y: change(x, y), b), a)


def _add(a: Affine, b: Affine) -> Affine:
    slopes = dict(a.slopes)
    for j, slope in b.slopes.items():
        slopes[j] = slopes[j] + slope if j in slopes else slope
    return Affine(a.offset + b.offset, slopes)


def _times(a: Affine, factor: Numbers) -> Affine:
    return Affine(a.offset * factor, {j: slope * factor for j, slope in a.slopes.items()})


def _negate(a: Affine) -> Affine:
    return Affine(-a.offset, {j: -slope for j, slope in a.slopes.items()})


def _subtract(a: Affine, b: Affine) -> Affine:
    return _add(a, _negate(b))


def _multiply(a: Affine, b: Affine) -> Affine:
    if not b.slopes:
        return _times(a, b.offset)
    if not a.slopes:
        return _times(b, a.offset)
    raise BeyondReachError("a product of values that depend on parameters")


def _divide(a: Affine, b: Affine) -> Affine:
    if b.slopes:
        raise BeyondReachError("a quotient by a value that depends on a parameter")
    return Affine(a.offset / b.offset, {j: slope / b.offset for j, slope in a.slopes.items()})


_DATA: dict[Operator, Callable[[Numbers, Numbers], Flags]] = {
    Operator.LESS: np.less,
    Operator.LESS_EQUAL: np.less_equal,
    Operator.GREATER: np.greater,
    Operator.GREATER_EQUAL: np.greater_equal,
    Operator.EQUAL: np.equal,
    Operator.NOT_EQUAL: np.not_equal,
}


def _relation(relation: Operator, a: Affine, b: Affine) -> Truth:
    if not a.slopes and not b.slopes:
        return Known(np.asarray(_DATA[relation](a.offset, b.offset)))
    match relation:
        case Operator.GREATER:
            return Guard(_subtract(a, b), False)
        case Operator.GREATER_EQUAL:
            return Guard(_subtract(a, b), True)
        case Operator.LESS:
            return Guard(_subtract(b, a), False)
        case Operator.LESS_EQUAL:
            return Guard(_subtract(b, a), True)
        case Operator.EQUAL:
            return both(Guard(_subtract(a, b), True), Guard(_subtract(b, a), True))
        case _:
            return negation(_relation(Operator.EQUAL, a, b))


def compare(relation: Operator, a: Real, b: Real) -> Truth:
    if isinstance(a, Cases):
        yes, no = compare(relation, a.yes, b), compare(relation, a.no, b)
        return by_cases(a.condition, yes, no)
    if isinstance(b, Cases):
        yes, no = compare(relation, a, b.yes), compare(relation, a, b.no)
        return by_cases(b.condition, yes, no)
    return _relation(relation, a, b)


def _function(function: np.ufunc, name: str) -> Callable[[Real], Real]:
    def applied(x: Affine) -> Affine:
        if x.slopes:
            raise BeyondReachError(f"the {name} of a value that depends on a parameter")
        return Affine(function(x.offset))

    return lambda value: _each(applied, value)


def _minimum(a: Real, b: Real) -> Real:
    return _pairs(lambda x, y: choose(_relation(Operator.LESS, x, y), x, y), a, b)


def _maximum(a: Real, b: Real) -> Real:
    return _pairs(lambda x, y: choose(_relation(Operator.GREATER, x, y), x, y), a, b)


def _clip(x: Real, low: Real, high: Real) -> Real:
    below, above = compare(Operator.LESS, x, low), compare(Operator.GREATER, x, high)
    return choose(below, low, choose(above, high, x))


def _sign(value: Real) -> Real:
    zero = np.zeros(1)

    def of(x: Affine) -> Real:
        if not x.slopes:
            return Affine(np.sign(x.offset))
        nonzero = Affine(zero)
        negative = choose(_relation(Operator.LESS, x, nonzero), Affine(zero - 1.0), nonzero)
        return choose(_relation(Operator.GREATER, x, nonzero), Affine(zero + 1.0), negative)

    return _each(of, value)


def _operators() -> dict[Operator, Callable[..., Real | Truth]]:
    def compared(relation: Operator) -> Callable[[Real, Real], Truth]:
        return lambda a, b: compare(relation, a, b)

    return {
        **{relation: compared(relation) for relation in _DATA},
        Operator.ADD: lambda a, b: _pairs(_add, a, b),
        Operator.SUBTRACT: lambda a, b: _pairs(_subtract, a, b),
        Operator.MULTIPLY: lambda a, b: _pairs(_multiply, a, b),
        Operator.DIVIDE: lambda a, b: _pairs(_divide, a, b),
        Operator.NEGATE: lambda a: _each(_negate, a),
        Operator.ABS: lambda a: _each(
            lambda x: choose(_relation(Operator.LESS, x, Affine(np.zeros(1))), _negate(x), x), a
        ),
        Operator.MIN: _minimum,
        Operator.MAX: _maximum,
        Operator.CLIP: _clip,
        Operator.SQRT: _function(np.sqrt, "square root"),
        Operator.EXP: _function(np.exp, "exponential"),
        Operator.TANH: _function(np.tanh, "hyperbolic tangent"),
        Operator.SIGN: _sign,
        Operator.NOT: negation,
        Operator.AND: both,
        Operator.OR: either,
        Operator.IMPLIES: lambda a, b: either(negation(a), b),
    }


def results(
    template: ProgramTemplate, histories: HistorySet, given: Mapping[str, float]
) -> list[Real]:
    """The raw result of every action; parameters that are `given` are numbers, the others unknown.

    Unknown parameters have their position among the template's free ones as their number. Raises
    BeyondReachError.
    """
    fixed = {p.name: p.value for p in template.parameters if isinstance(p, FixedParameter)}
    fixed.update(given)
    unknown = {p.name: j for j, p in enumerate(template.free) if p.name not in given}

    def number(value: float) -> Affine:
        return Affine(np.full(1, float(value)))

    def parameter(name: str) -> Affine:
        if name in fixed:
            return number(fixed[name])
        return Affine(np.zeros(1), {unknown[name]: np.ones(1)})

    def element(sensor: str, index: int) -> Affine:
        return Affine(np.asarray(histories.element(sensor, index), dtype=np.float64))

    def previous(action: str, type_: Type) -> Affine:
        del type_
        values = histories.of_histories(histories.previous[action])
        return Affine(np.asarray(values, dtype=np.float64))

    def discrete(value: int, type_: Discrete) -> Affine:
        del type_
        return number(value)

    algebra: Algebra[Real | Truth] = Algebra(
        literal=number,
        discrete=discrete,
        parameter=parameter,
        element=element,
        previous=previous,
        operators=_operators(),
        choose=_chosen,
    )
    found = []
    with np.errstate(all="ignore"):
        for body in template.bodies:
            result = walk(body, algebra)
            assert isinstance(result, Affine | Cases)
            found.append(result)
    return found


def _chosen(condition: Real | Truth, yes: Real | Truth, no: Real | Truth) -> Real | Truth:
    assert not isinstance(condition, Affine | Cases)
    if isinstance(yes, Affine | Cases) and isinstance(no, Affine | Cases):
        return choose(condition, yes, no)
    assert not isinstance(yes, Affine | Cases)
    assert not isinstance(no, Affine | Cases)
    return by_cases(condition, yes, no)


def agreement(result: Real, spec: ActionSpec, labels: Numbers, tolerance: float) -> Truth:
    """Where an action's result is the oracle's action, `labels` (N,).

    Continuous actions may differ by `tolerance` of their range. Where the oracle's action is at a
    bound, whatever is beyond the bound is as good, for actions are clipped.
    """
    if isinstance(result, Cases):
        yes = agreement(result.yes, spec, labels, tolerance)
        return by_cases(result.condition, yes, agreement(result.no, spec, labels, tolerance))
    if isinstance(spec.domain, Choice):
        return compare(Operator.EQUAL, result, Affine(labels))
    domain = spec.domain
    wanted = np.clip(labels, domain.lower, domain.upper)
    near = tolerance * (domain.upper - domain.lower)
    low, high = wanted - near, wanted + near
    enough = _relation(Operator.GREATER_EQUAL, result, Affine(low))
    not_more = _relation(Operator.LESS_EQUAL, result, Affine(high))
    # All that is clipped into the tolerance is near enough.
    return both(
        either(Known(low <= domain.lower), enough), either(Known(high >= domain.upper), not_more)
    )
