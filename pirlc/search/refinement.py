"""Parameters refined on simulated return with CMA-ES. Not part of the paper's algorithm.

Imitation cannot be better than what it imitates, and its distance is not the return. So the best
structures that Algorithm 1 met are taken further, by return alone: all of them for a while, then
the better half for twice as long each, and so on (successive halving). Every generation has
episodes of its own, so that no set of starts is learnt by heart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from cmaes import CMA
from numpy.typing import NDArray

from pirlc.search.candidate import Candidate, choose
from pirlc.search.canonical import canonical_form
from pirlc.search.context import Search
from pirlc.semantics.histories import HistorySet
from pirlc.tune import natural_scales

_HEATS = ((32, 0.4), (10, 1.6), (4, 10.0))
"""How many of the best programs sampled go on at the end, and to how many episodes, in units of
`Settings.episodes`."""

_PLATEAU = 2
"""Generations without any difference in return after which programs get twice as many episodes:
what is left to improve is rare."""

_MOST_EPISODES = 80
"""Of each program of a generation. No difference over so many: there is nothing left to climb."""


def refine(search: Search, histories: HistorySet, programs: Sequence[Candidate]) -> Candidate:
    """The best program that is reached from the given ones (see `promising`).

    `histories` tell how large a step in each parameter is. The programs themselves take part in
    the last comparison, so that refinement makes nothing worse.
    """
    climbs = [_Climb(search, p, histories) for p in programs if p.values]
    rounds = 1 + max(0, len(climbs) - 1).bit_length()
    running = list(climbs)
    for turn in range(rounds):
        if not running:
            break
        share = search.settings.refine_episodes // rounds // len(running)
        for number, climb in enumerate(running):
            search.progress(f"refine (round {turn + 1} of {rounds})", number, len(running))
            climb.advance(search, share)
        centres = [climb.centre for climb in running]
        reached = search.simulate(centres, f"refine {turn}", 2 * search.settings.episodes)
        for climb, candidate in zip(running, reached, strict=True):
            search.keep("refine", candidate)
            climb.score = candidate.mean
        # One that has nothing left to climb needs no more episodes, and takes no other's place.
        going = sorted((c for c in running if not c.finished), key=lambda climb: -climb.score)
        running = going[: (len(running) + 1) // 2]
    samples = sorted((s for c in climbs for s in c.samples), key=lambda s: -s.mean)
    finalists = [*(c.centre for c in climbs if c.generation), *samples]
    for number, (kept, relative) in enumerate(_HEATS, start=1):
        heat = _heat(search, number, relative, _admitted(finalists, kept))
        finalists = sorted(heat, key=lambda candidate: -candidate.mean)
    finalists += _heat(search, len(_HEATS), _HEATS[-1][1], programs)
    for candidate in finalists:
        search.keep("validate", candidate)
    return choose(finalists)


def _heat(
    search: Search, number: int, relative: float, programs: Sequence[Candidate]
) -> list[Candidate]:
    episodes = max(1, round(relative * search.settings.episodes))
    return search.simulate(programs, f"heat {number}", episodes)


def promising(search: Search) -> list[Candidate]:
    """Programs met that are worth refining, one for each structure, the best by return first.

    Those that earn more than every shorter one come before all others: a short program often
    lacks nothing but better parameters. But a program at its guesses that is the best is first
    joined by the largest that earns the same: its further terms do nothing as long as their
    guesses are 0, and have most to gain.
    """
    best: dict[str, Candidate] = {}
    for _, candidate in search.met:
        if candidate.returns is not None:
            form = canonical_form(candidate.expansion.template)
            if form not in best or candidate.mean > best[form].mean:
                best[form] = candidate
    front: list[Candidate] = []
    for candidate in sorted(best.values(), key=lambda c: (c.size, -c.mean)):
        if not front or candidate.mean > front[-1].mean:
            front.append(candidate)
    ranked = sorted(best.values(), key=lambda c: (-c.mean, c.size))
    first = front[-1:]
    first += [c for c in ranked if first and _idle(c, first[0])][-1:]
    others = [c for c in [*reversed(front), *ranked] if c not in first]
    chosen = list(dict.fromkeys([*first, *others]))[: search.settings.refined]
    return sorted(chosen, key=lambda c: (-c.mean, c.size))


def _idle(program: Candidate, other: Candidate) -> bool:
    """Whether a larger program, at its guesses, earns just what the other one does."""
    guessed = math.isinf(program.loss) and math.isinf(other.loss)
    return guessed and program.size > other.size and program.mean == other.mean


def _admitted(ranked: Sequence[Candidate], count: int) -> list[Candidate]:
    """The first of some programs, and the first of each structure, since shorter ones win ties."""
    first = {id(c.expansion): c for c in reversed(ranked)}
    chosen = [*ranked[:count], *first.values()]
    return list({id(c): c for c in chosen}.values())


class _Climb:
    """A run of CMA-ES on one structure, that can be taken up again."""

    def __init__(self, search: Search, start: Candidate, histories: HistorySet) -> None:
        template = start.expansion.template
        values = dict(start.values)
        self.start = start
        self.generation = 0
        self.score = start.mean
        self.samples: list[Candidate] = []
        self._episodes = search.episodes(search.settings.climb_episodes)
        self._flat = 0
        self._names = [p.name for p in template.free]
        # CMA-ES wants at least two dimensions; a single parameter gets an idle companion.
        idle = np.ones(1 if len(self._names) == 1 else 0)
        self._scales = np.append(natural_scales(template, values, histories), idle)
        theta = np.append([values[n] for n in self._names], 0 * idle)
        lower = np.append([p.lower for p in template.free], -idle)
        upper = np.append([p.upper for p in template.free], idle)
        self._lower, self._upper = lower, np.maximum(upper, np.nextafter(lower, np.inf))
        self._optimizer = CMA(
            mean=theta / self._scales,
            sigma=search.settings.climb_step,
            bounds=np.column_stack([self._lower, self._upper]) / self._scales[:, None],
            seed=search.settings.seed,
            population_size=2 * (3 + int(1.5 * np.log(len(theta)) + 1)),
        )

    @property
    def centre(self) -> Candidate:
        """The program at the centre of the search distribution."""
        return self._candidate(np.asarray(self._optimizer.mean))

    @property
    def finished(self) -> bool:
        return self._episodes > _MOST_EPISODES or bool(self._optimizer.should_stop())

    def advance(self, search: Search, episodes: int) -> None:
        """Goes on for as many generations as fit into this many episodes, at least one."""
        size = self._optimizer.population_size
        while not self.finished:
            asked = [self._optimizer.ask() for _ in range(size)]
            seeds = search.seeds(f"generation {self.generation}", self._episodes)
            returns = search.returns(
                self.start.expansion.template, [self._values(x) for x in asked], seeds
            )
            losses = -returns.mean(axis=1)
            self._optimizer.tell([(x, float(v)) for x, v in zip(asked, losses, strict=True)])
            self.generation += 1
            best = int(np.argmin(losses))
            self.samples.append(self._candidate(asked[best]).with_returns(returns[best]))
            episodes -= returns.size
            self._flat = self._flat + 1 if np.ptp(losses) == 0.0 else 0
            if self._flat == _PLATEAU:
                # More of the same episode would show no more.
                more = _MOST_EPISODES + 1 if search.deterministic else 2 * self._episodes
                self._episodes, self._flat = more, 0
            if episodes < size * self._episodes:
                return

    def _candidate(self, x: NDArray[np.float64]) -> Candidate:
        values = tuple(sorted(self._values(x).items()))
        return Candidate(self.start.expansion, values, self.start.loss)

    def _values(self, x: NDArray[np.float64]) -> dict[str, float]:
        theta = np.clip(x * self._scales, self._lower, self._upper)
        return dict(zip(self._names, theta.tolist(), strict=False))
