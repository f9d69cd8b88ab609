"""Quadratic Lyapunov functions for modes that alternate: found by LMI, confirmed exactly.

Numbers are found in binary64 (cvxpy with clarabel), in coordinates in which they are of one size,
and then rounded to rationals; only the exact check decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pirlc.analyze.exact import Rational, falls, is_positive_definite, rational

Real = NDArray[np.float64]

_SHARES = (0.5, 0.9, 0.99)
"""Decays to try, between the largest mode's squared spectral radius (0) and 1 (1)."""

_BITS = (16, 24, 36, 53)
"""Bits of the rationals to try, fewest first."""


@dataclass(frozen=True)
class Lyapunov:
    """One P for all modes, or one for each; V falls by `decay` (below 1) or more each step."""

    matrices: tuple[Rational, ...]
    decay: Fraction


def radius(matrix: Rational) -> float:
    return float(np.max(np.abs(np.linalg.eigvals(_floats(matrix)))))


def _floats(matrix: Rational) -> Real:
    return np.array([[float(value) for value in row] for row in matrix])


def common(modes: Sequence[Rational]) -> Lyapunov | None:
    """P with A_i' P A_i < decay P for every mode."""
    return _found(modes, single=True)


def switched(modes: Sequence[Rational]) -> Lyapunov | None:
    """P_i, one for each mode, with A_i' P_j A_i < decay P_i for all i, j.

    V(k) = z' P_i z with i the mode at k falls in whatever order the modes come (Daafouz, Riedinger
    and Iung 2002).
    """
    return _found(modes, single=False)


def _found(modes: Sequence[Rational], *, single: bool) -> Lyapunov | None:
    numbers = [_floats(mode) for mode in modes]
    worst = max(float(np.max(np.abs(np.linalg.eigvals(a)))) for a in numbers)
    if worst >= 1.0:
        return None
    for share in _SHARES:
        decay = worst**2 + share * (1.0 - worst**2)
        basis = _basis(numbers, decay)
        inverse = np.linalg.inv(basis)
        turned = [inverse @ a @ basis for a in numbers]
        solved = _solve(turned, decay, single)
        if solved is None:
            continue
        found = confirmed(modes, [inverse.T @ p @ inverse for p in solved], decay)
        if found is not None:
            return found
    return None


def _basis(modes: Sequence[Real], decay: float) -> Real:
    """Coordinates in which the mean of the modes' own Lyapunov functions is the identity."""
    n = len(modes[0])
    total = np.zeros((n, n))
    for a in modes:
        own = scipy.linalg.solve_discrete_lyapunov(a.T / np.sqrt(decay), np.eye(n))
        total += own / np.trace(own)
    factor = np.linalg.cholesky((total + total.T) / 2.0 + 1e-12 * np.eye(n))
    return np.asarray(np.linalg.inv(factor.T), dtype=np.float64)


def _solve(modes: Sequence[Real], decay: float, single: bool) -> list[Real] | None:
    """The P (or P_i) farthest inside the inequalities, or None where there is none."""
    import cvxpy as cp

    n = len(modes[0])
    count = 1 if single else len(modes)
    unknown: list[Any] = [cp.Variable((n, n), symmetric=True) for _ in range(count)]
    slack: Any = cp.Variable()
    eye = np.eye(n)
    constraints = [p >> eye for p in unknown] + [p << 1e6 * eye for p in unknown]
    for i, a in enumerate(modes):
        here = unknown[0 if single else i]
        for there in unknown:
            after = a.T @ there @ a
            margin = decay * here - (after + after.T) / 2 - slack * eye
            constraints.append((margin + margin.T) / 2 >> 0)
    problem = cp.Problem(cp.Maximize(slack), [*constraints, slack <= 1.0])
    try:
        problem.solve(solver=cp.CLARABEL)
    except cp.error.SolverError:
        return None
    if slack.value is None or not np.isfinite(slack.value) or float(slack.value) <= -1e-6:
        return None
    return [np.asarray((p.value + p.value.T) / 2.0, dtype=np.float64) for p in unknown]


def confirmed(
    modes: Sequence[Rational], candidates: Sequence[Real], decay: float
) -> Lyapunov | None:
    """The candidates as rationals for which every inequality holds exactly, if any.

    One candidate is for all modes, several are one for each. None where no rounding of them and no
    decay below 1 passes.
    """
    largest = max(float(np.max(np.abs(p))) for p in candidates)
    for bits in _BITS:
        matrices = tuple(_rounded(p / largest, bits) for p in candidates)
        if not all(is_positive_definite(p) for p in matrices):
            continue
        for near in (decay, 0.5 * (decay + 1.0), 0.99 + 0.01 * decay):
            factor = _above(near)
            if factor < 1 and _all_fall(modes, matrices, factor):
                return Lyapunov(matrices, factor)
    return None


def _all_fall(modes: Sequence[Rational], matrices: Sequence[Rational], factor: Fraction) -> bool:
    if len(matrices) == 1:
        return all(falls(mode, matrices[0], matrices[0], factor) for mode in modes)
    return all(
        falls(mode, here, there, factor)
        for mode, here in zip(modes, matrices, strict=True)
        for there in matrices
    )


def _above(value: float) -> Fraction:
    """A short decimal fraction above the value, nearer to it than to 1."""
    room = 1.0 - value
    digits = 1
    while 10.0**-digits > room / 4.0 and digits < 15:
        digits += 1
    return Fraction(int(np.ceil(value * 10**digits)), 10**digits)


def _rounded(matrix: Real, bits: int) -> Rational:
    """Symmetric, each entry to `bits` bits of the geometric mean of its diagonal entries."""
    size = np.sqrt(np.abs(np.diag(matrix)))
    scale = np.exp2(np.floor(np.log2(np.outer(size, size) + 1e-300)) - bits)
    near = np.round(matrix / scale) * scale
    return rational(np.triu(near) + np.triu(near, 1).T)
