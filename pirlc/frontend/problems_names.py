"""E02xx as values: names and declarations."""

from __future__ import annotations

from dataclasses import dataclass

from pirlc.source import Span


@dataclass(frozen=True)
class DuplicateName:
    span: Span
    name: str
    first: Span


@dataclass(frozen=True)
class UnknownName:
    """`wanted` says what kind of name belongs there; `close` is a known name like it."""

    span: Span
    name: str
    wanted: str
    close: str | None


@dataclass(frozen=True)
class BadIdentifier:
    span: Span
    name: str


@dataclass(frozen=True)
class NameTooLong:
    span: Span
    name: str
    limit: int


@dataclass(frozen=True)
class ReservedName:
    span: Span
    name: str


@dataclass(frozen=True)
class HiddenName:
    """A `let`, a lambda or a rule's argument uses the name of a declaration."""

    span: Span
    name: str
    kind: str
    first: Span


@dataclass(frozen=True)
class RepeatedDeclaration:
    span: Span
    keyword: str
    first: Span


@dataclass(frozen=True)
class MissingDeclaration:
    """`keyword` is ``policy`` or ``action``; `span` is the end of the file."""

    span: Span
    keyword: str


@dataclass(frozen=True)
class EmptyRange:
    span: Span
    lower: str
    upper: str
    point_allowed: bool


@dataclass(frozen=True)
class OutOfLimits:
    """`allowed` says what numbers the place takes."""

    span: Span
    what: str
    text: str
    allowed: str


@dataclass(frozen=True)
class NotWhole:
    span: Span
    what: str
    text: str


@dataclass(frozen=True)
class SafeOutside:
    span: Span
    action: str
    text: str
    domain: str
    domain_span: Span


@dataclass(frozen=True)
class GuessOutside:
    span: Span
    name: str
    text: str
    bounds: str
    bounds_span: Span


@dataclass(frozen=True)
class HoleConflict:
    span: Span
    name: str
    first: Span


@dataclass(frozen=True)
class RepeatedValue:
    span: Span
    text: str
    first: Span


@dataclass(frozen=True)
class WrongArgumentCount:
    span: Span
    name: str
    usage: str
    given: int


@dataclass(frozen=True)
class WrongKind:
    """A known name where a name of another kind belongs."""

    span: Span
    name: str
    kind: str
    wanted: str


@dataclass(frozen=True)
class HoleInProperty:
    span: Span
    name: str


@dataclass(frozen=True)
class RuleInProperty:
    span: Span
    name: str


@dataclass(frozen=True)
class ActionAsValue:
    span: Span
    name: str


@dataclass(frozen=True)
class UnknownWord:
    """A word that the keyword before it does not know."""

    span: Span
    keyword: str
    word: str
    known: tuple[str, ...]
    close: str | None


@dataclass(frozen=True)
class OnlyInProperties:
    span: Span
    name: str


@dataclass(frozen=True)
class MisshapenAction:
    """`reason` says what is wrong with the `safe` and `=` parts of an action."""

    span: Span
    action: str
    reason: str


@dataclass(frozen=True)
class MisplacedArgument:
    """An operator or a lambda that is not the first argument of `fold`."""

    span: Span
    what: str


NameProblem = (
    DuplicateName
    | UnknownName
    | BadIdentifier
    | NameTooLong
    | ReservedName
    | HiddenName
    | RepeatedDeclaration
    | MissingDeclaration
    | EmptyRange
    | OutOfLimits
    | NotWhole
    | SafeOutside
    | GuessOutside
    | HoleConflict
    | RepeatedValue
    | WrongArgumentCount
    | WrongKind
    | HoleInProperty
    | RuleInProperty
    | ActionAsValue
    | UnknownWord
    | OnlyInProperties
    | MisshapenAction
    | MisplacedArgument
)
