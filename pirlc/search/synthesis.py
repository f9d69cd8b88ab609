"""A whole search: Algorithm 1, then what is done apart from it, and how it may be cut short."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from pirlc.oracle.network import Oracle
from pirlc.search.candidate import Candidate
from pirlc.search.context import Search
from pirlc.search.imitation import create_histories
from pirlc.search.journal import BudgetExhausted
from pirlc.search.naive import explore
from pirlc.search.ndps import ndps
from pirlc.search.refinement import VALIDATION_EPISODES, promising, refine
from pirlc.search.rounding import round_constants


class Ending(Enum):
    """Why a search ended."""

    FINISHED = "finished"
    BUDGET = "budget used up"
    INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class Plan:
    """Which parts of a search take part.

    Attributes:
        augment: `update_histories` adds the program's own trajectories (off: the paper's NoAug).
        refine: parameters are refined on return afterwards, which is not part of the paper.
    """

    augment: bool = True
    refine: bool = True


@dataclass(frozen=True)
class Found:
    """What a search found.

    `imitated` is Algorithm 1's own result, its constants as tuned (None if it did not get that
    far); `program` is the result of everything.
    """

    program: Candidate
    imitated: Candidate | None
    ending: Ending


def find_program(search: Search, oracle: Oracle | None, plan: Plan) -> Found | None:
    """The best program for the sketch; without an oracle, by return alone (the paper's Naive).

    Ctrl-C and an exhausted budget end it early with the best program met so far, or None if there
    was none yet.
    """
    imitated: Candidate | None = None
    try:
        try:
            objective = explore(search) if oracle is None else create_histories(search, oracle)
            imitated = ndps(search, objective, augment=plan.augment)
        except BudgetExhausted:
            search.journal.allow_closing()
            best = _best_so_far(search)
            if best is None:
                return None
            return Found(_rounded(search, best), None, Ending.BUDGET)
        if not plan.refine:
            return Found(_rounded(search, imitated), imitated, Ending.FINISHED)
        climbed = refine(search, objective.histories.sample(_SCALE_HISTORIES, 0), promising(search))
        ending = Ending.BUDGET if search.journal.closing else Ending.FINISHED
        return Found(_rounded(search, climbed), imitated, ending)
    except KeyboardInterrupt:
        best = _best_so_far(search)
        return None if best is None else Found(best, imitated, Ending.INTERRUPTED)


_SCALE_HISTORIES = 2000
"""Histories enough to tell how large a step in each parameter is."""


def _rounded(search: Search, program: Candidate) -> Candidate:
    rounded = round_constants(search, program)
    (checked,) = search.simulate([rounded], "final check", VALIDATION_EPISODES)
    search.keep("round", checked)
    return checked


def _best_so_far(search: Search) -> Candidate | None:
    """The best by return, or the closest to the oracle if none was simulated yet."""
    met = [candidate for _, candidate in search.met]
    simulated = [candidate for candidate in met if candidate.returns is not None]
    if simulated:
        return max(simulated, key=lambda c: (len(c.returns or ()) >= 100, c.mean, -c.size))
    return min(met, key=lambda c: (c.loss, c.size), default=None)
