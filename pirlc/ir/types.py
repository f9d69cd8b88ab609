"""Types of terms: real, boolean, discrete action, sequence of real with its length."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Real:
    def __str__(self) -> str:
        return "real"


@dataclass(frozen=True, slots=True)
class Bool:
    def __str__(self) -> str:
        return "bool"


@dataclass(frozen=True, slots=True)
class Discrete:
    """One of the listed action values; only literals and `previous` have this type."""

    values: tuple[int, ...]

    def __str__(self) -> str:
        return "discrete action {" + ", ".join(map(str, self.values)) + "}"


@dataclass(frozen=True, slots=True)
class Sequence:
    """`length` reals, oldest first."""

    length: int

    def __str__(self) -> str:
        return f"sequence of {self.length}"


Type = Real | Bool | Discrete | Sequence
