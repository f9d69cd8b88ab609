"""The objective of Algorithm 1: distance to the oracle over a set of interesting histories."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from pirlc.ir.printer import program_text
from pirlc.oracle.network import Oracle
from pirlc.search.candidate import Candidate
from pirlc.search.context import Search
from pirlc.search.neighbourhood import Neighbour
from pirlc.semantics.histories import HistorySet, histories_of, join
from pirlc.simulation.policy import Ready
from pirlc.simulation.rollout import Episode
from pirlc.simulation.workers import collect_episodes, parallel_map
from pirlc.tune import TuningProblem, joined, separate, tune

_BATCH = 8
"""Templates tuned between two looks at the budget; not a matter of how many processes there are,
so that a budget ends at the same place for any number."""


@dataclass(frozen=True, eq=False)
class Imitation:
    """Histories with the oracle's action for each, `labels` (N, k) in declaration order."""

    oracle: Oracle
    histories: HistorySet
    labels: NDArray[np.float64]

    @cached_property
    def digest(self) -> str:
        """Tells sets of histories apart."""
        found = sha256(self.labels.tobytes())
        for columns in (self.histories.sensors, self.histories.previous):
            for name in sorted(columns):
                found.update(np.ascontiguousarray(columns[name]).tobytes())
        return found.hexdigest()

    def tune(self, search: Search, templates: Sequence[Neighbour], stage: str) -> list[Candidate]:
        """Parameters for each template that bring it close to the oracle.

        Looks at a random sample of the histories, the same for all templates.
        """
        settings = search.settings
        rng = np.random.default_rng([settings.seed, len(self.labels)])
        count = min(settings.histories, len(self.labels))
        sample = np.sort(rng.choice(len(self.labels), count, replace=False))
        histories, labels = self.histories.select(sample), self.labels[sample]
        problems = [
            TuningProblem(n.expansion.template, histories, labels, dict(n.values))
            for n in templates
        ]
        parts = [separate(problem) for problem in problems]

        def key(part: TuningProblem) -> str:
            start, text = dict(part.start), program_text(part.template)
            return f"{self.digest} {count} {settings.seed} {start} {text}"

        def run(missing: Sequence[TuningProblem]) -> list[dict[str, float | dict[str, float]]]:
            found = parallel_map(lambda p: tune(p, settings.seed), missing, search.workers)
            return [{"distance": t.distance, "values": t.values} for t in found]

        candidates = []
        for done in range(0, len(problems), _BATCH):
            search.progress(f"tune ({stage})", done, len(problems))
            batch = range(done, min(done + _BATCH, len(problems)))
            asked = [part for i in batch for part in parts[i]]
            answers = iter(search.journal.each("tune", asked, list(map(key, asked)), run))
            for i in batch:
                found = [next(answers) for _ in parts[i]]
                if parts[i] == (problems[i],):
                    values, distance = found[0]["values"], found[0]["distance"]
                else:
                    whole = joined(problems[i], [part["values"] for part in found])
                    values, distance = whole.values, whole.distance
                candidates.append(
                    Candidate(templates[i].expansion, tuple(sorted(values.items())), distance)
                )
                search.keep(f"tune ({stage})", candidates[-1])
        return candidates

    def update_histories(self, search: Search, program: Candidate, turn: int) -> Imitation:
        """Adds what the program meets in some episodes, with what the oracle would do there."""
        seeds = search.seeds(f"update_histories {turn}", search.settings.update_episodes)
        factory = search.policy(program.expansion.template, dict(program.values))
        episodes = collect_episodes(
            factory, search.environment, seeds, search.workers, search.trust
        )
        new, labels = _labelled(search, self.oracle, episodes)
        return Imitation(
            self.oracle, join([self.histories, new]), np.concatenate([self.labels, labels])
        )


def create_histories(search: Search, oracle: Oracle) -> Imitation:
    """What the oracle meets and does in some episodes."""
    search.progress("create_histories", 0, 1)
    seeds = search.seeds("create_histories", search.settings.create_episodes)
    episodes = collect_episodes(
        Ready(oracle), search.environment, seeds, search.workers, search.trust
    )
    return Imitation(oracle, *_labelled(search, oracle, episodes))


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
