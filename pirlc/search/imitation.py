"""The objective of Algorithm 1: distance to the oracle over a set of interesting histories."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirlc.ir.printer import program_text
from pirlc.oracle.network import Oracle
from pirlc.search.candidate import Candidate
from pirlc.search.context import Search
from pirlc.search.neighbourhood import Neighbour
from pirlc.search.problems import LeftOut, Unanswered, describe
from pirlc.semantics.histories import HistorySet, histories_of, join
from pirlc.simulation.policy import Ready
from pirlc.simulation.rollout import Episode
from pirlc.simulation.workers import collect_episodes, parallel_map
from pirlc.tune import Tuning, TuningProblem, budgets, joined, separate, tune, unsuitable

_BATCH = 8
"""Templates tuned between two looks at the budget; not a matter of how many processes there are,
so that a budget ends at the same place for any number."""


@dataclass(frozen=True, eq=False)
class Imitation:
    """Histories with the oracle's action for each, `labels` (N, k) in declaration order; `how`
    templates are tuned to it."""

    oracle: Oracle
    histories: HistorySet
    labels: NDArray[np.float64]
    how: Tuning

    @cached_property
    def digest(self) -> str:
        """Tells sets of histories apart."""
        found = sha256(self.labels.tobytes())
        for columns in (self.histories.sensors, self.histories.previous):
            for name in sorted(columns):
                found.update(np.ascontiguousarray(columns[name]).tobytes())
        return found.hexdigest()

    def problems(self, search: Search, templates: Sequence[Neighbour]) -> list[TuningProblem]:
        """What tuning the templates means: on a random sample of histories, the same for all."""
        settings = search.settings
        rng = np.random.default_rng([settings.seed, len(self.labels)])
        count = min(settings.histories, len(self.labels))
        sample = np.sort(rng.choice(len(self.labels), count, replace=False))
        histories, labels = self.histories.select(sample), self.labels[sample]
        return [
            TuningProblem(n.expansion.template, histories, labels, dict(n.values))
            for n in templates
        ]

    def key(self, search: Search, problem: TuningProblem, how: Tuning) -> str:
        """Tells everything that the result of tuning depends on."""
        count, seed = len(problem.histories), search.settings.seed
        start, text = dict(problem.start), program_text(problem.template)
        return f"{self.digest} {count} {seed} {budgets(how)} {start} {text}"

    def tune(self, search: Search, templates: Sequence[Neighbour], stage: str) -> list[Candidate]:
        """Parameters that bring each template close to the oracle.

        Templates that the optimiser cannot take are left out.
        """
        how, seed = self.how, search.settings.seed
        templates = _suited(search, templates, how)
        problems = self.problems(search, templates)
        parts = [separate(problem) for problem in problems]

        def run(missing: Sequence[TuningProblem]) -> list[dict[str, Any]]:
            found = parallel_map(lambda p: tune(p, seed, how), missing, search.workers)
            return [{"distance": t.distance, "values": t.values, "note": t.note} for t in found]

        candidates, notes = [], []
        for done in range(0, len(problems), _BATCH):
            search.progress(f"tune ({stage})", done, len(problems))
            batch = range(done, min(done + _BATCH, len(problems)))
            asked = [part for i in batch for part in parts[i]]
            keys = [self.key(search, part, how) for part in asked]
            answers = iter(search.journal.each("tune", asked, keys, run))
            for i in batch:
                found = [next(answers) for _ in parts[i]]
                notes += [part["note"] for part in found if part["note"]]
                if parts[i] == (problems[i],):
                    values, distance = found[0]["values"], found[0]["distance"]
                else:
                    whole = joined(problems[i], [part["values"] for part in found])
                    values, distance = whole.values, whole.distance
                candidates.append(
                    Candidate(templates[i].expansion, tuple(sorted(values.items())), distance)
                )
                search.keep(f"tune ({stage})", candidates[-1])
        if notes and not search.told_unanswered:
            search.told_unanswered = True
            search.warn(describe(Unanswered(how.optimizer, tuple(notes), stage)))
        return candidates

    def update_histories(self, search: Search, program: Candidate, turn: int) -> Imitation:
        """Adds what the program meets in some episodes, with what the oracle would do there."""
        seeds = search.seeds(f"update_histories {turn}", search.settings.update_episodes)
        factory = search.policy(program.expansion.template, dict(program.values))
        episodes = collect_episodes(
            factory, search.environment, seeds, search.workers, search.trust
        )
        new, labels = _labelled(search, self.oracle, episodes)
        histories = join([self.histories, new])
        return replace(self, histories=histories, labels=np.concatenate([self.labels, labels]))


def _suited(search: Search, templates: Sequence[Neighbour], how: Tuning) -> Sequence[Neighbour]:
    """Those that the optimiser can take; the first time that some are left out, it is told."""
    why = [unsuitable(n.expansion.template, how.optimizer) for n in templates]
    reasons = tuple(reason for reason in why if reason is not None)
    if reasons and not search.told_left_out:
        search.told_left_out = True
        search.warn(describe(LeftOut(how.optimizer, reasons, len(templates))))
    return [n for n, reason in zip(templates, why, strict=True) if reason is None]


def create_histories(search: Search, oracle: Oracle) -> Imitation:
    """What the oracle meets and does in some episodes.

    Templates are tuned as `search.settings.tuning` says (see `search.choice.with_optimizer`).
    """
    search.progress("create_histories", 0, 1)
    seeds = search.seeds("create_histories", search.settings.create_episodes)
    episodes = collect_episodes(
        Ready(oracle), search.environment, seeds, search.workers, search.trust
    )
    return Imitation(oracle, *_labelled(search, oracle, episodes), search.settings.tuning)


def _labelled(
    search: Search, oracle: Oracle, episodes: Sequence[Episode]
) -> tuple[HistorySet, NDArray[np.float64]]:
    interface = search.sketch.interface
    components = [spec.component for spec in interface.actions]
    histories = histories_of(
        interface, [(e.observations, e.actions[:, components]) for e in episodes]
    )
    labels = np.concatenate([oracle.actions(e.observations) for e in episodes])
    return histories, np.ascontiguousarray(labels[:, components])
