"""The programs to choose from: for each, no shorter program that was met earns as much.

The search itself names one program. What else it met may be worth more to a user: half the size for
a little return. So the best of each structure met are taken, those that earn more than every
shorter one are given constants with few digits, and all are compared on the same fresh episodes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pirlc.search.candidate import Candidate
from pirlc.search.canonical import canonical_form
from pirlc.search.context import Search
from pirlc.search.rounding import KEPT, coarser

_EPISODES, _ROUNDING_EPISODES = 2.0, 0.4
"""Of each program, in units of `Settings.episodes`: to compare programs, and digits."""

_DIGITS = (1, 2, 3, 4)

MOST = 7
"""Programs that are compared, the search's own included."""


@dataclass(frozen=True)
class Front:
    """`members`: each shorter than the one before it, and earning less. All returns are those of
    the same episodes. `chosen` is the search's own result on these episodes, a member or not."""

    members: tuple[Candidate, ...]
    chosen: Candidate

    @property
    def chosen_number(self) -> int | None:
        """The number of the search's own result, counted from 1; None if it is no member."""
        numbers = (n for n, c in enumerate(self.members, start=1) if c is self.chosen)
        return next(numbers, None)

    def member(self, number: int) -> Candidate | None:
        """The member of a number, counted from 1; None if there is none."""
        return self.members[number - 1] if 1 <= number <= len(self.members) else None


def find_front(search: Search, chosen: Candidate) -> Front:
    """The front of what a search has met, `chosen` being its result.

    Simulates some hundreds of episodes of at most `MOST` programs, through the journal.
    """
    others = _rounded(search, _shortlist(search, chosen))
    episodes = max(2, round(_EPISODES * search.settings.episodes))
    measured = search.simulate([chosen, *others], "front", episodes)
    return Front(undominated(measured), measured[0])


def undominated(candidates: Iterable[Candidate]) -> tuple[Candidate, ...]:
    """Those that have a higher mean return than every other one of at most their size; the best
    return first. Of equal ones the first."""
    return tuple(reversed(_rising(candidates, lambda candidate: candidate.mean)))


def _rising(
    candidates: Iterable[Candidate], worth: Callable[[Candidate], float]
) -> list[Candidate]:
    """Those worth more than everything of at most their size, shortest first."""
    found: list[Candidate] = []
    for candidate in sorted(candidates, key=lambda c: (c.size, -worth(c))):
        if not found or worth(candidate) > worth(found[-1]):
            found.append(candidate)
    return found


def _shortlist(search: Search, chosen: Candidate) -> list[Candidate]:
    """Further structures than the chosen one's that are likely to be on the front."""
    enough = search.episodes(search.settings.episodes)
    best = {canonical_form(chosen.expansion.template): chosen}
    own = set(best)
    for _, candidate in search.met:
        if candidate.returns is None or len(candidate.returns) < enough:
            continue
        form = canonical_form(candidate.expansion.template)
        if form not in own and (form not in best or _promise(candidate) > _promise(best[form])):
            best[form] = candidate
    rising = _rising((c for c in best.values() if c is not chosen), _promise)
    return _thinned(rising, MOST - 1)


def _promise(candidate: Candidate) -> float:
    """A return that the program is likely to reach: of many, the best mean is often a lucky one."""
    returns = candidate.returns or ()
    if len(returns) < 2:
        return candidate.mean
    return candidate.mean - float(np.std(returns, ddof=1)) / math.sqrt(len(returns))


def _thinned(rising: list[Candidate], most: int) -> list[Candidate]:
    """Without those that add least to what a shorter one earns; the ends stay."""
    kept = list(rising)
    while len(kept) > most:
        gains = [_promise(b) - _promise(a) for a, b in pairwise(kept[:-1])]
        del kept[1 + gains.index(min(gains))]
    return kept


def _rounded(search: Search, programs: Sequence[Candidate]) -> list[Candidate]:
    """The programs with as few digits (the same for all constants of one) as keep their return."""
    episodes = max(2, round(_ROUNDING_EPISODES * search.settings.episodes))
    ladders = [[*(coarser(p, digits) for digits in _DIGITS), p] for p in programs]
    asked = [candidate for ladder in ladders for candidate in ladder]
    measured = iter(search.simulate(asked, "front digits", episodes))
    found = []
    for ladder in ladders:
        means = [next(measured).mean for _ in ladder]
        enough = means[-1] - KEPT * abs(means[-1])
        found.append(next(c for c, mean in zip(ladder, means, strict=True) if mean >= enough))
    return found
