"""Terms as weighted sums, without an operating point: what is linear is seen, the rest is kept.

Over `symbolic.walk` each real becomes c0 + c1 a1 + c2 a2 + ..., where an atom a is a reading, an
action of the step before, or a function of such sums that is not linear (abs, max, a product). Each
condition becomes a tree of comparisons of such a sum with 0. Numbers are the decimals that the
program text shows, exactly: this is for reading, while proofs take their binary64 values.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from fractions import Fraction
from typing import assert_never

from pirlc.analyze.tangent import Earlier, Reading
from pirlc.ir.operators import Operator
from pirlc.ir.policy import Program
from pirlc.ir.terms import Term
from pirlc.symbolic.walk import Algebra, walk


@dataclass(frozen=True)
class Function:
    """An operator, or "if", on sums; what it is of is not linear."""

    name: str
    arguments: tuple[Sum, ...]
    condition: Guard | None = None


Atom = Reading | Earlier | Function


@dataclass(frozen=True)
class Sum:
    """`terms` in the order in which the program names them, no weight being 0."""

    constant: Fraction
    terms: tuple[tuple[Atom, Fraction], ...] = ()

    @property
    def weights(self) -> dict[Atom, Fraction]:
        return dict(self.terms)


class Relation(Enum):
    """Of a sum to 0."""

    GREATER = ">"
    GREATER_EQUAL = ">="
    LESS = "<"
    LESS_EQUAL = "<="
    EQUAL = "="
    NOT_EQUAL = "!="

    @property
    def negation(self) -> Relation:
        return _NEGATIONS[self]

    @property
    def turned(self) -> Relation:
        """The relation of the negated sum."""
        return _TURNED.get(self, self)


_NEGATIONS = {
    Relation.GREATER: Relation.LESS_EQUAL,
    Relation.GREATER_EQUAL: Relation.LESS,
    Relation.LESS: Relation.GREATER_EQUAL,
    Relation.LESS_EQUAL: Relation.GREATER,
    Relation.EQUAL: Relation.NOT_EQUAL,
    Relation.NOT_EQUAL: Relation.EQUAL,
}
_TURNED = {
    Relation.GREATER: Relation.LESS,
    Relation.GREATER_EQUAL: Relation.LESS_EQUAL,
    Relation.LESS: Relation.GREATER,
    Relation.LESS_EQUAL: Relation.GREATER_EQUAL,
}


@dataclass(frozen=True)
class Compare:
    """The sum is in the relation to 0."""

    sum: Sum
    relation: Relation


@dataclass(frozen=True)
class Every:
    """Holds where all parts do; without any, always."""

    parts: tuple[Guard, ...]


@dataclass(frozen=True)
class Some:
    """Holds where a part does; without any, never."""

    parts: tuple[Guard, ...]


Guard = Compare | Every | Some

ALWAYS, NEVER = Every(()), Some(())


def sum_of(term: Term, program: Program) -> Sum:
    """A real or discrete term without `if`s but in a fold's lambda."""
    found = walk(term, _algebra(program))
    assert isinstance(found, Sum)
    return found


def guard_of(term: Term, program: Program) -> Guard:
    """A condition."""
    found = walk(term, _algebra(program))
    assert not isinstance(found, Sum)
    return found


def negation(guard: Guard) -> Guard:
    """What holds where the guard does not. (Of undefined comparisons, which do not hold either,
    it knows nothing.)"""
    match guard:
        case Every(parts):
            return Some(tuple(map(negation, parts)))
        case Some(parts):
            return Every(tuple(map(negation, parts)))
        case Compare(total, relation):
            return Compare(total, relation.negation)
        case _:
            assert_never(guard)


def scaled(a: Sum, by: Fraction) -> Sum:
    if not by:
        return Sum(Fraction(0))
    return Sum(a.constant * by, tuple((atom, weight * by) for atom, weight in a.terms))


def added(a: Sum, b: Sum) -> Sum:
    weights = a.weights
    for atom, weight in b.terms:
        weights[atom] = weights.get(atom, Fraction(0)) + weight
    terms = tuple((atom, weight) for atom, weight in weights.items() if weight)
    return Sum(a.constant + b.constant, terms)


_ONE, _MINUS = Fraction(1), Fraction(-1)
_Value = Sum | Compare | Every | Some


def _algebra(program: Program) -> Algebra[_Value]:
    values = program.values
    return Algebra(
        literal=_number,
        discrete=lambda value, _: _number(value),
        parameter=lambda name: _number(values[name]),
        element=lambda sensor, index: _atom(Reading(sensor, -1 - index)),
        previous=lambda action, _: _atom(Earlier(action)),
        operators=_OPERATORS,
        choose=_choose,
    )


def _number(value: float) -> Sum:
    return Sum(Fraction(repr(float(value))))


def _atom(atom: Atom) -> Sum:
    return Sum(Fraction(0), ((atom, _ONE),))


def _choose(condition: _Value, consequent: _Value, alternative: _Value) -> _Value:
    assert not isinstance(condition, Sum)
    if isinstance(consequent, Sum) and isinstance(alternative, Sum):
        if consequent == alternative:
            return consequent
        return _atom(Function("if", (consequent, alternative), condition))
    assert not isinstance(consequent, Sum)
    assert not isinstance(alternative, Sum)
    taken = Every((condition, consequent))
    return Some((taken, Every((negation(condition), alternative))))


def _multiply(a: Sum, b: Sum) -> Sum:
    if not a.terms:
        return scaled(b, a.constant)
    if not b.terms:
        return scaled(a, b.constant)
    return _atom(Function("*", (a, b)))


def _divide(a: Sum, b: Sum) -> Sum:
    if not b.terms and b.constant:
        return scaled(a, 1 / b.constant)
    return _atom(Function("/", (a, b)))


def _abs(a: Sum) -> Sum:
    if not a.terms:
        return Sum(abs(a.constant))
    # abs(-x) and abs(x) are the same atom.
    first = a.terms[0][1]
    return _atom(Function("abs", (scaled(a, _MINUS) if first < 0 else a,)))


def _extreme(name: str) -> Callable[[Sum, Sum], Sum]:
    """`min` and `max`, those in each other joined."""

    def apply(a: Sum, b: Sum) -> Sum:
        if not a.terms and not b.terms:
            return Sum(
                min(a.constant, b.constant) if name == "min" else max(a.constant, b.constant)
            )
        parts: list[Sum] = []
        for side in (a, b):
            match side:
                case Sum(constant, ((Function(inner, arguments, None), weight),)) if (
                    inner == name and weight == 1 and not constant
                ):
                    parts += arguments
                case _:
                    parts.append(side)
        return _atom(Function(name, tuple(dict.fromkeys(parts))))

    return apply


def _function(name: str) -> Callable[..., Sum]:
    return lambda *arguments: _atom(Function(name, arguments))


def _compare(relation: Relation) -> Callable[[Sum, Sum], Guard]:
    return lambda a, b: Compare(added(a, scaled(b, _MINUS)), relation)


_OPERATORS: Mapping[Operator, Callable[..., _Value]] = {
    Operator.ADD: added,
    Operator.SUBTRACT: lambda a, b: added(a, scaled(b, _MINUS)),
    Operator.MULTIPLY: _multiply,
    Operator.DIVIDE: _divide,
    Operator.NEGATE: lambda a: scaled(a, _MINUS),
    Operator.ABS: _abs,
    Operator.MIN: _extreme("min"),
    Operator.MAX: _extreme("max"),
    Operator.CLIP: _function("clip"),
    Operator.SIGN: _function("sign"),
    Operator.SQRT: _function("sqrt"),
    Operator.EXP: _function("exp"),
    Operator.TANH: _function("tanh"),
    Operator.LESS: _compare(Relation.LESS),
    Operator.LESS_EQUAL: _compare(Relation.LESS_EQUAL),
    Operator.GREATER: _compare(Relation.GREATER),
    Operator.GREATER_EQUAL: _compare(Relation.GREATER_EQUAL),
    Operator.EQUAL: _compare(Relation.EQUAL),
    Operator.NOT_EQUAL: _compare(Relation.NOT_EQUAL),
    Operator.NOT: lambda a: negation(a),
    Operator.AND: lambda a, b: Every((a, b)),
    Operator.OR: lambda a, b: Some((a, b)),
    Operator.IMPLIES: lambda a, b: Some((negation(a), b)),
}
