"""Definiteness in exact arithmetic: the check that no rounding can spoil.

Matrices are rows of `Fraction`s, made of integers over one common denominator before anything is
multiplied, so that the arithmetic is Python's own on integers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import lcm

Rational = tuple[tuple[Fraction, ...], ...]


@dataclass(frozen=True)
class _Integers:
    """`rows` over `denominator` (positive)."""

    rows: list[list[int]]
    denominator: int


def _integers(matrix: Rational) -> _Integers:
    denominator = lcm(*(value.denominator for row in matrix for value in row))
    rows = [[int(value * denominator) for value in row] for row in matrix]
    return _Integers(rows, denominator)


def _product(left: list[list[int]], right: list[list[int]]) -> list[list[int]]:
    columns = list(zip(*right, strict=True))
    return [
        [sum(a * b for a, b in zip(row, column, strict=True) if a and b) for column in columns]
        for row in left
    ]


def is_positive_definite(matrix: Rational) -> bool:
    """Whether a symmetric matrix is; false where it is not symmetric.

    By Sylvester's criterion: the pivots of Bareiss's fraction-free elimination are the leading
    principal minors.
    """
    return _definite(_integers(matrix).rows)


def _definite(rows: list[list[int]]) -> bool:
    n = len(rows)
    if any(rows[i][j] != rows[j][i] for i in range(n) for j in range(i)):
        return False
    work = [list(row) for row in rows]
    before = 1
    for k in range(n):
        pivot = work[k][k]
        if pivot <= 0:
            return False
        for i in range(k + 1, n):
            for j in range(i, n):
                entry = (work[i][j] * pivot - work[k][i] * work[k][j]) // before
                work[i][j] = work[j][i] = entry
        before = pivot
    return True


def falls(mode: Rational, here: Rational, there: Rational, factor: Fraction) -> bool:
    """Whether (A z)' Q (A z) < factor z' P z for all z but 0, with P `here` and Q `there`.

    That is: factor P - A' Q A is positive definite. P and Q are symmetric.
    """
    a, p, q = _integers(mode), _integers(here), _integers(there)
    transposed = [list(column) for column in zip(*a.rows, strict=True)]
    after = _product(_product(transposed, q.rows), a.rows)
    left = factor.numerator * a.denominator**2 * q.denominator
    right = factor.denominator * p.denominator
    n = len(a.rows)
    return _definite(
        [[left * p.rows[i][j] - right * after[i][j] for j in range(n)] for i in range(n)]
    )


def rational(rows: Sequence[Sequence[float]]) -> Rational:
    """The exact values of binary64 numbers."""
    return tuple(tuple(Fraction(value) for value in row) for row in rows)
