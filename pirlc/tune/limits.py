"""What each optimiser cannot take, told before it starts."""

from __future__ import annotations

from typing import assert_never

from pirlc.ir.policy import ProgramTemplate
from pirlc.tune.how import Optimizer
from pirlc.tune.separate import separate_templates

MOST_BAYES = 30
"""Parameters that are tuned together. A Gaussian process with a length scale for each of more
learns nothing from a few hundred trials: its box has more sides than there are trials to a side."""


def unsuitable(template: ProgramTemplate, optimizer: Optimizer) -> str | None:
    """Why the optimiser cannot take the template, as words that fit others like it, too; None if
    it can.

    A template without free parameters suits every one: it is only scored. Actions that share no
    parameter are tuned apart (`tune.separate`), so each part must suit.
    """
    if not template.free:
        return None
    reasons = (_of_part(part, optimizer) for part in separate_templates(template))
    return next((reason for reason in reasons if reason is not None), None)


def _of_part(part: ProgramTemplate, optimizer: Optimizer) -> str | None:
    match optimizer:
        case Optimizer.CASADI:
            return None
        case Optimizer.BAYES:
            return f"more than {MOST_BAYES} parameters" if len(part.free) > MOST_BAYES else None
        case Optimizer.SMT:
            from pirlc.tune import maxsmt

            return maxsmt.unsuitable(part)
        case _:
            assert_never(optimizer)
