"""The basic operators: how each is written, its precedence, and its type.

Every evaluator and printer is a `match` or a table over `Operator`; what an operator computes is
said here once, in words, and nowhere assumed from the host language.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from pirlc.ir.types import Bool, Real, Type


class Operator(Enum):
    """The value is the operator as the language writes it."""

    IMPLIES = "implies"
    OR = "or"
    AND = "and"
    NOT = "not"
    LESS = "<"
    LESS_EQUAL = "<="
    GREATER = ">"
    GREATER_EQUAL = ">="
    EQUAL = "=="
    NOT_EQUAL = "!="
    ADD = "+"
    SUBTRACT = "-"
    MULTIPLY = "*"
    DIVIDE = "/"
    NEGATE = "neg"
    ABS = "abs"
    MIN = "min"
    MAX = "max"
    CLIP = "clip"
    SQRT = "sqrt"
    EXP = "exp"
    TANH = "tanh"
    SIGN = "sign"


class Notation(Enum):
    """How an operator is written."""

    INFIX = "infix"
    PREFIX = "prefix"
    CALL = "call"


@dataclass(frozen=True, slots=True)
class Signature:
    """Arity, types and notation. Real arguments broadcast over sequences, elementwise.

    `precedence` orders infix and prefix operators, loosest first (design: implies, or, and, not,
    comparison, sum, product, negation).
    """

    argument: Type
    arity: int
    result: Type
    notation: Notation
    precedence: int = 9
    meaning: str = ""


_REAL, _BOOL = Real(), Bool()


def _comparison(meaning: str) -> Signature:
    return Signature(_REAL, 2, _BOOL, Notation.INFIX, 5, meaning)


def _function(arity: int, meaning: str) -> Signature:
    return Signature(_REAL, arity, _REAL, Notation.CALL, 9, meaning)


SIGNATURES: dict[Operator, Signature] = {
    Operator.IMPLIES: Signature(_BOOL, 2, _BOOL, Notation.INFIX, 1, "not a or b"),
    Operator.OR: Signature(_BOOL, 2, _BOOL, Notation.INFIX, 2, "either holds"),
    Operator.AND: Signature(_BOOL, 2, _BOOL, Notation.INFIX, 3, "both hold"),
    Operator.NOT: Signature(_BOOL, 1, _BOOL, Notation.PREFIX, 4, "does not hold"),
    Operator.LESS: _comparison("false with a NaN"),
    Operator.LESS_EQUAL: _comparison("false with a NaN"),
    Operator.GREATER: _comparison("false with a NaN"),
    Operator.GREATER_EQUAL: _comparison("false with a NaN"),
    Operator.EQUAL: _comparison("false with a NaN; also between discrete actions"),
    Operator.NOT_EQUAL: _comparison("not (a == b), so true with a NaN"),
    Operator.ADD: Signature(_REAL, 2, _REAL, Notation.INFIX, 6, "IEEE sum"),
    Operator.SUBTRACT: Signature(_REAL, 2, _REAL, Notation.INFIX, 6, "IEEE difference"),
    Operator.MULTIPLY: Signature(_REAL, 2, _REAL, Notation.INFIX, 7, "IEEE product"),
    Operator.DIVIDE: Signature(_REAL, 2, _REAL, Notation.INFIX, 7, "IEEE quotient, never raises"),
    Operator.NEGATE: Signature(_REAL, 1, _REAL, Notation.PREFIX, 8, "flips the sign, of zero too"),
    Operator.ABS: _function(1, "clears the sign"),
    Operator.MIN: _function(2, "a < b ? a : b"),
    Operator.MAX: _function(2, "a > b ? a : b"),
    Operator.CLIP: _function(3, "x < l ? l : x > h ? h : x"),
    Operator.SQRT: _function(1, "IEEE square root; NaN below zero"),
    Operator.EXP: _function(1, "libm exp"),
    Operator.TANH: _function(1, "libm tanh"),
    Operator.SIGN: _function(1, "x > 0 ? 1 : x < 0 ? -1 : x == 0 ? 0 : NaN; the zero is +0"),
}

FOLDABLE = (Operator.ADD, Operator.MULTIPLY, Operator.MIN, Operator.MAX)
"""The operators that `fold(op, x)` takes."""

COMPARISONS = (
    Operator.LESS,
    Operator.LESS_EQUAL,
    Operator.GREATER,
    Operator.GREATER_EQUAL,
    Operator.EQUAL,
    Operator.NOT_EQUAL,
)

COMMUTATIVE = (
    Operator.OR,
    Operator.AND,
    Operator.EQUAL,
    Operator.NOT_EQUAL,
    Operator.ADD,
    Operator.MULTIPLY,
)
"""Operators whose arguments may be swapped without changing any result bit."""
