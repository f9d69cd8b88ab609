"""What every part of a search works on, and how programs are simulated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pirlc.backend.policies import (
    CControllerFactory,
    PythonController,
    c_controller,
    python_controller,
)
from pirlc.backend.toolchain import QUICK_FLAGS, find_compiler
from pirlc.diagnostics import Diagnostic
from pirlc.ir.expansion import Expansion
from pirlc.ir.policy import Environment, ProgramTemplate, Sketch
from pirlc.ir.printer import program_text
from pirlc.search.candidate import Candidate
from pirlc.search.enumeration import Enumeration
from pirlc.search.journal import Journal
from pirlc.search.settings import Choice, Progress, Settings, Tell
from pirlc.simulation.policy import PolicyFactory
from pirlc.simulation.workers import (
    Workers,
    collect_returns,
    collect_returns_of_each,
    parallel_map,
)

FIRST_EVALUATION_SEED = 1_000_000
"""Episodes of a search start from seeds below this one; those of evaluations from here on."""

_BATCH = 8
"""Programs simulated between two looks at the budget; not a matter of how many processes there
are, so that a budget ends at the same place for any number."""

Record = list[tuple[str, Candidate]]
"""The programs that a search met, each with the stage it was met in, in order."""


@dataclass
class Search:
    """One search: its problem, its settings, its journal, and the programs it has met.

    `tell` is told of progress, `record` of each program with its stage, as it is met. `libraries`
    is a folder for compiled programs, where the environment runs those by itself (None: programs
    are simulated as emitted Python). In a `deterministic` environment one episode tells all.
    `tell_choice` is told of the `choice` of the optimiser, `warn` of what is left out. `pool` are
    the templates of `initialize`, once they are known.
    """

    sketch: Sketch
    environment: Environment
    settings: Settings
    journal: Journal
    workers: Workers
    tell: Tell
    record: Callable[[str, Candidate], None]
    trust: bool = False
    libraries: Path | None = None
    deterministic: bool = False
    tell_choice: Callable[[Choice], None] = lambda _: None
    warn: Callable[[Diagnostic], None] = lambda _: None
    choice: Choice | None = None
    pool: list[Expansion] = field(default_factory=list)
    told_left_out: bool = False
    told_unanswered: bool = False
    met: Record = field(default_factory=list)
    _made: dict[str, PythonController | CControllerFactory] = field(default_factory=dict)
    _texts: dict[int, tuple[ProgramTemplate, str]] = field(default_factory=dict)

    @cached_property
    def enumeration(self) -> Enumeration:
        return Enumeration(self.sketch)

    def seeds(self, purpose: str, count: int) -> list[int]:
        """Seeds of episodes for a purpose; the same for all programs that are compared.

        One that is always the same in a deterministic environment.
        """
        if self.deterministic:
            return [0]
        rng = np.random.default_rng([self.settings.seed, *purpose.encode()])
        return [int(s) for s in rng.integers(0, FIRST_EVALUATION_SEED, count)]

    def episodes(self, count: int) -> int:
        """How many episodes are run where `count` are asked for."""
        return 1 if self.deterministic else count

    def simulate(
        self, candidates: Sequence[Candidate], purpose: str, episodes: int
    ) -> list[Candidate]:
        """The candidates with the returns of one episode from each of the purpose's seeds."""
        seeds = self.seeds(purpose, episodes)
        simulated: list[Candidate] = []
        for done in range(0, len(candidates), _BATCH):
            self.progress(f"simulate ({purpose})", done, len(candidates))
            batch = candidates[done : done + _BATCH]
            rows = self._returns([(c.expansion.template, dict(c.values)) for c in batch], seeds)
            simulated += [c.with_returns(row) for c, row in zip(batch, rows, strict=True)]
        return simulated

    def returns(
        self, template: ProgramTemplate, values: Sequence[dict[str, float]], seeds: Sequence[int]
    ) -> NDArray[np.float64]:
        """Returns, shape (values, seeds), of a template closed with each set of values."""
        return self._returns([(template, v) for v in values], seeds)

    def _returns(
        self, programs: Sequence[tuple[ProgramTemplate, dict[str, float]]], seeds: Sequence[int]
    ) -> NDArray[np.float64]:
        where = f"{self.environment.id} {self.environment.arguments} {list(seeds)}"
        keys = [f"{where} {sorted(v.items())!r} {self._text(t)}" for t, v in programs]

        def run(missing: Sequence[tuple[ProgramTemplate, dict[str, float]]]) -> list[list[float]]:
            self._prepare([template for template, _ in missing])
            rows = collect_returns_of_each(
                [self.policy(template, values) for template, values in missing],
                self.environment,
                seeds,
                self.workers,
                self.trust,
            )
            return [[float(r) for r in row] for row in rows]

        rows = self.journal.each("returns", programs, keys, run)
        return np.array(rows, dtype=np.float64).reshape(len(programs), len(seeds))

    def policy(self, template: ProgramTemplate, values: dict[str, float]) -> PolicyFactory:
        """The template closed with values, as what runs fastest in this environment."""
        self._prepare([template])
        return partial(self._made[self._text(template)].with_params, values)

    def _prepare(self, templates: Sequence[ProgramTemplate]) -> None:
        """Prints or compiles those templates that were not yet."""
        new = {self._text(t): t for t in templates if self._text(t) not in self._made}
        folder = self.libraries
        if folder is None:
            self._made.update({text: python_controller(t) for text, t in new.items()})
            return
        find_compiler()

        def compiled(template: ProgramTemplate) -> CControllerFactory:
            return c_controller(template, folder, flags=QUICK_FLAGS)

        made = parallel_map(compiled, list(new.values()), self.workers.here())
        self._made.update(zip(new, made, strict=True))

    def _text(self, template: ProgramTemplate) -> str:
        # By identity: templates are immutable, and candidates of one structure share theirs.
        if id(template) not in self._texts:
            self._texts[id(template)] = (template, program_text(template))
        return self._texts[id(template)][1]

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
