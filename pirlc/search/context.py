"""What every part of a search works on, and how programs are simulated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from pirlc.backend.policies import python_controller
from pirlc.ir.policy import Environment, ProgramTemplate, Sketch
from pirlc.ir.printer import program_text
from pirlc.search.candidate import Candidate
from pirlc.search.enumeration import Enumeration
from pirlc.search.journal import Journal
from pirlc.search.settings import Progress, Settings, Tell
from pirlc.simulation.policy import PolicyFactory
from pirlc.simulation.workers import collect_returns, collect_returns_of_each

FIRST_EVALUATION_SEED = 1_000_000
"""Episodes of a search start from seeds below this one; those of evaluations from here on."""

Record = list[tuple[str, Candidate]]
"""The programs that a search met, each with the stage it was met in, in order."""


@dataclass
class Search:
    """One search: its problem, its settings, its journal, and the programs it has met.

    `tell` is told of progress, `record` of each program with its stage, as it is met.
    """

    sketch: Sketch
    environment: Environment
    settings: Settings
    journal: Journal
    workers: int
    tell: Tell
    record: Callable[[str, Candidate], None]
    trust: bool = False
    met: Record = field(default_factory=list)

    @cached_property
    def enumeration(self) -> Enumeration:
        return Enumeration(self.sketch)

    def seeds(self, purpose: str, count: int) -> list[int]:
        """Seeds of episodes for a purpose; the same for all programs that are compared."""
        rng = np.random.default_rng([self.settings.seed, *purpose.encode()])
        return [int(s) for s in rng.integers(0, FIRST_EVALUATION_SEED, count)]

    def simulate(
        self, candidates: Sequence[Candidate], purpose: str, episodes: int
    ) -> list[Candidate]:
        """The candidates with the returns of one episode from each of the purpose's seeds."""
        seeds = self.seeds(purpose, episodes)
        simulated = []
        for done, candidate in enumerate(candidates):
            self.progress(f"simulate ({purpose})", done, len(candidates))
            template = candidate.expansion.template
            row = self.returns(template, [dict(candidate.values)], seeds)[0]
            simulated.append(candidate.with_returns(row))
        return simulated

    def returns(
        self, template: ProgramTemplate, values: Sequence[dict[str, float]], seeds: Sequence[int]
    ) -> NDArray[np.float64]:
        """Returns, shape (values, seeds), of a template closed with each set of values."""
        where = f"{self.environment.id} {self.environment.arguments} {list(seeds)}"
        text = program_text(template)
        keys = [f"{where} {sorted(v.items())!r} {text}" for v in values]

        def run(missing: Sequence[dict[str, float]]) -> list[list[float]]:
            printed = python_controller(template)
            rows = collect_returns_of_each(
                [partial(printed.with_params, v) for v in missing],
                self.environment,
                seeds,
                self.workers,
                self.trust,
            )
            return [[float(r) for r in row] for row in rows]

        rows = self.journal.each("returns", values, keys, run)
        return np.array(rows, dtype=np.float64).reshape(len(values), len(seeds))

    def evaluate(
        self, name: str, policy: PolicyFactory, text: str, seeds: Sequence[int]
    ) -> NDArray[np.float64]:
        """Returns, shape (seeds,), of any policy; `name` and `text` tell which in the journal."""
        key = f"{self.environment.id} {self.environment.arguments} {list(seeds)} {name} {text}"

        def run(wanted: Sequence[PolicyFactory]) -> list[list[float]]:
            return [
                [
                    float(r)
                    for r in collect_returns(p, self.environment, seeds, self.workers, self.trust)
                ]
                for p in wanted
            ]

        (row,) = self.journal.each("evaluate", [policy], [key], run)
        return np.array(row, dtype=np.float64)

    def keep(self, stage: str, candidate: Candidate) -> None:
        """Adds a program to those met."""
        self.met.append((stage, candidate))
        self.record(stage, candidate)

    def progress(self, stage: str, done: int, total: int) -> None:
        # Means over different episodes do not compare: those over the most are the latest.
        met = (candidate for _, candidate in self.met)
        best = max(met, key=lambda c: (len(c.returns or ()), c.mean), default=None)
        self.tell(Progress(stage, done, total, best))
