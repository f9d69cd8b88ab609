"""The CasADi optimiser: gradients of the smoothed program, then the hard program's own distance.

For each start: the guards' temperature is lowered in steps, at each step L-BFGS goes down on the
smoothed objective, and the parameters that the results are affine in are solved for directly. At
last a short CMA-ES run on the distance itself takes what smoothing leaves.
"""

from __future__ import annotations

import numpy as np
from cmaes import CMA
from numpy.typing import NDArray
from scipy.optimize import Bounds, minimize
from threadpoolctl import threadpool_limits

from pirlc.symbolic.smooth import SmoothedObjective
from pirlc.tune.linear import LinearSolver
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
    solver = LinearSolver(problem)
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
    solver: LinearSolver,
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
