"""The optimisers, by name."""

from __future__ import annotations

from typing import assert_never

from pirlc.tune import bayes, smoothed
from pirlc.tune.how import Optimizer, Tuning
from pirlc.tune.problem import Tuned, TuningProblem

DEFAULT = Tuning()


def tune(problem: TuningProblem, seed: int, how: Tuning = DEFAULT) -> Tuned:
    """Parameters that bring the template close to the oracle, by the optimiser that `how` names.

    The template must be one that it can take (`pirlc.tune.limits.unsuitable`). The same problem,
    seed and budgets give the same parameters, unless time stopped it (`how.seconds`).
    """
    match how.optimizer:
        case Optimizer.CASADI:
            return smoothed.tune(problem, seed)
        case Optimizer.BAYES:
            return bayes.tune(problem, seed, how)
        case Optimizer.SMT:
            from pirlc.tune import maxsmt

            return maxsmt.tune(problem, seed, how)
        case _:
            assert_never(how.optimizer)
