"""The CasADi optimiser: gradients of the smoothed program, then the hard program's own distance.

For each start: the guards' temperature is lowered in steps, at each step L-BFGS goes down on the
smoothed objective, and the parameters that the results are affine in are solved for directly. At
last a short CMA-ES run on the distance itself takes what smoothing leaves.
"""

from __future__ import annotations

import numpy as np
from cmaes import CMA
from numpy.typing import NDArray
from scipy.optimize import Bounds, lsq_linear, minimize
from threadpoolctl import threadpool_limits

from pirlc.ir.policy import Continuous
from pirlc.symbolic.affine import DesignMatrices, affine_split
from pirlc.symbolic.smooth import SmoothedObjective
from pirlc.tune.problem import Score, Tuned, TuningProblem
from pirlc.tune.starts import Coordinates, coordinates, starts

Vector = NDArray[np.float64]

STARTS = 4
TEMPERATURES = (1.0, 0.3, 0.1, 0.03)
ITERATIONS = 30
"""Of L-BFGS at each temperature."""
POLISHING = 40
"""Generations of CMA-ES at the end."""


def tune(problem: TuningProblem, seed: int) -> Tuned:
    """The parameters found; a template without any is only scored."""
    # Matrices this small are slower by several times with more threads of the linear algebra.
    with threadpool_limits(1):
        return _tune(problem, seed)


def _tune(problem: TuningProblem, seed: int) -> Tuned:
    score = Score(problem)
    if not problem.names:
        return score.tuned(np.zeros(0))
    rng = np.random.default_rng(seed)
    objective = SmoothedObjective(problem.template, problem.histories, problem.labels)
    frame = coordinates(problem, objective)
    solver = _LinearSolver(problem)
    found: list[tuple[float, int, Vector]] = []
    for start in starts(problem, objective, frame, rng, STARTS):
        for theta in (start, *_anneal(problem, objective, frame, solver, start)):
            found.append((score(theta), len(found), theta))
        if solver.solves_all:
            break
    best = min(found)
    return score.tuned(_polish(problem, score, frame, best[2], best[0], seed))


def _anneal(
    problem: TuningProblem,
    objective: SmoothedObjective,
    frame: Coordinates,
    solver: _LinearSolver,
    start: Vector,
) -> list[Vector]:
    """The parameters after each temperature."""
    theta = solver.solved(start)
    reached = [theta]
    if solver.solves_all:
        return reached
    bounds = Bounds(problem.lower / frame.scale, problem.upper / frame.scale)
    for temperature in TEMPERATURES:
        objective.set_scales(objective.scales_at(theta))

        def value(x: Vector, temperature: float = temperature) -> tuple[float, Vector]:
            loss, gradient = objective(x * frame.scale, temperature)
            if not (np.isfinite(loss) and np.isfinite(gradient).all()):
                return 1e9, np.zeros_like(x)
            return loss, gradient * frame.scale

        result = minimize(
            value,
            theta / frame.scale,
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            options={"maxiter": ITERATIONS},
        )
        theta = np.clip(result.x * frame.scale, problem.lower, problem.upper)
        reached.append(theta)
        if solver.any:
            theta = solver.solved(theta)
            reached.append(theta)
    return reached


class _LinearSolver:
    """Least squares for the parameters that the raw results are affine in, given the others."""

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
        designs = self._designs(dict(zip(problem.names, theta.tolist(), strict=True)))
        rows, targets, low, high = [], [], [], []
        for number, design in zip(self._designs.actions, designs, strict=True):
            domain = problem.template.interface.actions[number].domain
            assert isinstance(domain, Continuous)
            width = domain.upper - domain.lower
            rows.append(design.matrix / width)
            label = np.clip(problem.labels[:, number], domain.lower, domain.upper)
            targets.append((label - design.offset) / width)
            low.append(label <= domain.lower)
            high.append(label >= domain.upper)
        matrix, target = np.concatenate(rows), np.concatenate(targets)
        at_low, at_high = np.concatenate(low), np.concatenate(high)
        usable = np.isfinite(matrix).all(axis=1) & np.isfinite(target)
        lower, upper = problem.lower[self._columns], problem.upper[self._columns]
        upper = np.maximum(upper, np.nextafter(lower, np.inf))
        counted = usable
        for _ in range(20):
            if np.count_nonzero(counted) < len(self._columns):
                break
            fit = lsq_linear(matrix[counted], target[counted], (lower, upper), method="bvls")
            theta[self._columns] = fit.x
            residual = matrix @ fit.x - target
            beyond = (at_low & (residual < 0)) | (at_high & (residual > 0))
            if np.array_equal(counted, usable & ~beyond):
                break
            counted = usable & ~beyond
        return theta


def _polish(
    problem: TuningProblem,
    score: Score,
    frame: Coordinates,
    theta: Vector,
    reached: float,
    seed: int,
) -> Vector:
    """CMA-ES on the distance itself, from the best parameters found so far."""
    size = np.maximum(frame.scale, np.abs(theta))
    if len(theta) == 1:
        size, theta = np.append(size, 1.0), np.append(theta, 0.0)
    width = len(problem.names)
    optimizer = CMA(mean=theta / size, sigma=0.1, seed=seed)
    best = theta
    for _ in range(POLISHING):
        asked = [optimizer.ask() for _ in range(optimizer.population_size)]
        told = []
        for x in asked:
            candidate = np.clip((x * size)[:width], problem.lower, problem.upper)
            loss = score(candidate)
            told.append((x, loss))
            if loss < reached:
                best, reached = candidate, loss
        optimizer.tell(told)
        if optimizer.should_stop():
            break
    return best[:width]
