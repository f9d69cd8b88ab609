"""The optimisers, by name."""

from __future__ import annotations

from typing import assert_never

from pirlc.tune import bayes, smoothed
from pirlc.tune.how import Optimizer, Tuning
from pirlc.tune.problem import Tuned, TuningProblem
from pirlc.tune.separate import joined, separate

DEFAULT = Tuning()


def budgets(how: Tuning) -> str:
    """Everything of `how` that the result of its optimiser depends on, as text."""
    match how.optimizer:
        case Optimizer.CASADI:
            return "casadi"
        case Optimizer.BAYES:
            return f"bayes {how.trials} {how.seconds}"
        case Optimizer.SMT:
            return f"smt {how.effort} {how.seconds} {how.tolerance!r}"
        case _:
            assert_never(how.optimizer)


def tune_apart(problem: TuningProblem, seed: int, how: Tuning = DEFAULT) -> Tuned:
    """Like `tune`, with the actions that share no parameter one after the other."""
    parts = separate(problem)
    if parts == (problem,):
        return tune(problem, seed, how)
    return joined(problem, [tune(part, seed, how).values for part in parts])


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
