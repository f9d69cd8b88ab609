"""What a step costs, for the headers of emitted code."""

from __future__ import annotations

from pirlc.ir.controller import Controller, worst_path
from pirlc.ir.policy import Continuous


def program_operations(controller: Controller) -> int:
    """Operators, comparisons and tests that the program's own text costs on its worst path."""
    return worst_path(controller.statements)


def checking_operations(controller: Controller) -> int:
    """Comparisons (and a subtraction) that judge readings, and those that clip actions."""
    continuous = sum(isinstance(o.domain, Continuous) for o in controller.outputs)
    return 4 * len(controller.channels) + 2 * continuous
