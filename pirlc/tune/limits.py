"""What each optimiser cannot take, told before it starts."""

from __future__ import annotations

from typing import assert_never

from pirlc.ir.policy import ProgramTemplate
from pirlc.tune.how import Optimizer

MOST_BAYES = 30
"""Parameters of a template. A Gaussian process with a length scale for each of more parameters
learns nothing from a few hundred trials: the box has more corners than there are trials."""


def unsuitable(template: ProgramTemplate, optimizer: Optimizer) -> str | None:
    """Why the optimiser cannot take the template, as a clause; None if it can.

    A template without free parameters suits every one: it is only scored.
    """
    count = len(template.free)
    if not count:
        return None
    match optimizer:
        case Optimizer.CASADI:
            return None
        case Optimizer.BAYES:
            if count > MOST_BAYES:
                return f"it has {count} parameters, and `bayes` takes {MOST_BAYES} at most"
            return None
        case Optimizer.SMT:
            from pirlc.tune import maxsmt

            return maxsmt.unsuitable(template)
        case _:
            assert_never(optimizer)
