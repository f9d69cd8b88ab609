"""Constants with the fewest digits that keep the return."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pirlc.search.candidate import Candidate
from pirlc.search.context import Search

_PURPOSE, _EPISODES = "round", 3
"""The seeds of these episodes, and how many, in units of `Settings.episodes`."""

KEPT = 0.002
"""How much of the mean return, relative to its size, rounding may cost."""

_DIGITS = (1, 2, 3, 4, 6, 9)


def round_constants(search: Search, program: Candidate) -> Candidate:
    """The program with its parameters rounded to as few significant digits as keep its return.

    First all to the same number of digits; then each to one digit less, where that costs nothing
    either. Compared on episodes of its own; the returns of the result are those.
    """
    if not program.values:
        return program
    search.progress("round constants", 0, 1)
    exact = dict(program.values)
    choices = [dict(coarser(program, digits).values) for digits in _DIGITS]
    ladder = [*choices, exact]
    means = _means(search, program, ladder)
    enough = means[-1] - KEPT * abs(means[-1])
    best = next(i for i, mean in enumerate(means) if mean >= enough)
    chosen = ladder[best]
    if 0 < best < len(choices):
        shorter = choices[best - 1]
        single = [{**chosen, name: shorter[name]} for name in chosen]
        harmless = [
            name
            for name, mean in zip(chosen, _means(search, program, single), strict=True)
            if mean >= enough
        ]
        together = {**chosen, **{name: shorter[name] for name in harmless}}
        if _means(search, program, [together])[0] >= enough:
            chosen = together
    rounded = replace(program, values=tuple(sorted(chosen.items())), returns=None)
    return search.simulate([rounded], _PURPOSE, _EPISODES * search.settings.episodes)[0]


def coarser(program: Candidate, digits: int) -> Candidate:
    """The program with all its parameters rounded to so many significant digits, not simulated."""
    values = tuple((name, _rounded(program, name, value, digits)) for name, value in program.values)
    return replace(program, values=values, returns=None)


def _means(search: Search, program: Candidate, values: list[dict[str, float]]) -> list[float]:
    seeds = search.seeds(_PURPOSE, _EPISODES * search.settings.episodes)
    returns = search.returns(program.expansion.template, values, seeds)
    return [float(mean) for mean in np.mean(returns, axis=1)]


def _rounded(program: Candidate, name: str, value: float, digits: int) -> float:
    parameter = next(p for p in program.expansion.template.free if p.name == name)
    return min(max(float(f"{value:.{digits}g}"), parameter.lower), parameter.upper)
