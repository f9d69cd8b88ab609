"""The paths through an action's `if`s: which conditions lead to which term without them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice

from pirlc.ir.operators import Operator
from pirlc.ir.policy import Program
from pirlc.ir.printer import term_text
from pirlc.ir.terms import (
    Apply,
    FoldLambda,
    If,
    Let,
    Literal,
    LocalRef,
    ParameterRef,
    Term,
    children,
    subterms,
    transform,
    with_children,
)

MOST_PATHS = 64
"""Of one action; a program has more only where many `if`s stand side by side."""

_LONGEST = 400
"""Nodes of a text in which `let`s are written out."""


@dataclass(frozen=True)
class Condition:
    """`term` is closed: `let`s around it are part of it."""

    term: Term
    holds: bool


@dataclass(frozen=True)
class Path:
    """`term` holds no `if` that splits it (one inside a fold's lambda stays)."""

    conditions: tuple[Condition, ...]
    term: Term


def paths(term: Term) -> tuple[tuple[Path, ...], bool]:
    """The paths of an action, at most `MOST_PATHS`, the consequents first, and whether that is all.

    A condition that stands in several places (`if g then .. + if g then ..`) is decided once.
    """
    found = list(islice(_paths(term, (), ()), MOST_PATHS + 1))
    return tuple(found[:MOST_PATHS]), len(found) <= MOST_PATHS


_Lets = tuple[tuple[str, Term], ...]


def _paths(term: Term, known: tuple[Condition, ...], lets: _Lets) -> Iterator[Path]:
    match term:
        case If(condition, consequent, alternative):
            closed = condition
            for name, value in reversed(lets):
                if any(isinstance(t, LocalRef) and t.name == name for t in subterms(closed)):
                    closed = Let(name, value, closed)
            before = next((c.holds for c in known if c.term == closed), None)
            if before is not False:
                now = known if before else (*known, Condition(closed, True))
                yield from _paths(consequent, now, lets)
            if before is not True:
                now = known if before is False else (*known, Condition(closed, False))
                yield from _paths(alternative, now, lets)
        case Let(name, value, body):
            for first in _paths(value, known, lets):
                inner = (*lets, (name, first.term))
                for second in _paths(body, first.conditions, inner):
                    yield Path(second.conditions, Let(name, first.term, second.term))
        case FoldLambda(_, _, body, sequence, initial):
            for path in _all((sequence, initial), known, lets):
                yield Path(path[0], with_children(term, (body, *path[1])))
        case _:
            for conditions, parts in _all(children(term), known, lets):
                yield Path(conditions, with_children(term, parts))


def _all(
    terms: tuple[Term, ...], known: tuple[Condition, ...], lets: _Lets
) -> Iterator[tuple[tuple[Condition, ...], tuple[Term, ...]]]:
    """Each way through several terms, one after the other."""
    if not terms:
        yield known, ()
        return
    for first in _paths(terms[0], known, lets):
        for conditions, rest in _all(terms[1:], first.conditions, lets):
            yield conditions, (first.term, *rest)


def condition_text(condition: Condition, program: Program) -> str:
    """As program text, with numbers for parameters; one that does not hold after `not`."""
    term = condition.term
    return written(term if condition.holds else Apply(Operator.NOT, (term,)), program)


def written(term: Term, program: Program) -> str:
    """A term as text, with numbers for parameters and `let`s written out where that stays short."""
    values = program.values

    def number(node: Term) -> Term:
        return Literal(values[node.name]) if isinstance(node, ParameterRef) else node

    plain = transform(term, number)
    inlined = _inlined(plain, {})
    short = sum(1 for _ in islice(subterms(inlined), _LONGEST + 1)) <= _LONGEST
    return term_text(inlined if short else plain)


def _inlined(term: Term, scope: Mapping[str, Term]) -> Term:
    match term:
        case Let(name, value, body):
            return _inlined(body, {**scope, name: _inlined(value, scope)})
        case LocalRef(name):
            return scope.get(name, term)
        case FoldLambda(element, accumulator, body, sequence, initial):
            inner = {k: v for k, v in scope.items() if k not in (element, accumulator)}
            parts = (_inlined(body, inner), _inlined(sequence, scope), _inlined(initial, scope))
            return with_children(term, parts)
        case _:
            below = tuple(_inlined(child, scope) for child in children(term))
            return with_children(term, below)
