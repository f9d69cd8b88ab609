"""E03xx as values: types.

Types are given as their text (`str(type)`).
"""

from __future__ import annotations

from dataclasses import dataclass

from pirlc.source import Span


@dataclass(frozen=True)
class TypeMismatch:
    """`role` says what the expression is there for, such as "the operand of `and`"."""

    span: Span
    expected: str
    found: str
    role: str
    help: str | None = None


@dataclass(frozen=True)
class LengthMismatch:
    span: Span
    left: Span
    left_length: int
    right: Span
    right_length: int


@dataclass(frozen=True)
class IndexOutside:
    span: Span
    index: int
    length: int
    sequence: Span


@dataclass(frozen=True)
class IndexNotLiteral:
    span: Span


@dataclass(frozen=True)
class NotAValue:
    span: Span
    text: str
    values: tuple[int, ...]


@dataclass(frozen=True)
class BranchNotAtom:
    span: Span
    found: str


@dataclass(frozen=True)
class NotFoldable:
    span: Span
    text: str


@dataclass(frozen=True)
class DiffTooShort:
    span: Span


@dataclass(frozen=True)
class Incomparable:
    span: Span
    left: Span
    left_type: str
    right: Span
    right_type: str


@dataclass(frozen=True)
class RawOfDiscrete:
    span: Span
    name: str


TypeProblem = (
    TypeMismatch
    | LengthMismatch
    | IndexOutside
    | IndexNotLiteral
    | NotAValue
    | BranchNotAtom
    | NotFoldable
    | DiffTooShort
    | Incomparable
    | RawOfDiscrete
)
