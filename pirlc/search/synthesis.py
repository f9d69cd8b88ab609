"""A whole search: Algorithm 1, then what is done apart from it, and how it may be cut short."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from pirlc.oracle.network import Oracle
from pirlc.search.candidate import Candidate
from pirlc.search.choice import with_optimizer
from pirlc.search.context import Search
from pirlc.search.imitation import Imitation, create_histories
from pirlc.search.journal import BudgetExhausted
from pirlc.search.naive import explore
from pirlc.search.ndps import ndps
from pirlc.search.refinement import promising, refine
from pirlc.search.rounding import round_constants


class Ending(Enum):
    """Why a search ended. `TIMEOUT`: its budget was used up before it had any program."""

    FINISHED = "finished"
    BUDGET = "budget used up"
    TIMEOUT = "timeout"
    INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class Plan:
    """Which parts of a synthesis take part.

    Attributes:
        augment: `update_histories` adds the program's own trajectories (off: the paper's NoAug).
        refine: parameters are refined on return afterwards, which is not part of the paper.
        sketch: the sketch's expressions and rules say what to search (off: the language's own
            grammar over the same sensors does, the paper's NoSketch).
        branches: programs may have an `if` (off: the paper's NoIF).

    The last two choose the sketch that is searched; the search itself knows nothing of them.
    """

    augment: bool = True
    refine: bool = True
    sketch: bool = True
    branches: bool = True


@dataclass(frozen=True)
class Found:
    """What a search found.

    `imitated` is Algorithm 1's own result, its constants as tuned (None if it did not get that
    far); `program` is the result of everything.
    """

    program: Candidate
    imitated: Candidate | None
    ending: Ending


def find_program(search: Search, oracle: Oracle | None, plan: Plan) -> Found | Ending:
    """The best program for the sketch; without an oracle, by return alone (the paper's Naive).

    Ctrl-C and an exhausted budget end it early with the best program met so far, or with why there
    is none: `TIMEOUT` or `INTERRUPTED`.
    """
    imitated: Candidate | None = None
    try:
        objective = explore(search) if oracle is None else _imitation(search, oracle)
        imitated = ndps(search, objective, augment=plan.augment)
        best = imitated
        if plan.refine:
            histories = objective.histories.sample(_SCALE_HISTORIES, search.settings.seed)
            best = refine(search, histories, promising(search))
        return Found(_rounded(search, best), imitated, Ending.FINISHED)
    except BudgetExhausted:
        return _so_far(search, imitated, Ending.BUDGET) or Ending.TIMEOUT
    except KeyboardInterrupt:
        return _so_far(search, imitated, Ending.INTERRUPTED) or Ending.INTERRUPTED


def _imitation(search: Search, oracle: Oracle) -> Imitation:
    return with_optimizer(search, create_histories(search, oracle))


_SCALE_HISTORIES = 2000
"""Histories enough to tell how large a step in each parameter is."""


def _rounded(search: Search, program: Candidate) -> Candidate:
    rounded = round_constants(search, program)
    search.keep("round", rounded)
    return rounded


def _so_far(search: Search, imitated: Candidate | None, ending: Ending) -> Found | None:
    """The best by return, or the closest to the oracle if none was simulated yet."""
    met = [candidate for _, candidate in search.met]
    wanted = search.episodes(search.settings.episodes)
    enough = [c for c in met if len(c.returns or ()) >= wanted]
    if enough:
        best = max(enough, key=lambda c: (c.mean, -c.size))
    elif met:
        best = min(met, key=lambda c: (c.loss, c.size))
    else:
        return None
    return Found(best, imitated, ending)
