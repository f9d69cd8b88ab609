"""Finds values for the parameters of a program template: one problem, several optimisers."""

from pirlc.tune.how import Optimizer, Tuning
from pirlc.tune.limits import unsuitable
from pirlc.tune.optimizers import budgets, tune, tune_apart
from pirlc.tune.problem import Tuned, TuningProblem
from pirlc.tune.scales import natural_scales
from pirlc.tune.separate import joined, separate
from pirlc.tune.starts import random_starts

__all__ = [
    "Optimizer",
    "Tuned",
    "Tuning",
    "TuningProblem",
    "budgets",
    "joined",
    "natural_scales",
    "random_starts",
    "separate",
    "tune",
    "tune_apart",
    "unsuitable",
]
