"""The MaxSMT optimiser: one soft constraint a history, solved by z3 (paper, appendix B).

For each history the output of the template, as a formula over its parameters, must be the oracle's
action. The oracle is no program of the sketch, so that not all of that can be had: z3's optimiser
looks for parameters with the most weight of histories that are satisfied.

z3 sees some dozens of histories at a time, each with the weight of those that it stands for. The
first question is about all parameters at once. The answer is scored on all histories, and the next
questions are about parameters near the best ones and about the histories that are not settled
there, gathered around those whose answer is wrong.
"""

from pirlc.tune.maxsmt.limits import unsuitable
from pirlc.tune.maxsmt.search import tune

__all__ = ["tune", "unsuitable"]
