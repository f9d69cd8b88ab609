"""The parameters that a template's results are affine in, given the others: least squares."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from pirlc.ir.policy import Continuous
from pirlc.symbolic.affine import DesignMatrices, affine_split
from pirlc.tune.problem import TuningProblem

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]
Rows = tuple[NDArray[np.float64], Vector]
"""A matrix and the right-hand side."""

_ROUNDS = 20
"""Of leaving out the histories in which the oracle saturates and the result lies beyond."""


class LinearSolver:
    """Least squares for the parameters that the raw results are affine in, given the others.

    Takes the histories in blocks: of more than one, it keeps a triangle instead of their rows.
    """

    def __init__(self, problem: TuningProblem) -> None:
        self._problem = problem
        split = affine_split(problem.template)
        self.any = bool(split.linear)
        self.solves_all = self.any and not split.others
        self._columns = np.array([problem.names.index(n) for n in split.linear], dtype=np.intp)
        if self.any:
            self._designs = DesignMatrices(problem.template, split, problem.histories)

    def solved(self, theta: Vector) -> Vector:
        """Theta with its linear part solved for, within the bounds.

        The oracle's actions are clipped, so where it saturates a result beyond the bound is as
        good: such histories are left out of the fit in turn.
        """
        if not self.any:
            return theta
        problem, theta = self._problem, theta.copy()
        lower, upper = problem.lower[self._columns], problem.upper[self._columns]
        upper = np.maximum(upper, np.nextafter(lower, np.inf))
        others = dict(zip(problem.names, theta.tolist(), strict=True))
        # A single block is worked out once, many again in each round.
        kept = list(self._rows(others)) if self._designs.pieces == 1 else None
        found: Vector | None = None
        counted: list[Mask] = []
        for _ in range(_ROUNDS):
            before, counted = counted, []
            fitted: list[Rows] = []
            for rows in kept or self._rows(others):
                mask = rows.counted(found)
                counted.append(mask)
                fitted.append((rows.matrix[mask], rows.target[mask]))
                if len(fitted) > 1:
                    fitted = [_triangle(fitted)]
            if found is not None and all(map(np.array_equal, before, counted)):
                break
            if sum(map(np.count_nonzero, counted)) < len(self._columns):
                break
            [(matrix, target)] = fitted
            found = lsq_linear(matrix, target, (lower, upper), method="bvls").x
        if found is not None:
            theta[self._columns] = found
        return theta

    def _rows(self, others: dict[str, float]) -> Iterator[_Equations]:
        problem = self._problem
        for begin, designs in self._designs.in_blocks(others):
            rows, targets, low, high = [], [], [], []
            for number, design in zip(self._designs.actions, designs, strict=True):
                domain = problem.template.interface.actions[number].domain
                assert isinstance(domain, Continuous)
                width = domain.upper - domain.lower
                rows.append(design.matrix / width)
                labels = problem.labels[begin : begin + len(design.offset), number]
                label = np.clip(labels, domain.lower, domain.upper)
                targets.append((label - design.offset) / width)
                low.append(label <= domain.lower)
                high.append(label >= domain.upper)
            matrix, target = np.concatenate(rows), np.concatenate(targets)
            yield _Equations(matrix, target, np.concatenate(low), np.concatenate(high))


@dataclass(frozen=True, eq=False)
class _Equations:
    """`matrix @ x` should be `target`, or where the oracle saturates below or above it too."""

    matrix: NDArray[np.float64]
    target: Vector
    at_low: Mask
    at_high: Mask

    def counted(self, x: Vector | None) -> Mask:
        """Those that a fit looks at, given the last one."""
        usable: Mask = np.isfinite(self.matrix).all(axis=1) & np.isfinite(self.target)
        if x is None:
            return usable
        residual = self.matrix @ x - self.target
        beyond: Mask = (self.at_low & (residual < 0)) | (self.at_high & (residual > 0))
        return usable & ~beyond


def _triangle(pieces: Sequence[Rows]) -> Rows:
    """Equations as few as there are unknowns (and one), with the same least squares."""
    whole = np.concatenate([np.column_stack(piece) for piece in pieces])
    reduced: Any = np.linalg.qr(whole, mode="r")
    return reduced[:, :-1], reduced[:, -1]
