"""What a statement about a program rests on; nothing is called more than it is."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Kind(Enum):
    """The value is the words that reports use."""

    PROVED = "proved"
    LINEARISED = "proved for the linearisation"
    TESTED = "tested"
    REFUTED = "refuted"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Evidence:
    """`cases` are what a tested statement was tested on; `reason` says why more is not known, or
    what the statement holds under."""

    kind: Kind
    reason: str = ""
    cases: int = 0

    def __str__(self) -> str:
        words = self.kind.value
        if self.kind is Kind.TESTED:
            words += f" on {self.cases:,}"
        return f"{words} ({self.reason})" if self.reason else words


PROVED = Evidence(Kind.PROVED)
REFUTED = Evidence(Kind.REFUTED)


def unknown(reason: str) -> Evidence:
    return Evidence(Kind.UNKNOWN, reason)


def tested(cases: int, reason: str = "") -> Evidence:
    return Evidence(Kind.TESTED, reason, cases)
