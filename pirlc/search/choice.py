"""Which optimiser a search tunes its templates with: the one asked for, or the one that measures
best on a few of the templates that the search begins with.

Distances decide, and where they are alike the known order of speed. Seconds are told, but decide
nothing: the same search takes the same optimiser on a machine that is busy.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

from pirlc.ir.policy import ProgramTemplate, Sketch
from pirlc.search.context import Search
from pirlc.search.enumeration import Enumeration
from pirlc.search.imitation import Imitation
from pirlc.search.ndps import first_templates, shortest
from pirlc.search.neighbourhood import Neighbour
from pirlc.search.problems import NothingSuits, error
from pirlc.search.settings import Choice, Measured, Settings
from pirlc.simulation.workers import parallel_map
from pirlc.tune import TuningProblem, tune_apart, unsuitable
from pirlc.tune.how import Optimizer, Tuning

TEMPLATES = 3
"""Compared on: those with the fewest parameters, the most, and one between."""

TRIALS = 20
EFFORT = 1_000_000
"""Budgets of the comparison, or those of the search where they are smaller."""

BY_SPEED = (Optimizer.CASADI, Optimizer.SMT, Optimizer.BAYES)
"""The fastest first, as measured in docs/study.md."""

ALIKE = 0.02
"""Mean distances that differ by no more than this part of the smaller are taken as alike."""

_Times = dict[Optimizer, float]
_Distances = list[dict[str, float]]


def require_suitable(sketch: Sketch, settings: Settings) -> None:
    """Raises PirlcError (E0430) if the optimiser asked for can take none of the first templates."""
    asked = settings.optimizer
    if asked is None:
        return
    reasons = []
    for expansion in shortest(Enumeration(sketch), settings):
        reason = unsuitable(expansion.template, asked)
        if reason is None:
            return
        reasons.append(reason)
    if reasons:
        raise error(NothingSuits(asked, tuple(reasons)))


def with_optimizer(search: Search, objective: Imitation) -> Imitation:
    """The objective with the optimiser to use, which is told and noted as `search.choice`.

    Raises PirlcError (E0430) where the one that was asked for cannot be used.
    """
    settings = search.settings
    require_suitable(search.sketch, settings)
    if settings.optimizer is None:
        search.choice = _measured(search, objective)
        search.tell_choice(search.choice)
    else:
        search.choice = Choice(settings.optimizer, "asked for")
    return replace(objective, how=replace(settings.tuning, optimizer=search.choice.optimizer))


def _measured(search: Search, objective: Imitation) -> Choice:
    pool = [e for e in first_templates(search) if e.template.free]
    if not pool:
        return Choice(BY_SPEED[0], "no template has parameters to find")
    able, fit = _able([e.template for e in pool])
    if len(able) == 1:
        return Choice(able[0], "the only one that can take most of the templates")
    ranked = sorted((pool[i] for i in fit), key=lambda e: len(e.template.free))
    places = sorted({0, len(ranked) // 2, len(ranked) - 1})
    chosen = [Neighbour(ranked[i], ()) for i in places]
    problems = objective.problems(search, chosen)
    distances, seconds = _compared(search, objective, problems, able)
    means = {
        optimizer: sum(found[optimizer] for found in distances) / len(distances)
        for optimizer in able
        if all(optimizer in found for found in distances)
    }
    taken, why = decide(means, len(problems[0].histories))
    measured = tuple(
        Measured(p.template.size, len(p.names), found)
        for p, found in zip(problems, distances, strict=True)
    )
    return Choice(taken, why, means, measured, seconds)


def _able(templates: Sequence[ProgramTemplate]) -> tuple[list[Optimizer], list[int]]:
    """Optimisers that can take at least half of the templates, and the templates (by position) that
    all of them can take."""
    suited = {
        optimizer: {i for i, t in enumerate(templates) if unsuitable(t, optimizer) is None}
        for optimizer in BY_SPEED
    }
    able = [o for o in BY_SPEED if 2 * len(suited[o]) >= len(templates)]
    common = set.intersection(*(suited[o] for o in able))
    while not common:
        able.pop()
        common = set.intersection(*(suited[o] for o in able))
    return able, sorted(common)


def _compared(
    search: Search,
    objective: Imitation,
    problems: Sequence[TuningProblem],
    able: Sequence[Optimizer],
) -> tuple[_Distances, _Times]:
    """For each problem the distances reached, by optimiser, and the seconds of each optimiser.

    If the fastest leaves no distance that another could make up, it is not compared to any.
    """
    tuning, seed = search.settings.tuning, search.settings.seed
    hows = {
        optimizer: replace(
            tuning,
            optimizer=optimizer,
            trials=min(TRIALS, tuning.trials),
            effort=min(EFFORT, tuning.effort),
            seconds=None,
        )
        for optimizer in able
    }
    seconds: _Times = {}

    def measure(optimizer: Optimizer) -> list[float]:
        how = hows[optimizer]
        search.progress(f"choose the optimiser ({optimizer})", able.index(optimizer), len(able))
        found = parallel_map(lambda p: _timed(p, seed, how), list(problems), search.workers)
        seconds[optimizer] = sum(took for _, took in found)
        return [distance for distance, _ in found]

    def run(_: Sequence[Sequence[TuningProblem]]) -> list[_Distances]:
        found = {able[0]: measure(able[0])}
        least = sum(found[able[0]]) / len(problems)
        if least > within(least, len(problems[0].histories)):
            found |= {optimizer: measure(optimizer) for optimizer in able[1:]}
        return [[{str(o): found[o][i] for o in found} for i in range(len(problems))]]

    texts = [objective.key(search, problem, hows[o]) for problem in problems for o in able]
    # Before the search: a short budget does not end in it, and one of calls repeats one of time.
    with search.journal.apart_from_budget():
        (distances,) = search.journal.each("choose", [problems], [" ".join(texts)], run)
    return distances, seconds


def _timed(problem: TuningProblem, seed: int, how: Tuning) -> tuple[float, float]:
    began = time.process_time()
    return tune_apart(problem, seed, how).distance, time.process_time() - began


def decide(means: Mapping[Optimizer, float], histories: int) -> tuple[Optimizer, str]:
    """The optimiser to take, given mean distances over that many histories, and why."""
    best = min(means.values())
    close = [o for o in BY_SPEED if o in means and means[o] <= best + within(best, histories)]
    taken = close[0]
    if len(means) == 1:
        return taken, "the fastest, and it leaves no distance that another could make up"
    if len(close) == 1:
        return taken, "the closest"
    if means[taken] == best:
        return taken, "the closest, and the fastest of those that come as close"
    return taken, "the fastest of those that come as close"


def within(distance: float, histories: int) -> float:
    """By how much a mean distance may be exceeded and still count as alike.

    `ALIKE`, or the 95 % interval of a mean of that many values from 0 to 1, or one history.
    """
    share = min(max(distance, 0.0), 1.0)
    noise = 1.96 * math.sqrt(share * (1.0 - share) / histories)
    return max(ALIKE * distance, noise, 1.0 / histories)
