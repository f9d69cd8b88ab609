"""Whether a matrix of rationals has all eigenvalues inside the unit circle, decided exactly."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

LARGEST = 16
"""States; beyond, exact arithmetic may take seconds."""

Rows = Sequence[Sequence[Fraction]]


def is_schur(matrix: Rows) -> bool:
    """Whether all eigenvalues of a square matrix have a magnitude below 1."""
    return polynomial_is_schur(characteristic(matrix))


def characteristic(matrix: Rows) -> list[Fraction]:
    """The coefficients of det(zI - matrix), the leading 1 first, by Hessenberg's form."""
    n = len(matrix)
    h = [list(row) for row in matrix]
    for k in range(1, n - 1):
        pivot = next((i for i in range(k, n) if h[i][k - 1]), None)
        if pivot is None:
            continue
        if pivot != k:
            h[pivot], h[k] = h[k], h[pivot]
            for row in h:
                row[pivot], row[k] = row[k], row[pivot]
        for i in range(k + 1, n):
            factor = h[i][k - 1] / h[k][k - 1]
            if factor:
                h[i] = [x - factor * y for x, y in zip(h[i], h[k], strict=True)]
                for row in h:
                    row[k] += factor * row[i]
    # p_k = (z - h_kk) p_(k-1) - sum over i of h_(k-i,k) (h_(k,k-1) ... h_(k-i+1,k-i)) p_(k-i-1)
    polynomials = [[Fraction(1)]]
    for k in range(n):
        before = polynomials[-1]
        new = [*before, Fraction(0)]
        for i, x in enumerate(before):
            new[i + 1] -= h[k][k] * x
        product = Fraction(1)
        for i in range(1, k + 1):
            product *= h[k - i + 1][k - i]
            if not product:
                break
            factor = h[k - i][k] * product
            old = polynomials[k - i]
            for j, x in enumerate(old):
                new[j + len(new) - len(old)] -= factor * x
        polynomials.append(new)
    return polynomials[-1]


def polynomial_is_schur(coefficients: Sequence[Fraction]) -> bool:
    """All roots inside the unit circle: Schur and Cohn's recursion (Jury's table)."""
    p = list(coefficients)
    while p and not p[-1]:
        p.pop()
    while len(p) > 1:
        if abs(p[-1]) >= abs(p[0]):
            return False
        factor = p[-1] / p[0]
        p = [x - factor * y for x, y in zip(p, reversed(p), strict=True)][:-1]
    return True
