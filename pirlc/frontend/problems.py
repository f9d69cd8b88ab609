"""Every kind of mistake in a .pirl file, as a small value; `describe` puts them into words.

Each group of codes has its module (`problems_syntax` and so on). In all of them `span` is where the
mistake is; other spans are places that explain it.
"""

from __future__ import annotations

from dataclasses import dataclass

from pirlc.frontend.problems_names import NameProblem
from pirlc.frontend.problems_sketch import SketchProblem
from pirlc.frontend.problems_syntax import SyntaxProblem
from pirlc.frontend.problems_types import TypeProblem

Problem = SyntaxProblem | NameProblem | TypeProblem | SketchProblem


@dataclass(frozen=True)
class Found:
    """A problem, and for one inside a rule which use of the rule it is about (`context`)."""

    problem: Problem
    context: str | None = None


class Collector:
    """Gathers problems, each once: a rule is read once for each combination of types.

    Beyond `LIMIT` problems nobody reads on, and none is added.
    """

    LIMIT = 100

    def __init__(self) -> None:
        self.found: list[Found] = []
        self.context: str | None = None
        self._seen: set[tuple[type, object]] = set()

    def add(self, problem: Problem) -> None:
        key = (type(problem), getattr(problem, "span", None))
        if key not in self._seen and not self.full:
            self._seen.add(key)
            self.found.append(Found(problem, self.context))

    @property
    def full(self) -> bool:
        return len(self.found) >= self.LIMIT
