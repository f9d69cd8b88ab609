"""Terms: the expressions of sketches, program templates, programs and properties.

Grammar (every node also has a span, which takes no part in equality)::

    Term ::= Literal r | DiscreteLiteral k | ParameterRef p | SensorRef s | LocalRef x
           | PreviousAction A | ActionRef A | Apply op Term* | Peek Term i | Fold op Term
           | FoldLambda v acc Term Term Term | Diff Term | If Term Term Term | Let x Term Term
           | Hole n | RuleCall R Term*            (in sketches only)

Names are resolved and terms are well typed when they are made; leaves carry their types, so that
`type_of` needs no environment.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import assert_never

from pirlc.ir.operators import SIGNATURES, Operator
from pirlc.ir.types import Discrete, Real, Sequence, Type
from pirlc.source import NOWHERE, Span


def _span() -> Span:
    return field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True)
class Literal:
    """A real constant, as binary64."""

    value: float
    span: Span = _span()


@dataclass(frozen=True)
class DiscreteLiteral:
    """One of the values of a discrete action."""

    value: int
    type: Discrete
    span: Span = _span()


@dataclass(frozen=True)
class ParameterRef:
    """A named real of the policy: a top-level `param`, or a hole after expansion."""

    name: str
    span: Span = _span()


@dataclass(frozen=True)
class SensorRef:
    """A sensor's window (in `property p over n`, its last n readings)."""

    name: str
    length: int
    span: Span = _span()


@dataclass(frozen=True)
class LocalRef:
    """A name bound by `let`, by a lambda, or as a rule's argument."""

    name: str
    type: Type
    span: Span = _span()


@dataclass(frozen=True)
class PreviousAction:
    """`previous(A)`: the applied action of the step before."""

    action: str
    type: Type
    span: Span = _span()


@dataclass(frozen=True)
class ActionRef:
    """An action's value, applied or raw; in properties only."""

    action: str
    raw: bool
    type: Type
    span: Span = _span()


@dataclass(frozen=True)
class Apply:
    """A basic operator; elementwise where an argument is a sequence."""

    operator: Operator
    arguments: tuple[Term, ...]
    span: Span = _span()


@dataclass(frozen=True)
class Peek:
    """An element of a sequence; `index` counts from the end: -1 is the most recent."""

    sequence: Term
    index: int
    span: Span = _span()


@dataclass(frozen=True)
class Fold:
    """`fold(op, x)`: starts from the oldest element; `acc := op(element, acc)` to the newest."""

    operator: Operator
    sequence: Term
    span: Span = _span()


@dataclass(frozen=True)
class FoldLambda:
    r"""`fold(\v acc -> body, x, init)`: `acc := body` for each element, oldest first."""

    element: str
    accumulator: str
    body: Term
    sequence: Term
    initial: Term
    span: Span = _span()


@dataclass(frozen=True)
class Diff:
    """Successive differences, newer minus older: one element shorter."""

    sequence: Term
    span: Span = _span()


@dataclass(frozen=True)
class If:
    """Branches are atoms of one type; only the value of the taken branch counts."""

    condition: Term
    consequent: Term
    alternative: Term
    span: Span = _span()


@dataclass(frozen=True)
class Let:
    name: str
    value: Term
    body: Term
    span: Span = _span()


@dataclass(frozen=True)
class Hole:
    """`?name`: a real parameter to find, one for each expansion of the rule that writes it."""

    name: str
    lower: float
    upper: float
    guess: float | None = None
    span: Span = _span()


@dataclass(frozen=True)
class RuleCall:
    """An open choice among the alternatives of a rule (`Rule.key`)."""

    rule: str
    arguments: tuple[Term, ...]
    result: Type
    span: Span = _span()


Term = (
    Literal
    | DiscreteLiteral
    | ParameterRef
    | SensorRef
    | LocalRef
    | PreviousAction
    | ActionRef
    | Apply
    | Peek
    | Fold
    | FoldLambda
    | Diff
    | If
    | Let
    | Hole
    | RuleCall
)


def children(term: Term) -> tuple[Term, ...]:
    """The direct subterms, in the order of the text."""
    match term:
        case (
            Literal()
            | DiscreteLiteral()
            | ParameterRef()
            | SensorRef()
            | LocalRef()
            | PreviousAction()
            | ActionRef()
            | Hole()
        ):
            return ()
        case Apply(_, arguments) | RuleCall(_, arguments):
            return arguments
        case Peek(sequence) | Fold(_, sequence) | Diff(sequence):
            return (sequence,)
        case FoldLambda(_, _, body, sequence, initial):
            return (body, sequence, initial)
        case If(condition, consequent, alternative):
            return (condition, consequent, alternative)
        case Let(_, value, body):
            return (value, body)
        case _:
            assert_never(term)


def with_children(term: Term, new: tuple[Term, ...]) -> Term:
    """The same node over other subterms (as many as `children` gives)."""
    match term:
        case (
            Literal()
            | DiscreteLiteral()
            | ParameterRef()
            | SensorRef()
            | LocalRef()
            | PreviousAction()
            | ActionRef()
            | Hole()
        ):
            return term
        case Apply() | RuleCall():
            return replace(term, arguments=new)
        case Peek() | Fold() | Diff():
            return replace(term, sequence=new[0])
        case FoldLambda():
            return replace(term, body=new[0], sequence=new[1], initial=new[2])
        case If():
            return replace(term, condition=new[0], consequent=new[1], alternative=new[2])
        case Let():
            return replace(term, value=new[0], body=new[1])
        case _:
            assert_never(term)


def transform(term: Term, change: Callable[[Term], Term]) -> Term:
    """The term rebuilt from the leaves up, `change` applied to every node."""
    old = children(term)
    new = tuple(transform(child, change) for child in old)
    return change(term if new == old else with_children(term, new))


def subterms(term: Term) -> Iterator[Term]:
    """The term and all terms below it, parents first, in the order of the text."""
    yield term
    for child in children(term):
        yield from subterms(child)


def bound(term: Term) -> Iterator[str]:
    """The local names that a term binds."""
    for sub in subterms(term):
        match sub:
            case Let(name):
                yield name
            case FoldLambda(element, accumulator):
                yield element
                yield accumulator
            case _:
                pass


def type_of(term: Term) -> Type:
    """The type of a well-typed term."""
    match term:
        case Literal() | ParameterRef() | Hole() | Peek() | Fold() | FoldLambda():
            return Real()
        case DiscreteLiteral(_, type_) | LocalRef(_, type_) | PreviousAction(_, type_):
            return type_
        case ActionRef(_, _, type_) | RuleCall(_, _, type_):
            return type_
        case SensorRef(_, length):
            return Sequence(length)
        case Apply(operator, arguments):
            lengths = [t for t in map(type_of, arguments) if isinstance(t, Sequence)]
            return lengths[0] if lengths else SIGNATURES[operator].result
        case Diff(sequence):
            inner = type_of(sequence)
            assert isinstance(inner, Sequence)
            return Sequence(inner.length - 1)
        case If(_, consequent, _):
            return type_of(consequent)
        case Let(_, _, body):
            return type_of(body)
        case _:
            assert_never(term)


def size(term: Term) -> int:
    """Every operator, call, `if`, `let`, literal, name and index counts 1; binders count 0."""
    below = sum(size(child) for child in children(term))
    match term:
        case Peek() | Fold() | PreviousAction():
            return below + 2
        case ActionRef(_, raw):
            return 2 if raw else 1
        case (
            Literal()
            | DiscreteLiteral()
            | ParameterRef()
            | SensorRef()
            | LocalRef()
            | Apply()
            | FoldLambda()
            | Diff()
            | If()
            | Let()
            | Hole()
            | RuleCall()
        ):
            return below + 1
        case _:
            assert_never(term)
