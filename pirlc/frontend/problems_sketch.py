"""E04xx as values: the sketch as a whole."""

from __future__ import annotations

from dataclasses import dataclass

from pirlc.source import Span


@dataclass(frozen=True)
class EndlessRule:
    span: Span
    name: str


@dataclass(frozen=True)
class UnguardedRecursion:
    """Expanding `cycle` returns to its first rule without adding anything to the program."""

    span: Span
    cycle: tuple[str, ...]


@dataclass(frozen=True)
class NoProgram:
    span: Span
    action: str
    rule: str


@dataclass(frozen=True)
class SafeMissing:
    """`cause` says what may leave the action without a value, at `cause_span`."""

    span: Span
    action: str
    cause: str
    cause_span: Span


@dataclass(frozen=True)
class SameComponent:
    span: Span
    component: int
    first: Span
    first_name: str


@dataclass(frozen=True)
class TooManyInstances:
    span: Span
    name: str
    limit: int


@dataclass(frozen=True)
class UnusedRule:
    span: Span
    name: str


@dataclass(frozen=True)
class UnusedParameter:
    span: Span
    name: str


SketchProblem = (
    EndlessRule
    | UnguardedRecursion
    | NoProgram
    | SafeMissing
    | SameComponent
    | TooManyInstances
    | UnusedRule
    | UnusedParameter
)
