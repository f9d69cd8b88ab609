"""The problem that every optimiser solves: the parameters closest to the oracle's actions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pirlc.ir.policy import ProgramTemplate
from pirlc.semantics.histories import HistorySet
from pirlc.semantics.vectorised import Plan, apply_actions, compile_plan, distance


@dataclass(frozen=True, eq=False)
class TuningProblem:
    """A template, N histories, and the oracle's actions on them.

    `labels` (N, k) are in declaration order. `start` gives values for some of the parameters, where
    a good program is known to be near.
    """

    template: ProgramTemplate
    histories: HistorySet
    labels: NDArray[np.float64]
    start: Mapping[str, float] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """The free parameters, in the order of every vector theta."""
        return tuple(p.name for p in self.template.free)

    @property
    def lower(self) -> NDArray[np.float64]:
        return np.array([p.lower for p in self.template.free])

    @property
    def upper(self) -> NDArray[np.float64]:
        return np.array([p.upper for p in self.template.free])


@dataclass(frozen=True)
class Tuned:
    """Values for the free parameters, and the distance of the program that they make.

    `note` says what should be known of how they were found; mostly nothing.
    """

    values: dict[str, float]
    distance: float
    note: str = ""


class Score:
    """The distance of the program itself, its guards hard: what every optimiser reports."""

    def __init__(self, problem: TuningProblem) -> None:
        self._problem = problem
        histories = problem.histories
        self._plan: Plan = compile_plan(problem.template, histories.precision, histories.layout)

    def __call__(self, theta: NDArray[np.float64]) -> float:
        """The mean distance over the histories at parameters theta (P,)."""
        problem = self._problem
        values = dict(zip(problem.names, theta.tolist(), strict=True))
        raw = self._plan.run(values, problem.histories)
        applied = apply_actions(raw, problem.histories).actions
        return distance(applied, problem.labels, problem.template.interface.actions)

    def tuned(self, theta: NDArray[np.float64]) -> Tuned:
        values = dict(zip(self._problem.names, theta.tolist(), strict=True))
        return Tuned(values, self(theta))
