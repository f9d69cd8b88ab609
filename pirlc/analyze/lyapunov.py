"""Quadratic Lyapunov functions for modes that alternate: found by LMI, confirmed exactly.

Numbers are found in binary64 (cvxpy with clarabel), in coordinates in which they are of one size,
and then rounded to rationals; only the exact check decides.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pirlc.analyze.exact import Rational, falls, is_positive_definite, rational

Real = NDArray[np.float64]

_SHARES = (0.5, 0.9, 0.99)
"""Decays to try, between the largest mode's squared spectral radius (0) and 1 (1)."""

_SPREAD = 1e6
"""The largest eigenvalue that a matrix may have, its least being 1."""

MOST_ROWS = 40
"""Rows of all unknown matrices together; a linear matrix inequality of more takes minutes."""

_BITS = (16, 24, 36, 53)
"""Bits of the rationals to try, fewest first."""


Word = tuple[int, ...]
"""The numbers of the mode in force and of those that come next."""


@dataclass(frozen=True)
class Edge:
    """Under this mode what `here` measures becomes what `there` measures (numbers of words)."""

    mode: int
    here: int
    there: int


@dataclass(frozen=True)
class Lyapunov:
    """A function for each of `words`; the one in force falls by `decay` (below 1) or more."""

    words: tuple[Word, ...]
    matrices: tuple[Rational, ...]
    decay: Fraction


def radius(matrix: Rational) -> float:
    return float(np.max(np.abs(np.linalg.eigvals(_floats(matrix)))))


def _floats(matrix: Rational) -> Real:
    return np.array([[float(value) for value in row] for row in matrix])


def words_of(modes: int, length: int) -> tuple[Word, ...]:
    return tuple(product(range(modes), repeat=length))


def edges_of(words: Sequence[Word], modes: int) -> tuple[Edge, ...]:
    """Every way on from every word: its first mode is done, another joins at its end."""
    return tuple(
        Edge((*word, joining)[0], here, words.index((*word, joining)[1:]))
        for here, word in enumerate(words)
        for joining in range(modes)
    )


def lyapunov(modes: Sequence[Rational], length: int) -> Lyapunov | None:
    """A quadratic function for each word of `length` modes, such that V falls in any order of them.

    Length 0 is one P for all: A_i' P A_i < decay P. Length 1 is a P for each mode (Daafouz,
    Riedinger and Iung 2002): A_i' P_j A_i < decay P_i for all i, j. Longer words know more of what
    comes next (Lee and Dullerud 2006), and find a function for every stable set at some length.
    """
    numbers = [_floats(mode) for mode in modes]
    worst = max(float(np.max(np.abs(np.linalg.eigvals(a)))) for a in numbers)
    if worst >= 1.0:
        return None
    words = words_of(len(modes), length)
    edges = edges_of(words, len(modes))
    for share in _SHARES:
        decay = worst**2 + share * (1.0 - worst**2)
        basis = _basis(numbers, decay)
        inverse = np.linalg.inv(basis)
        turned = [inverse @ a @ basis for a in numbers]
        if not length:
            # Modes that are alike, or one alone, need no search.
            again = np.linalg.inv(_basis(turned, decay)) @ inverse
            found = confirmed(modes, words, edges, [again.T @ again], decay)
            if found is not None:
                return found
        if len(words) * len(basis) > MOST_ROWS:
            continue
        with warnings.catch_warnings():
            # Whether a solution is accurate enough is found out exactly.
            warnings.simplefilter("ignore")
            solved = _solve(turned, edges, decay)
        if solved is None:
            continue
        candidates = [inverse.T @ p @ inverse for p in solved]
        found = confirmed(modes, words, edges, candidates, decay)
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
    try:
        factor = np.linalg.cholesky((total + total.T) / 2.0 + 1e-12 * np.eye(n))
        return np.asarray(np.linalg.inv(factor.T), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.eye(n)


def _solve(modes: Sequence[Real], edges: Sequence[Edge], decay: float) -> list[Real] | None:
    """The matrices farthest inside the inequalities, or None where there are none."""
    import cvxpy as cp

    n = len(modes[0])
    unknown: list[Any] = [
        cp.Variable((n, n), symmetric=True) for _ in range(1 + max(edge.here for edge in edges))
    ]
    slack: Any = cp.Variable()
    eye = np.eye(n)
    constraints = [p >> eye for p in unknown] + [p << _SPREAD * eye for p in unknown]
    for edge in edges:
        a = modes[edge.mode]
        margin = decay * unknown[edge.here] - a.T @ unknown[edge.there] @ a - slack * eye
        constraints.append((margin + margin.T) / 2 >> 0)
    problem = cp.Problem(cp.Maximize(slack), [*constraints, slack <= 1.0])
    try:
        problem.solve(solver=cp.CLARABEL)  # type: ignore[no-untyped-call]
    except cp.error.SolverError:
        return None
    if slack.value is None or not np.isfinite(slack.value) or float(slack.value) <= -1e-6:
        return None
    return [np.asarray((p.value + p.value.T) / 2.0, dtype=np.float64) for p in unknown]


def confirmed(
    modes: Sequence[Rational],
    words: Sequence[Word],
    edges: Sequence[Edge],
    candidates: Sequence[Real],
    decay: float,
) -> Lyapunov | None:
    """The candidates as rationals for which every inequality holds exactly, if any.

    None where no rounding of them and no decay below 1 passes.
    """
    largest = max(float(np.max(np.abs(p))) for p in candidates)
    for bits in _BITS:
        matrices = tuple(_rounded(p / largest, bits) for p in candidates)
        if not all(is_positive_definite(p) for p in matrices):
            continue
        for near in (decay, 0.5 * (decay + 1.0), 0.99 + 0.01 * decay):
            factor = _above(near)
            if factor < 1 and all(
                falls(modes[edge.mode], matrices[edge.here], matrices[edge.there], factor)
                for edge in edges
            ):
                return Lyapunov(tuple(words), matrices, factor)
    return None


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
