"""Which optimiser looks for parameters, and how long it may look."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Optimizer(StrEnum):
    """The optimisers that a template's parameters can be found with.

    casadi: gradients of the smoothed program, linear parameters solved for (`tune.smoothed`).
    bayes: Bayesian optimisation with a Gaussian process (paper, appendix B).
    smt: MaxSMT with one soft constraint a history (paper, appendix B).
    """

    CASADI = "casadi"
    BAYES = "bayes"
    SMT = "smt"


@dataclass(frozen=True)
class Tuning:
    """How the parameters of one template are looked for. Budgets are counts.

    Attributes:
        optimizer: who looks.
        trials: programs that `bayes` tries for a template.
        seconds: `bayes` and `smt` stop after this long at a template; None: by counts alone. What
            time stopped does not repeat.
        tolerance: `smt` is content with a continuous action this close, as a part of its range.
        effort: what z3 may spend on a template, in its own units of work: a million takes a second
            or so.
    """

    optimizer: Optimizer = Optimizer.CASADI
    trials: int = 200
    seconds: float | None = None
    tolerance: float = 0.05
    effort: int = 1_000_000
