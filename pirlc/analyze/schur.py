"""Whether a matrix of rationals has all eigenvalues inside the unit circle, decided exactly."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from pirlc.analyze.exact import Rational, falls, is_positive_definite

_QUICK, _SMALL, _LARGEST = 8, 14, 60
"""States up to which characteristic polynomials take no time and little time, and up to which
Lyapunov functions take little."""

Rows = Sequence[Sequence[Fraction]]


def decided(matrix: Rows) -> tuple[bool | None, str]:
    """Whether all eigenvalues have a magnitude below 1, and by what; None: not decided."""
    test = "Schur and Cohn's test in exact rationals"
    if len(matrix) <= _QUICK:
        return is_schur(matrix), test
    stable = by_lyapunov(matrix) if len(matrix) <= _LARGEST else None
    if stable is None and len(matrix) <= _SMALL:
        return is_schur(matrix), test
    return stable, "a Lyapunov function, confirmed in exact rationals"


def by_lyapunov(matrix: Rows) -> bool | None:
    """The same by a quadratic function V that falls along every step, checked exactly.

    V positive definite: stable. V that is not: it never comes back to 0 from where it is negative
    (Lyapunov's and Chetaev's theorems), so not stable. None where no such function was found.
    """
    import numpy as np
    import scipy.linalg

    a = np.array(matrix, dtype=np.float64)
    # Balanced by powers of two, so that states of very different size do not spoil the solution.
    balanced, scales = scipy.linalg.matrix_balance(a, permute=False, separate=True)
    try:
        found = scipy.linalg.solve_discrete_lyapunov(balanced.T, np.eye(len(a)))
    except (np.linalg.LinAlgError, ValueError):
        return None
    if not np.all(np.isfinite(found)):
        return None
    scale = scales[0]
    exact = tuple(
        tuple(x * Fraction(scale[j]) / Fraction(scale[i]) for j, x in enumerate(row))
        for i, row in enumerate(matrix)
    )
    candidate = _rounded(found)
    if not falls(exact, candidate, candidate, Fraction(1)):
        return None
    return is_positive_definite(candidate)


def _rounded(matrix: Any) -> Rational:
    """Symmetric, to 40 bits: short numbers keep exact arithmetic quick."""
    import math

    def short(x: float) -> Fraction:
        mantissa, exponent = math.frexp(x)
        return Fraction(round(mantissa * 2**40)) * Fraction(2) ** (exponent - 40)

    n = len(matrix)
    upper = [[short(0.5 * float(matrix[i][j] + matrix[j][i])) for j in range(n)] for i in range(n)]
    return tuple(tuple(upper[min(i, j)][max(i, j)] for j in range(n)) for i in range(n))


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
