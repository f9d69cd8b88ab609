"""What templates are tuned for: to be close to the oracle, or, without one, to earn return."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from pirlc.search.candidate import Candidate
from pirlc.search.context import Search
from pirlc.search.neighbourhood import Neighbour
from pirlc.semantics.histories import HistorySet


class Objective(Protocol):
    """Finds parameters for templates; the smaller a candidate's loss the better.

    `histories` are those that it looks at.
    """

    @property
    def histories(self) -> HistorySet: ...

    def tune(self, search: Search, templates: Sequence[Neighbour], stage: str) -> list[Candidate]:
        """A candidate for each template, in order; tuning starts from the carried values."""

    def update_histories(self, search: Search, program: Candidate, turn: int) -> Objective:
        """The objective after a look at what the program does."""
