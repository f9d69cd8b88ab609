"""Finds values for the parameters of a program template: one problem, several optimisers."""

from pirlc.tune.problem import Tuned, TuningProblem
from pirlc.tune.scales import natural_scales
from pirlc.tune.separate import joined, separate
from pirlc.tune.smoothed import tune
from pirlc.tune.starts import random_starts

__all__ = [
    "Tuned",
    "TuningProblem",
    "joined",
    "natural_scales",
    "random_starts",
    "separate",
    "tune",
]
