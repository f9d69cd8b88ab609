"""sqrt, exp and tanh for z3: fresh variables under axioms that the real functions satisfy.

A proof under the axioms holds for the functions; a counterexample under them may be none, which
replaying it tells. The square root's axioms define it; exp and tanh lie between chords and tangents
at a few places, and two occurrences of one function are ordered as their arguments are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import pairwise
from math import isqrt

import z3

from pirlc.symbolic.z3_terms import Real, Term, Truth, as_term

_EXP_PLACES = tuple(Fraction(n, 2) for n in (-40, -20, -12, -8, -6, -4, -3, -2, -1, 0))
_EXP_PLACES += tuple(-place for place in reversed(_EXP_PLACES[:-1]))
_TANH_PLACES = tuple(Fraction(n, 4) for n in (0, 1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 24, 40))
_DIGITS = 10**24
_FAR = Fraction(1000)


def exp_enclosure(x: Fraction) -> tuple[Fraction, Fraction]:
    """Rationals around exp(x), closer than 1e-20 relative to it for |x| <= 100.

    Taylor's sum at |x| with the geometric bound on its rest.
    """
    if x < 0:
        low, high = exp_enclosure(-x)
        return _down(1 / high), _up(1 / low)
    total, term, n = Fraction(1), Fraction(1), 0
    while n + 2 <= 2 * x or term * 10**24 > total:
        n += 1
        term = term * x / n
        # Rounding down keeps the sum a lower bound; the rest's bound allows for it.
        term = _down(term) if n % 8 == 0 else term
        total += term
    rest = 2 * term + Fraction(n, _DIGITS)
    return _down(total), _up(total + rest + total * Fraction(n, _DIGITS))


def tanh_enclosure(x: Fraction) -> tuple[Fraction, Fraction]:
    """Rationals around tanh(x)."""
    low, high = exp_enclosure(2 * x)
    return _down(1 - 2 / (low + 1)), _up(1 - 2 / (high + 1))


def sqrt_enclosure(x: Fraction) -> tuple[Fraction, Fraction]:
    """Rationals around the square root; equal where it is rational with a small denominator."""
    n, d = isqrt(x.numerator), isqrt(x.denominator)
    if n * n == x.numerator and d * d == x.denominator:
        return Fraction(n, d), Fraction(n, d)
    scaled = isqrt(x.numerator * _DIGITS**2 // x.denominator)
    return Fraction(scaled, _DIGITS), Fraction(scaled + 1, _DIGITS)


def _down(x: Fraction) -> Fraction:
    """At most x, with a denominator that does not grow, and some 24 digits kept."""
    scale = _DIGITS * max(1, x.denominator // max(1, abs(x.numerator)))
    return Fraction(x.numerator * scale // x.denominator, scale)


def _up(x: Fraction) -> Fraction:
    return -_down(-x)


def _shortened(low: Fraction, high: Fraction) -> tuple[Fraction, Fraction]:
    """Short rationals around the two, some nine digits apart: z3's sums are as slow as its numbers
    are long."""
    size = max(abs(low), abs(high))
    unit = Fraction(2) ** (-32 + _magnitude(size)) if size else Fraction(1, 2**32)
    return (low // unit) * unit, -((-high) // unit) * unit


def _magnitude(x: Fraction) -> int:
    return x.numerator.bit_length() - x.denominator.bit_length()


@dataclass
class Functions:
    """The occurrences of the three functions in one context, and what is known of them."""

    context: z3.Context
    axioms: list[Term] = field(default_factory=list)
    nonlinear: bool = False
    _seen: dict[str, list[tuple[Real, Term]]] = field(default_factory=dict)

    def sqrt(self, x: Real) -> Real:
        """For x >= 0; a variable without meaning elsewhere."""
        if isinstance(x, Fraction):
            if x < 0:
                return Fraction(0)
            low, high = sqrt_enclosure(x)
            return low if low == high else self._enclosed("sqrt", low, high)

        def define(root: Term) -> Iterable[Truth]:
            self.nonlinear = True
            yield z3.Implies(x >= 0, z3.And(root >= 0, root * root == x))
            for place in (Fraction(1, 4), Fraction(1), Fraction(4)):
                # The arithmetic mean of x / p and p is at least their geometric one.
                p = self._term(place)
                yield z3.Implies(x >= 0, 2 * p * root <= x + p * p)

        return self._occurrence("sqrt", x, define)

    def exp(self, x: Real) -> Real:
        if isinstance(x, Fraction):
            if x == 0:
                return Fraction(1)
            if abs(x) > _FAR:
                y = z3.FreshReal("exp", self.context)
                low, high = exp_enclosure(_FAR if x > 0 else -_FAR)
                self.axioms.append(y >= self._term(low) if x > 0 else y <= self._term(high))
                self.axioms.append(y > 0)
                return y
            return self._enclosed("exp", *exp_enclosure(x))

        def define(y: Term) -> Iterable[Truth]:
            yield y > 0
            places = [(p, *_shortened(*exp_enclosure(p))) for p in _EXP_PLACES]
            for p, low, _ in places:
                # Below its tangent's zero the tangent says nothing, and y > 0 holds.
                yield y >= self._term(low) * (x - self._term(p) + 1)
            for (p, _, high), (q, _, higher) in pairwise(places):
                _, slope = _shortened(*((higher - high) / (q - p),) * 2)
                chord = self._term(high) + self._term(slope) * (x - self._term(p))
                inside = z3.And(x >= self._term(p), x <= self._term(q))
                yield z3.Implies(inside, y <= chord)
            yield z3.Implies(x <= self._term(places[0][0]), y <= self._term(places[0][2]))

        return self._occurrence("exp", x, define)

    def tanh(self, x: Real) -> Real:
        if isinstance(x, Fraction):
            if abs(x) > _FAR:
                low, _ = tanh_enclosure(Fraction(40))
                one = Fraction(1)
                return self._enclosed("tanh", *((low, one) if x > 0 else (-one, -low)))
            return Fraction(0) if x == 0 else self._enclosed("tanh", *tanh_enclosure(x))

        def define(y: Term) -> Iterable[Truth]:
            places = [(p, *_shortened(*tanh_enclosure(p))) for p in _TANH_PLACES]
            for mirrored in (1, -1):
                u, v = mirrored * x, mirrored * y
                yield v < 1
                yield z3.Implies(u >= 0, z3.And(v >= 0, v <= u))
                for p, low, high in places:
                    # The slope 1 - tanh(p)^2 from above: on u >= p a steeper line stays above,
                    # and from below on u <= p.
                    steep, flat = self._term(1 - low * low), self._term(1 - high * high)
                    line = u - self._term(p)
                    yield z3.Implies(u >= self._term(p), v <= self._term(high) + steep * line)
                    before = z3.And(u >= 0, u <= self._term(p))
                    yield z3.Implies(before, v <= self._term(high) + flat * line)
                for (p, low, _), (q, lower, _) in pairwise(places):
                    slope = (lower - low) / (q - p)
                    chord = self._term(low) + self._term(slope) * (u - self._term(p))
                    inside = z3.And(u >= self._term(p), u <= self._term(q))
                    yield z3.Implies(inside, v >= chord)
                last, low, _ = places[-1]
                yield z3.Implies(u >= self._term(last), v >= self._term(low))

        return self._occurrence("tanh", x, define)

    def _term(self, value: Fraction) -> Term:
        return as_term(value, self.context)

    def _enclosed(self, name: str, low: Fraction, high: Fraction) -> Term:
        value = z3.FreshReal(name, self.context)
        self.axioms.extend((value >= self._term(low), value <= self._term(high)))
        return value

    def _occurrence(self, name: str, x: Term, define: Callable[[Term], Iterable[Truth]]) -> Term:
        seen = self._seen.setdefault(name, [])
        for argument, value in seen:
            if argument.eq(x):
                return value
        value = z3.FreshReal(name, self.context)
        self.axioms.extend(define(value))
        for argument, other in seen:
            # All three rise strictly (the square root where it means something).
            rising = z3.And((argument < x) == (other < value), (argument == x) == (other == value))
            if name == "sqrt":
                rising = z3.Implies(z3.And(argument >= 0, x >= 0), rising)
            self.axioms.append(rising)
        seen.append((x, value))
        return value
