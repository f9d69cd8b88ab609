"""Where tuning starts: parameters at which the guards tell the histories apart.

A guard such as `a*x + b*y > c` is useful only if its boundary passes through the data. What a unit
of each parameter moves differs by orders of magnitude between sensors, so all optimisers work in
coordinates in which a unit of any parameter moves a guard (or an action) by a typical amount.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pirlc.ir.policy import ProgramTemplate
from pirlc.semantics.histories import HistorySet
from pirlc.symbolic.smooth import SmoothedObjective
from pirlc.tune.problem import TuningProblem

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Coordinates:
    """`scale` (P,): parameters are `scale * x`. `offsets`: for a guard's number the parameter that
    shifts it by the same amount everywhere. `guarding` (P,): which parameters move a guard; the
    others' scale is not measured."""

    scale: Vector
    offsets: dict[int, int]
    guarding: NDArray[np.bool_]


def coordinates(problem: TuningProblem, objective: SmoothedObjective) -> Coordinates:
    """Measured on the histories by moving one parameter at a time from 0."""
    count = len(problem.names)
    zero = np.zeros(count)
    base = objective.margins(zero)
    fixed = np.nan_to_num(base.std(axis=1)) if base.size else np.zeros(len(base))
    scale = np.ones(count)
    guarding = np.zeros(count, dtype=np.bool_)
    offsets: dict[int, int] = {}
    for j in range(count):
        unit = zero.copy()
        unit[j] = 1.0
        moved = objective.margins(unit) - base
        if not moved.size or not np.isfinite(moved).all():
            continue
        size = np.sqrt((moved**2).mean(axis=1))
        guard = int(np.argmax(size))
        if size[guard] > 0.0:
            guarding[j] = True
            scale[j] = (fixed[guard] or 1.0) / size[guard]
            if moved[guard].std() <= 1e-9 * size[guard]:
                offsets.setdefault(guard, j)
    # A parameter whose bounds leave one value has a scale too: others are divided by it.
    half = np.maximum(problem.upper / 2 - problem.lower / 2, 1e-6)
    return Coordinates(np.clip(scale, 1e-6, half), offsets, guarding)


def starts(
    problem: TuningProblem,
    objective: SmoothedObjective,
    frame: Coordinates,
    rng: np.random.Generator,
    count: int,
) -> Iterator[Vector]:
    """Parameters (P,) to start from: what is known first, filled up at random, then random ones."""
    guesses = {p.name: p.guess for p in problem.template.free if p.guess is not None}
    known = {**guesses, **problem.start}
    if known:
        yield _random(problem, objective, frame, rng, known)
    for _ in range(count - bool(problem.start)):
        yield _random(problem, objective, frame, rng, guesses)


def _random(
    problem: TuningProblem,
    objective: SmoothedObjective,
    frame: Coordinates,
    rng: np.random.Generator,
    known: dict[str, float],
) -> Vector:
    theta = frame.scale * rng.normal(size=len(problem.names))
    for j, name in enumerate(problem.names):
        theta[j] = known.get(name, theta[j])
    theta = np.clip(theta, problem.lower, problem.upper)
    free = [j for j in frame.offsets.values() if problem.names[j] not in known]
    if free:
        # Move each guard that can be shifted to pass through a history drawn at random.
        margins = objective.margins(theta)
        for guard, j in frame.offsets.items():
            if j in free:
                shifted = theta.copy()
                shifted[j] += 1.0
                unit = float((objective.margins(shifted)[guard] - margins[guard]).mean())
                if unit:
                    theta[j] -= float(rng.choice(margins[guard])) / unit
    return np.clip(theta, problem.lower, problem.upper)


def random_starts(
    template: ProgramTemplate,
    histories: HistorySet,
    known: Mapping[str, float],
    count: int,
    seed: int,
) -> list[dict[str, float]]:
    """Values for the free parameters at which the guards tell the histories apart.

    The first takes over what is `known`. For searches that have no oracle to come close to.
    """
    labels = np.zeros((len(histories), len(template.bodies)))
    problem = TuningProblem(template, histories, labels, known)
    objective = SmoothedObjective(template, histories, labels)
    frame = coordinates(problem, objective)
    found = starts(problem, objective, frame, np.random.default_rng(seed), count)
    return [dict(zip(problem.names, theta.tolist(), strict=True)) for theta in found]
