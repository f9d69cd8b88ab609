"""One walk over terms for every symbolic form.

The walk deals with names, windows, folds and broadcasting, which are the same everywhere; an
`Algebra` says what leaves, operators and choices become. Sequences are tuples of atoms.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar, assert_never

from pirlc.ir.operators import Operator
from pirlc.ir.terms import (
    ActionRef,
    Apply,
    Diff,
    DiscreteLiteral,
    Fold,
    FoldLambda,
    Hole,
    If,
    Let,
    Literal,
    LocalRef,
    ParameterRef,
    Peek,
    PreviousAction,
    RuleCall,
    SensorRef,
    Term,
)
from pirlc.ir.types import Discrete, Type

V = TypeVar("V")
Seen = TypeVar("Seen", contravariant=True)


class Watcher(Protocol[Seen]):
    """Is told where a walk is, for forms that record what they meet."""

    def at(self, term: Term) -> None:
        """The operators called from now on, until the next word, are this node's."""

    def enter(self, term: If, condition: Seen, taken: bool) -> None:
        """What follows, until `leave`, is the consequent (or not `taken`: the alternative)."""

    def leave(self) -> None: ...


@dataclass(frozen=True)
class Algebra(Generic[V]):
    """What a symbolic form makes of each kind of node; `V` is its kind of atom.

    `element(sensor, index)` is an element of a sensor's window, counted from the end as `peek`
    does: -1 is the newest. In properties `previous` and `action` may be sequences, and there alone
    `action` is needed. All operators of a body are called, in one order: those of the branches that
    are not taken too.
    """

    literal: Callable[[float], V]
    discrete: Callable[[int, Discrete], V]
    parameter: Callable[[str], V]
    element: Callable[[str, int], V]
    previous: Callable[[str, Type], V | tuple[V, ...]]
    operators: Mapping[Operator, Callable[..., V]]
    choose: Callable[[V, V, V], V]
    action: Callable[[str, bool, Type], V | tuple[V, ...]] | None = None
    watcher: Watcher[V] | None = None


def walk(term: Term, algebra: Algebra[V]) -> V:
    """The form of an action's term or of a property's, which is an atom."""
    return _atom(term, algebra, {})


def _walk(term: Term, to: Algebra[V], scope: Mapping[str, V | tuple[V, ...]]) -> V | tuple[V, ...]:
    match term:
        case Literal(number):
            return to.literal(number)
        case DiscreteLiteral(number, type_):
            return to.discrete(number, type_)
        case ParameterRef(name):
            return to.parameter(name)
        case SensorRef(name, length):
            return tuple(to.element(name, j - length) for j in range(length))
        case LocalRef(name):
            return scope[name]
        case PreviousAction(action, type_):
            return to.previous(action, type_)
        case Apply(operator, arguments):
            values = [_walk(a, to, scope) for a in arguments]
            _at(term, to)
            return _apply(to.operators[operator], values)
        case Peek(sequence, index):
            return _elements(sequence, to, scope)[index]
        case Fold(operator, sequence):
            folded, *rest = _elements(sequence, to, scope)
            _at(term, to)
            for element in rest:
                folded = to.operators[operator](element, folded)
            return folded
        case FoldLambda(element_name, accumulator_name, body, sequence, initial):
            accumulator = _walk(initial, to, scope)
            for element in _elements(sequence, to, scope):
                inner = {**scope, element_name: element, accumulator_name: accumulator}
                accumulator = _walk(body, to, inner)
            return accumulator
        case Diff(sequence):
            elements = _elements(sequence, to, scope)
            _at(term, to)
            subtract = to.operators[Operator.SUBTRACT]
            return tuple(subtract(elements[j + 1], elements[j]) for j in range(len(elements) - 1))
        case If(condition, consequent, alternative):
            truth = _atom(condition, to, scope)
            chosen: list[V] = []
            for part, taken in ((consequent, True), (alternative, False)):
                if to.watcher is not None:
                    to.watcher.enter(term, truth, taken)
                chosen.append(_atom(part, to, scope))
                if to.watcher is not None:
                    to.watcher.leave()
            _at(term, to)
            return to.choose(truth, chosen[0], chosen[1])
        case Let(name, value, body):
            return _walk(body, to, {**scope, name: _walk(value, to, scope)})
        case ActionRef(action, raw, type_):
            assert to.action is not None, "only properties speak of actions"
            return to.action(action, raw, type_)
        case Hole() | RuleCall():
            raise AssertionError("a program template holds no choice")
        case _:
            assert_never(term)


def _at(term: Term, to: Algebra[V]) -> None:
    if to.watcher is not None:
        to.watcher.at(term)


def _atom(term: Term, to: Algebra[V], scope: Mapping[str, V | tuple[V, ...]]) -> V:
    value = _walk(term, to, scope)
    assert not isinstance(value, tuple)
    return value


def _elements(term: Term, to: Algebra[V], scope: Mapping[str, V | tuple[V, ...]]) -> tuple[V, ...]:
    value = _walk(term, to, scope)
    assert isinstance(value, tuple)
    return value


def _apply(operation: Callable[..., V], arguments: list[V | tuple[V, ...]]) -> V | tuple[V, ...]:
    lengths = [len(argument) for argument in arguments if isinstance(argument, tuple)]
    if not lengths:
        return operation(*arguments)
    return tuple(
        operation(*(a[j] if isinstance(a, tuple) else a for a in arguments))
        for j in range(lengths[0])
    )
