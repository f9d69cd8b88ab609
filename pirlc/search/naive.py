"""The objective without an oracle: return alone (the paper's agent Naive)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from cmaes import CMA
from numpy.typing import NDArray

from pirlc.ir.policy import Choice, Interface
from pirlc.search.candidate import Candidate
from pirlc.search.context import Search
from pirlc.search.neighbourhood import Neighbour
from pirlc.semantics.histories import HistorySet, histories_of
from pirlc.simulation.workers import collect_episodes
from pirlc.tune import natural_scales, random_starts

STARTS = 8
GENERATIONS = 6
EPISODES = 6
"""Few: a template that is worth it is refined later."""


@dataclass(frozen=True, eq=False)
class ReturnAlone:
    """`histories` only tell where guards may lie; a candidate's loss is minus its mean return."""

    histories: HistorySet

    def tune(self, search: Search, templates: Sequence[Neighbour], stage: str) -> list[Candidate]:
        """For each template a short run of CMA-ES on return, from the best of random starts."""
        candidates = []
        for number, neighbour in enumerate(templates):
            search.progress(f"tune on return ({stage})", number, len(templates))
            candidates.append(self._climb(search, neighbour))
            search.keep(f"tune ({stage})", candidates[-1])
        return candidates

    def update_histories(self, search: Search, program: Candidate, turn: int) -> ReturnAlone:
        """There is nobody to ask what to do in new histories."""
        del search, program, turn
        return self

    def _climb(self, search: Search, neighbour: Neighbour) -> Candidate:
        template = neighbour.expansion.template
        names = [p.name for p in template.free]
        # Where an episode is costly, a climb is content with fewer.
        episodes = min(EPISODES, search.settings.climb_episodes)
        seeds = search.seeds("tune on return", episodes)
        if not names:
            loss = -float(search.returns(template, [{}], seeds).mean())
            return Candidate(neighbour.expansion, (), loss)
        seed = search.settings.seed
        starts = random_starts(template, self.histories, dict(neighbour.values), STARTS, seed)
        means = search.returns(template, starts, seeds).mean(axis=1)
        best, reached = starts[int(np.argmax(means))], float(means.max())
        # CMA-ES wants at least two dimensions; a single parameter gets an idle companion.
        idle = np.ones(1 if len(names) == 1 else 0)
        scales = np.append(natural_scales(template, best, self.histories), idle)
        optimizer = CMA(
            mean=np.append([best[n] for n in names], 0 * idle) / scales, sigma=0.5, seed=seed
        )
        for _ in range(GENERATIONS):
            asked = [optimizer.ask() for _ in range(optimizer.population_size)]
            tried = [
                {
                    p.name: float(min(max(v, p.lower), p.upper))
                    for p, v in zip(template.free, x * scales, strict=False)
                }
                for x in asked
            ]
            means = search.returns(template, tried, seeds).mean(axis=1)
            optimizer.tell([(x, -float(mean)) for x, mean in zip(asked, means, strict=True)])
            if means.max() > reached:
                best, reached = tried[int(np.argmax(means))], float(means.max())
        return Candidate(neighbour.expansion, tuple(sorted(best.items())), -reached)


def explore(search: Search) -> ReturnAlone:
    """What there is to see, found by acting at random."""
    seeds = search.seeds("explore", search.settings.create_episodes)
    interface = search.sketch.interface
    episodes = collect_episodes(
        RandomActions(interface, search.settings.seed),
        search.environment,
        seeds,
        search.workers,
        search.trust,
    )
    components = [spec.component for spec in interface.actions]
    histories = histories_of(
        interface, [(e.observations, e.actions[:, components]) for e in episodes]
    )
    return ReturnAlone(histories.sample(search.settings.histories, search.settings.seed))


@dataclass(frozen=True)
class RandomActions:
    """Makes policies whose actions are uniform in their ranges, the same in every episode."""

    interface: Interface
    seed: int

    def __call__(self) -> RandomPolicy:
        return RandomPolicy(self.interface, self.seed)


class RandomPolicy:
    """Every action uniform in its range, whatever the observation."""

    def __init__(self, interface: Interface, seed: int) -> None:
        self._specs = sorted(interface.actions, key=lambda spec: spec.component)
        self._seed = seed
        self.reset()

    def reset(self) -> None:
        self._rng = np.random.default_rng(self._seed)

    def act(self, observation: NDArray[np.float64]) -> tuple[float, ...]:
        """One number a component, drawn afresh."""
        del observation
        return tuple(
            float(self._rng.choice(spec.domain.values))
            if isinstance(spec.domain, Choice)
            else float(self._rng.uniform(spec.domain.lower, spec.domain.upper))
            for spec in self._specs
        )
