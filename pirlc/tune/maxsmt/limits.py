"""Which templates MaxSMT can take, and which of their parameters at a time.

A template is taken where all is affine in some parameters as long as the others keep their values;
sets of such parameters are solved for in turn. What a template is in its parameters is found by
walking it with sets of monomials for values.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from pirlc.ir.operators import COMPARISONS, Operator
from pirlc.ir.policy import ProgramTemplate
from pirlc.ir.types import Type
from pirlc.symbolic.walk import Algebra, walk
from pirlc.tune.maxsmt.piecewise import MOST_CASES, BeyondReachError

Monomial = tuple[str, ...]
"""The parameters of a product, each as often as it is a factor."""

_MOST_MONOMIALS = 400


@dataclass(frozen=True)
class _Shape:
    """The products of parameters in a value, and how many cases it has at most."""

    monomials: frozenset[Monomial] = frozenset()
    cases: int = 1


@dataclass
class _Walk:
    free: frozenset[str]
    compared: set[Monomial] = field(default_factory=set)

    def shape(self, monomials: frozenset[Monomial], cases: int) -> _Shape:
        if cases > MOST_CASES:
            raise BeyondReachError(f"a value of more than {MOST_CASES} cases")
        if len(monomials) > _MOST_MONOMIALS:
            raise BeyondReachError(
                f"a value with more than {_MOST_MONOMIALS} products of parameters"
            )
        return _Shape(monomials, cases)

    def sum(self, a: _Shape, b: _Shape) -> _Shape:
        return self.shape(a.monomials | b.monomials, a.cases * b.cases)

    def product(self, a: _Shape, b: _Shape) -> _Shape:
        both = {tuple(sorted((*x, *y))) for x in a.monomials for y in b.monomials}
        # A factor may have a part without parameters, too.
        found = both | a.monomials | b.monomials
        for monomial in sorted(found):
            twice = [x for x, y in pairwise(monomial) if x == y]
            if twice:
                raise BeyondReachError("a parameter that is multiplied by itself")
        return self.shape(frozenset(found), a.cases * b.cases)

    def quotient(self, a: _Shape, b: _Shape) -> _Shape:
        self.constant(b, "a quotient by a value that depends on a parameter")
        return self.shape(a.monomials, a.cases * b.cases)

    def constant(self, a: _Shape, why: str) -> None:
        if a.monomials:
            raise BeyondReachError(why)

    def function(self, what: str) -> Callable[[_Shape], _Shape]:
        def applied(a: _Shape) -> _Shape:
            self.constant(a, f"the {what} of a value that depends on a parameter")
            return a

        return applied

    def by_guard(self, a: _Shape, cases: int) -> _Shape:
        """Which of the cases it is depends on the monomials themselves."""
        if not a.monomials:
            return a
        self.compared |= a.monomials
        return self.shape(a.monomials, cases)

    def compare(self, a: _Shape, b: _Shape) -> _Shape:
        self.compared |= a.monomials | b.monomials
        return _Shape()

    def extreme(self, a: _Shape, b: _Shape) -> _Shape:
        return self.by_guard(self.sum(a, b), 2 * a.cases * b.cases)

    def choose(self, condition: _Shape, yes: _Shape, no: _Shape) -> _Shape:
        del condition
        return self.shape(yes.monomials | no.monomials, yes.cases + no.cases)

    def algebra(self) -> Algebra[_Shape]:
        def truths(*_: _Shape) -> _Shape:
            return _Shape()

        operators: dict[Operator, Callable[..., _Shape]] = {
            **dict.fromkeys(COMPARISONS, self.compare),
            **dict.fromkeys((Operator.NOT, Operator.AND, Operator.OR, Operator.IMPLIES), truths),
            Operator.ADD: self.sum,
            Operator.SUBTRACT: self.sum,
            Operator.MULTIPLY: self.product,
            Operator.DIVIDE: self.quotient,
            Operator.NEGATE: lambda a: a,
            Operator.ABS: lambda a: self.by_guard(a, 2 * a.cases),
            Operator.SIGN: lambda a: _Shape(frozenset(), self.by_guard(a, 3 * a.cases).cases),
            Operator.MIN: self.extreme,
            Operator.MAX: self.extreme,
            Operator.CLIP: lambda x, low, high: self.extreme(self.extreme(x, low), high),
            Operator.SQRT: self.function("square root"),
            Operator.EXP: self.function("exponential"),
            Operator.TANH: self.function("hyperbolic tangent"),
        }

        def number(*_: Any) -> _Shape:
            return _Shape()

        def previous(action: str, type_: Type) -> _Shape:
            del action, type_
            return _Shape()

        def parameter(name: str) -> _Shape:
            return _Shape(frozenset({(name,)}) if name in self.free else frozenset())

        return Algebra(
            literal=number,
            discrete=number,
            parameter=parameter,
            element=number,
            previous=previous,
            operators=operators,
            choose=self.choose,
        )


def blocks(template: ProgramTemplate) -> tuple[tuple[str, ...], ...]:
    """Sets of parameters to solve for in turn, largest first; one set where nothing is multiplied.

    In each, all is affine once the parameters that are not in it have values. Raises
    BeyondReachError.
    """
    names = [p.name for p in template.free]
    looked = _Walk(frozenset(names))
    monomials: set[Monomial] = set()
    for body in template.bodies:
        monomials |= walk(body, looked.algebra()).monomials
    clash: dict[str, set[str]] = {name: set() for name in names}
    for monomial in monomials | looked.compared:
        for name in monomial:
            clash[name] |= set(monomial) - {name}
    found: list[list[str]] = []
    waiting = names
    while waiting:
        # The parameters that meet the fewest others make the largest set.
        block: list[str] = []
        for name in sorted(waiting, key=lambda n: (len(clash[n]), names.index(n))):
            if not clash[name] & set(block):
                block.append(name)
        # What fits without a clash is solved for again.
        seeds = set(block)
        for name in names:
            if name not in seeds and not clash[name] & set(block):
                block.append(name)
        found.append(sorted(block, key=names.index))
        waiting = [name for name in waiting if name not in seeds]
    return tuple(tuple(block) for block in found)


def unsuitable(template: ProgramTemplate) -> str | None:
    """Why MaxSMT cannot take a template, as what it has and may not have; None if it can."""
    try:
        blocks(template)
    except BeyondReachError as error:
        return str(error)
    return None
