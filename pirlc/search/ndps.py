"""Neurally directed program search: Algorithm 1 of the paper, and its subroutines by their names.

Verma et al., Programmatically Interpretable Reinforcement Learning, ICML 2018, section 4. What the
paper leaves open is settled here: `initialize` and `neighborhood_pool` see program templates that
are equal only once; programs are compared on the same episodes; of programs whose returns lie
within each other's noise the shorter wins. `create_histories` and `update_histories` are in
`search.imitation`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice

from pirlc.ir.expansion import Expansion, expand
from pirlc.ir.policy import Interface
from pirlc.search.candidate import Candidate, choose
from pirlc.search.canonical import canonical_form
from pirlc.search.context import Search
from pirlc.search.enumeration import Enumeration
from pirlc.search.neighbourhood import Neighbour, neighbourhood
from pirlc.search.objective import Objective
from pirlc.search.observation import GLANCE, fingerprint, probes
from pirlc.search.settings import Settings
from pirlc.semantics.histories import HistorySet


def ndps(search: Search, objective: Objective, *, augment: bool) -> Candidate:
    """Algorithm 1, from an objective made by `create_histories` to the best program found.

    `augment=False` leaves out `update_histories` (the paper's NoAug).
    """
    program = initialize(search, objective)
    for turn in range(1, search.settings.iterations + 1):
        best = program
        if augment:
            objective = objective.update_histories(search, best, turn)
        pool = neighborhood_pool(search, best)
        tuned = objective.tune(search, pool, f"iteration {turn}")
        if not tuned:
            return best
        closest = sorted(tuned, key=lambda candidate: (candidate.loss, candidate.size))
        program = collect_reward(search, closest, f"iteration {turn}")
        if best.mean >= program.mean:
            return choose([best, program])
    return program


def initialize(search: Search, objective: Objective) -> Candidate:
    """The start: of a pool of programs close to the oracle, the one with the highest return.

    Templates are enumerated shortest first. The pool keeps the closest, and the closest of every
    size that is closer than all shorter ones, so that short programs get their chance. A template
    whose parameters all have a guess takes part with its guesses, too: what an engineer would
    try first may earn more than what is closest to the oracle.
    """
    settings = search.settings
    pool = [Neighbour(expansion, ()) for expansion in first_templates(search)]
    tuned = objective.tune(search, pool, "initialize")
    by_loss = sorted(tuned, key=lambda candidate: (candidate.loss, candidate.size))
    chosen = [*_record_losses(tuned), *by_loss][: 2 * settings.simulated]
    close = list(dict.fromkeys(chosen))[: settings.simulated]
    guessed = [guess for n in pool if (guess := as_guessed(n.expansion)) is not None]
    return _most_rewarded(search, [*close, *guessed], "initialize")


def first_templates(search: Search) -> list[Expansion]:
    """The pool of `initialize`: the shortest templates, each once, shortest first."""
    if not search.pool:
        search.pool.extend(shortest(search.enumeration, search.settings))
    return search.pool


def as_guessed(expansion: Expansion) -> Candidate | None:
    """The template with its parameters' guesses; None if one has none, or there is none."""
    values = {p.name: p.guess for p in expansion.template.free if p.guess is not None}
    if not values or len(values) < len(expansion.template.free):
        return None
    return Candidate(expansion, tuple(sorted(values.items())), math.inf)


def neighborhood_pool(search: Search, program: Candidate) -> list[Neighbour]:
    """Templates structurally similar to a program, shorter ones first, each once."""
    settings = search.settings
    near = neighbourhood(
        search.enumeration,
        program.expansion,
        dict(program.values),
        growth=settings.growth,
        per_move=settings.per_move,
        largest=settings.largest,
    )
    carried = {id(n.expansion): n for n in near}
    kept = islice(
        distinct(search.sketch.interface, (n.expansion for n in near)), settings.neighbours
    )
    return [carried[id(expansion)] for expansion in kept]


def collect_reward(search: Search, programs: Sequence[Candidate], stage: str) -> Candidate:
    """Simulates the first of some programs, closest first, and returns the best of them.

    The paper simulates the closest alone; a few more cost little, and distance is not return.
    """
    return _most_rewarded(search, programs[: search.settings.simulated], stage)


def _most_rewarded(search: Search, programs: Sequence[Candidate], stage: str) -> Candidate:
    simulated = search.simulate(programs, "collect_reward", search.settings.episodes)
    for candidate in simulated:
        search.keep(stage, candidate)
    return max(simulated, key=lambda candidate: (candidate.mean, -candidate.size))


def shortest(enumeration: Enumeration, settings: Settings) -> Iterator[Expansion]:
    """The `settings.pool` shortest templates, each once, made one by one."""
    sketch = enumeration.sketch
    every = (expand(sketch, d) for d in enumeration.shortest_first(settings.largest))
    return islice(distinct(sketch.interface, every), settings.pool)


def distinct(interface: Interface, expansions: Iterable[Expansion]) -> Iterator[Expansion]:
    """The first of those templates that are equal in form or by observation."""
    histories = probes(interface)
    forms: set[str] = set()
    alike: dict[str, list[_Observed]] = {}
    for expansion in expansions:
        form = canonical_form(expansion.template)
        if form in forms:
            continue
        forms.add(form)
        observed = _Observed(expansion, histories)
        same_at_a_glance = alike.setdefault(fingerprint(expansion.template, histories, GLANCE), [])
        if not any(other.closely == observed.closely for other in same_at_a_glance):
            same_at_a_glance.append(observed)
            yield expansion


@dataclass(frozen=True, eq=False)
class _Observed:
    """A template that is looked at closely only if another is like it at a glance."""

    expansion: Expansion
    histories: HistorySet

    @cached_property
    def closely(self) -> str:
        return fingerprint(self.expansion.template, self.histories)


def _record_losses(candidates: Iterable[Candidate]) -> list[Candidate]:
    """Those closer than every shorter one, shortest first."""
    records: list[Candidate] = []
    for candidate in sorted(candidates, key=lambda c: (c.size, c.loss)):
        if not records or candidate.loss < records[-1].loss:
            records.append(candidate)
    return records
