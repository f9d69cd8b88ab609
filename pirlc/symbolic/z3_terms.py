"""z3 terms over the reals with constants kept apart, so that what is linear stays linear.

A real is a `Fraction` or a z3 term, a truth a `bool` or a z3 term. Constants are folded here,
exactly, before z3 sees them: a literal times a parameter is a coefficient, not a product. Unlike
rounded arithmetic, exact arithmetic allows that.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable
from fractions import Fraction
from functools import partial
from typing import Any

import z3

from pirlc.ir.operators import Operator

Term = Any
"""A `z3.ExprRef`: z3 has no type stubs."""

Real = Any
"""A `Fraction`, or a z3 term of sort Real."""

Truth = Any
"""A `bool`, or a z3 term of sort Bool."""

_MOST_LEAVES = 16

# z3 would take a Ctrl-C for itself: one question would be undecided, and the user not heard. Left
# to Python, it ends the work when the question does.
z3.set_param("ctrl_c", False)


def number(value: Fraction, context: z3.Context) -> Term:
    return z3.Q(value.numerator, value.denominator, context)


def as_term(value: Real | Truth, context: z3.Context) -> Term:
    """The z3 term of a constant or a term."""
    match value:
        case bool():
            return z3.BoolVal(value, context)
        case Fraction():
            return number(value, context)
        case _:
            return value


def _lifted(value: Real, beside: Term) -> Term:
    return number(value, beside.ctx) if isinstance(value, Fraction) else value


def _pair(a: Real, b: Real) -> tuple[Term, Term]:
    """Two reals as terms; one of them is a term already."""
    return _lifted(a, b), _lifted(b, a)


def both_constant(a: Real, b: Real) -> bool:
    return isinstance(a, Fraction) and isinstance(b, Fraction)


def add(a: Real, b: Real) -> Real:
    if both_constant(a, b):
        return a + b
    if isinstance(a, Fraction) and a == 0:
        return b
    if isinstance(b, Fraction) and b == 0:
        return a
    x, y = _pair(a, b)
    return x + y


def negate(a: Real) -> Real:
    return -a


def subtract(a: Real, b: Real) -> Real:
    if both_constant(a, b):
        return a - b
    if isinstance(b, Fraction):
        return add(a, -b)
    if isinstance(a, Fraction) and a == 0:
        return -b
    x, y = _pair(a, b)
    return x - y


def multiply(a: Real, b: Real) -> Real:
    """The product; linear where one factor is a choice among constants."""
    if both_constant(a, b):
        return a * b
    for factor, other in ((a, b), (b, a)):
        if isinstance(factor, Fraction):
            if factor == 0:
                return Fraction(0)
            if factor == 1:
                return other
            return number(factor, other.ctx) * other
    for factor, other in ((a, b), (b, a)):
        if choice_leaves(factor) is not None:
            return map_choice(factor, partial(multiply, other))
    return a * b


def is_linear_product(a: Real, b: Real) -> bool:
    return any(isinstance(x, Fraction) or choice_leaves(x) is not None for x in (a, b))


def divide(a: Real, b: Real) -> Real:
    """The quotient; where the denominator is zero it means nothing, and never is used."""
    if isinstance(b, Fraction):
        return Fraction(0) if b == 0 else multiply(a, 1 / b)
    if choice_leaves(b) is not None:
        return map_choice(b, lambda leaf: divide(a, leaf))
    return _lifted(a, b) / b


def choice_leaves(term: Real) -> tuple[Fraction, ...] | None:
    """The values of a term that only chooses among a few constants; None for any other."""
    if isinstance(term, Fraction):
        return (term,)
    found: list[Fraction] = []
    waiting = [term]
    while waiting:
        here = waiting.pop()
        if z3.is_rational_value(here):
            found.append(fraction(here))
        elif z3.is_app_of(here, z3.Z3_OP_ITE):
            waiting.extend((here.arg(2), here.arg(1)))
        else:
            return None
        if len(found) + len(waiting) > _MOST_LEAVES:
            return None
    return tuple(found)


def map_choice(term: Real, change: Callable[[Fraction], Real]) -> Real:
    """The choice among constants with each of them changed."""
    if isinstance(term, Fraction):
        return change(term)
    if z3.is_rational_value(term):
        return change(fraction(term))
    return choose(term.arg(0), map_choice(term.arg(1), change), map_choice(term.arg(2), change))


def fraction(value: Term) -> Fraction:
    """The value of a rational numeral."""
    return Fraction(value.numerator_as_long(), value.denominator_as_long())


_RELATIONS: dict[Operator, Callable[[Any, Any], Any]] = {
    Operator.LESS: operator.lt,
    Operator.LESS_EQUAL: operator.le,
    Operator.GREATER: operator.gt,
    Operator.GREATER_EQUAL: operator.ge,
    Operator.EQUAL: operator.eq,
    Operator.NOT_EQUAL: operator.ne,
}


def compare(relation: Operator, a: Real, b: Real) -> Truth:
    """a < b and the like, exactly."""
    if both_constant(a, b):
        return _RELATIONS[relation](a, b)
    x, y = _pair(a, b)
    return _RELATIONS[relation](x, y)


def less(a: Real, b: Real) -> Truth:
    return compare(Operator.LESS, a, b)


def at_most(a: Real, b: Real) -> Truth:
    return compare(Operator.LESS_EQUAL, a, b)


def equal(a: Real, b: Real) -> Truth:
    return compare(Operator.EQUAL, a, b)


def within(x: Real, lower: Real, upper: Real) -> Truth:
    return conjunction((at_most(lower, x), at_most(x, upper)))


def negation(a: Truth) -> Truth:
    return not a if isinstance(a, bool) else z3.Not(a)


def conjunction(parts: Iterable[Truth]) -> Truth:
    terms = []
    for part in parts:
        if isinstance(part, bool):
            if not part:
                return False
        else:
            terms.append(part)
    if not terms:
        return True
    return terms[0] if len(terms) == 1 else z3.And(*terms)


def disjunction(parts: Iterable[Truth]) -> Truth:
    terms = []
    for part in parts:
        if isinstance(part, bool):
            if part:
                return True
        else:
            terms.append(part)
    if not terms:
        return False
    return terms[0] if len(terms) == 1 else z3.Or(*terms)


def choose(condition: Truth, yes: Real | Truth, no: Real | Truth) -> Any:
    if isinstance(condition, bool):
        return yes if condition else no
    if yes is no or (both_constant(yes, no) and yes == no):
        return yes
    context = condition.ctx
    if isinstance(yes, bool) and isinstance(no, bool):
        if yes == no:
            return yes
        return condition if yes else z3.Not(condition)
    return z3.If(condition, as_term(yes, context), as_term(no, context))


def absolute(x: Real) -> Real:
    return abs(x) if isinstance(x, Fraction) else z3.If(x < 0, -x, x)


def minimum(a: Real, b: Real) -> Real:
    return choose(less(a, b), a, b)


def maximum(a: Real, b: Real) -> Real:
    return choose(less(b, a), a, b)


def clip(x: Real, low: Real, high: Real) -> Real:
    return choose(less(x, low), low, choose(less(high, x), high, x))


def sign(x: Real) -> Real:
    one = Fraction(1)
    return choose(less(Fraction(0), x), one, choose(less(x, Fraction(0)), -one, Fraction(0)))
