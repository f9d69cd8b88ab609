"""The Bayesian optimiser: a Gaussian process over the parameters guesses where the distance is low.

The paper's primary tool (Verma et al., ICML 2018, appendix, "Bayesian optimization"), here with
optuna's `GPSampler`: a Matérn kernel with a length scale for each parameter, logarithmic expected
improvement. The objective is the hard program's own distance; nothing is smoothed, no structure of
the template is used. So it can take any template, but each trial costs a fit to all former ones.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from pirlc.ir.policy import Continuous
from pirlc.symbolic.smooth import SmoothedObjective
from pirlc.tune.how import Tuning
from pirlc.tune.problem import Score, Tuned, TuningProblem
from pirlc.tune.scales import natural_scales
from pirlc.tune.starts import Coordinates, coordinates, starts

Vector = NDArray[np.float64]

STARTS = 10
"""Trials before the process has a say: what is known first, then guards through the data."""

WIDTH = 4.0
"""The search's box reaches this many natural scales to both sides of 0."""


def tune(problem: TuningProblem, seed: int, how: Tuning) -> Tuned:
    """The best of `how.trials` trials, or of those begun within `how.seconds` (at least one).

    A template without free parameters is only scored. Trials end early at a distance of 0.
    """
    score = Score(problem)
    if not problem.names:
        return score.tuned(np.zeros(0))
    # Matrices this small are slower by several times with more threads of the linear algebra.
    with threadpool_limits(1), _quiet():
        return score.tuned(_best(problem, score, seed, how))


@dataclass(frozen=True, eq=False)
class Box:
    """Where parameters (P,) are searched: `scale * sinh(u)` for u in [lower, upper].

    So steps are even near 0, and in proportion to a parameter that is large.
    """

    scale: Vector
    lower: Vector
    upper: Vector

    def theta(self, u: Vector) -> Vector:
        return self.scale * np.sinh(u)

    def place(self, theta: Vector) -> Vector:
        """The u in the box that is next to parameters theta."""
        return np.clip(np.arcsinh(theta / self.scale), self.lower, self.upper)


def _best(problem: TuningProblem, score: Score, seed: int, how: Tuning) -> Vector:
    import optuna
    from optuna.samplers import GPSampler, RandomSampler

    began = time.monotonic()
    objective = SmoothedObjective(problem.template, problem.histories, problem.labels)
    frame = _measured(problem, objective, seed)
    rng = np.random.default_rng(seed)
    first = list(starts(problem, objective, frame, rng, STARTS))
    box = _box(problem, objective, frame, first)
    free = [j for j in range(len(problem.names)) if box.lower[j] < box.upper[j]]
    # The distance of discrete actions has steps, which to a smooth process are noise.
    smooth = all(isinstance(a.domain, Continuous) for a in problem.template.interface.actions)
    sampler = GPSampler(
        seed=seed,
        independent_sampler=RandomSampler(seed=seed),
        n_startup_trials=len(first),
        deterministic_objective=smooth,
    )
    study = optuna.create_study(sampler=sampler)
    for theta in first:
        u = box.place(theta)
        study.enqueue_trial({problem.names[j]: float(u[j]) for j in free})
    best, reached = first[0], np.inf
    for number in range(how.trials):
        late = how.seconds is not None and time.monotonic() - began >= how.seconds
        if number and (late or reached == 0.0 or not free):
            break
        trial = study.ask()
        u = box.lower.copy()
        for j in free:
            u[j] = trial.suggest_float(problem.names[j], float(box.lower[j]), float(box.upper[j]))
        theta = np.clip(box.theta(u), problem.lower, problem.upper)
        distance = score(theta)
        study.tell(trial, distance)
        if distance < reached:
            best, reached = theta, distance
    return best


def _measured(problem: TuningProblem, objective: SmoothedObjective, seed: int) -> Coordinates:
    """Coordinates in which a parameter that moves no guard has its natural scale, too."""
    frame = coordinates(problem, objective)
    (start,) = islice(starts(problem, objective, frame, np.random.default_rng(seed), 1), 1)
    values = dict(zip(problem.names, start.tolist(), strict=True))
    effects = natural_scales(problem.template, values, problem.histories)
    scale = np.where(frame.guarding, frame.scale, effects)
    return replace(frame, scale=np.maximum(scale, 1e-6))


def _box(
    problem: TuningProblem, objective: SmoothedObjective, frame: Coordinates, first: list[Vector]
) -> Box:
    """`WIDTH` natural scales around 0 (the bound next to it), with every start and every guard
    through the histories.

    Parameters range over [-100, 100] unless the sketch says otherwise, but what differs is their
    scale: the bounds alone would leave nearly all of the box to programs that always do the same.
    """
    scale = frame.scale
    centre = np.clip(0.0, problem.lower, problem.upper) / scale
    lower, upper = centre - WIDTH, centre + WIDTH
    zero = np.zeros(len(scale))
    base = objective.margins(zero)
    for guard, j in frame.offsets.items():
        unit = zero.copy()
        unit[j] = 1.0
        slope = float((objective.margins(unit)[guard] - base[guard]).mean())
        through = -base[guard] / slope / scale[j]
        through = through[np.isfinite(through)]
        if through.size:
            lower[j], upper[j] = min(lower[j], through.min()), max(upper[j], through.max())
    known = np.stack(first) / scale
    lower = np.minimum(lower, known.min(axis=0))
    upper = np.maximum(upper, known.max(axis=0))
    lower = np.maximum(lower, problem.lower / scale)
    upper = np.minimum(upper, problem.upper / scale)
    return Box(scale, np.arcsinh(lower), np.arcsinh(np.maximum(lower, upper)))


@contextmanager
def _quiet() -> Iterator[None]:
    """Without optuna's log, and without its warnings about what it does by itself."""
    import optuna

    before = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        optuna.logging.set_verbosity(before)
