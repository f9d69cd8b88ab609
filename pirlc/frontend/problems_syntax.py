"""E01xx as values: the text does not follow the grammar."""

from __future__ import annotations

from dataclasses import dataclass

from pirlc.source import Span


@dataclass(frozen=True)
class UnknownCharacter:
    span: Span
    character: str


@dataclass(frozen=True)
class Unexpected:
    """`expected` and `found` are in words; `inside` is the keyword of the declaration."""

    span: Span
    found: str
    expected: tuple[str, ...]
    inside: str | None
    help: str | None = None


@dataclass(frozen=True)
class UnclosedText:
    span: Span


@dataclass(frozen=True)
class UnclosedBracket:
    """`span` is the opening bracket, `end` the place where the closing one is missed."""

    span: Span
    bracket: str
    end: Span


@dataclass(frozen=True)
class TooDeep:
    span: Span
    limit: int


@dataclass(frozen=True)
class NotFinite:
    span: Span
    text: str


@dataclass(frozen=True)
class FileTooLong:
    length: int
    limit: int


@dataclass(frozen=True)
class ForeignSpelling:
    """Another language's spelling of something that this one has."""

    span: Span
    written: str
    meant: str


@dataclass(frozen=True)
class ChainedComparison:
    span: Span
    operator: str


@dataclass(frozen=True)
class IncompleteConditional:
    """`missing` is ``then`` or ``else``."""

    span: Span
    missing: str
    opening: Span


SyntaxProblem = (
    UnknownCharacter
    | Unexpected
    | UnclosedText
    | UnclosedBracket
    | TooDeep
    | NotFinite
    | FileTooLong
    | ForeignSpelling
    | ChainedComparison
    | IncompleteConditional
)
