"""Questions to z3 in turn, each about the histories that the last answers leave open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from time import monotonic

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from pirlc.ir.policy import Choice
from pirlc.tune.how import Tuning
from pirlc.tune.maxsmt.groups import choose_histories
from pirlc.tune.maxsmt.limits import blocks
from pirlc.tune.maxsmt.piecewise import Guard, Known, Truth, agreement, both, results
from pirlc.tune.maxsmt.regions import Box, Vector, at, features, guards_of, settled, usable
from pirlc.tune.maxsmt.solving import solve
from pirlc.tune.problem import Score, Tuned, TuningProblem

LOOKED_AT = 8192
"""The histories that are gathered into groups; of more, a sample. The last word has the score of
all."""

FIRST, GROWTH, MOST, FEWEST = 48, 16, 160, 8
"""Histories of the first question, how many more in each next one, and of the largest and the
smallest."""

WIDTHS = (1.0, 0.5, 0.25, 0.12)
"""Halves of the boxes around the best parameters: by how much of its spread each parameter may move
a guard."""

PART = 0.125
"""Of the effort, for one question."""

LEAST = 0.02
"""Of the effort, for a question that is answered at once: so many there may be."""

PATIENCE = 2
"""Rounds of all widths without anything better, before the search ends."""

MARGIN = 0.002
"""How clear of zero a guard is to be, as a part of its spread."""

_WRITING = 1500
"""What a soft constraint costs before z3 begins, in z3's units of effort."""

_FINALISTS = 4

NO_ANSWER = "z3 reached its limit before its first answer: these are the parameters to start from"
"""The note of such a result."""


@dataclass(frozen=True, eq=False)
class _View:
    """The problem with some parameters unknown and the others given."""

    numbers: tuple[int, ...]
    truth: Truth
    guards: list[Guard]
    features: Vector
    usable: NDArray[np.bool_]


@dataclass
class _Found:
    """The best parameters so far, scored on the histories that are looked at."""

    theta: Vector
    distance: float
    others: list[tuple[float, int, Vector]] = field(default_factory=list)
    tried: int = 0


def tune(problem: TuningProblem, seed: int, how: Tuning) -> Tuned:
    """The parameters found under `how.effort`, and `how.seconds` if given.

    Where z3 finds nothing better in time, those to start from: never a failure. Continuous actions
    are to be within `how.tolerance` of their range. The template must be one that can be taken
    (`unsuitable`).
    """
    with threadpool_limits(1):
        return _Search(problem, seed, how).run()


class _Search:
    def __init__(self, problem: TuningProblem, seed: int, how: Tuning) -> None:
        self.problem, self.how = problem, how
        self.rng = np.random.default_rng(seed)
        self.begun = monotonic()
        self.effort = how.effort
        self.answered = True
        count = len(problem.histories)
        if count > LOOKED_AT:
            sample = np.sort(self.rng.choice(count, LOOKED_AT, replace=False))
            self.looked_at = TuningProblem(
                problem.template,
                problem.histories.select(sample),
                problem.labels[sample],
                problem.start,
            )
        else:
            self.looked_at = problem
        self.score = Score(self.looked_at)
        self.kinds = _kinds(self.looked_at)

    def run(self) -> Tuned:
        start = self._start()
        if not self.problem.names or not len(self.problem.histories):
            return Score(self.problem).tuned(start)
        found = _Found(start, self.score(start))
        sets = blocks(self.problem.template)
        positions = {name: j for j, name in enumerate(self.problem.names)}
        block = tuple(positions[name] for name in sets[0])
        view = self._view(block, found.theta)
        self._ask(view, found, self._everywhere(), FIRST)
        turn, width, most, idle = 0, 0, FIRST, 0
        patience = PATIENCE * (len(WIDTHS) + 1) * len(sets)
        while self.effort > 0 and self._in_time() and found.distance > 0.0 and idle < patience:
            # A question that was too long for an answer is asked again with fewer histories.
            most = min(MOST, most + GROWTH) if self.answered else max(FEWEST, most // 2)
            if len(sets) > 1:
                turn += 1
                block = tuple(positions[name] for name in sets[turn % len(sets)])
                view = self._view(block, found.theta)
            box = (
                self._everywhere()
                if width == len(WIDTHS)
                else self._around(view, found.theta, WIDTHS[width])
            )
            better = self._ask(view, found, box, most)
            idle = 0 if better else idle + 1
            width = min(width, len(WIDTHS) - 1) if better else (width + 1) % (len(WIDTHS) + 1)
        return self._best(found)

    def _start(self) -> Vector:
        """What is known to be near, what is guessed, and else the middle."""
        template, known = self.problem.template, self.problem.start
        theta = []
        for p in template.free:
            guess = p.lower / 2.0 + p.upper / 2.0 if p.guess is None else p.guess
            theta.append(min(max(known.get(p.name, guess), p.lower), p.upper))
        return np.array(theta, dtype=np.float64)

    def _in_time(self) -> bool:
        left = self._left()
        return left is None or left > 0.0

    def _left(self) -> float | None:
        if self.how.seconds is None:
            return None
        return self.how.seconds - (monotonic() - self.begun)

    def _view(self, numbers: tuple[int, ...], theta: Vector) -> _View:
        template, histories = self.looked_at.template, self.looked_at.histories
        names = self.looked_at.names
        given = {n: float(theta[j]) for j, n in enumerate(names) if j not in numbers}
        count = len(histories)
        found = results(template, histories, given)
        truth: Truth = Known(np.ones(1, dtype=np.bool_))
        for column, spec in enumerate(template.interface.actions):
            labels = self.looked_at.labels[:, column]
            truth = both(truth, agreement(found[column], spec, labels, self.how.tolerance))
        guards = guards_of([truth])
        table = np.concatenate([features(found, guards, count), self._aims()], axis=1)
        return _View(numbers, truth, guards, table, usable(guards, count))

    def _aims(self) -> Vector:
        """The oracle's continuous actions, in units that tell a tolerance."""
        columns = []
        for column, spec in enumerate(self.looked_at.template.interface.actions):
            if not isinstance(spec.domain, Choice):
                width = spec.domain.upper - spec.domain.lower
                labels = np.clip(
                    self.looked_at.labels[:, column], spec.domain.lower, spec.domain.upper
                )
                columns.append(4.0 * labels / width)
        return np.array(columns).reshape(len(columns), len(self.looked_at.labels)).T

    def _everywhere(self) -> Box:
        lower, upper = self.problem.lower, self.problem.upper
        return Box(np.clip(np.zeros(len(lower)), lower, upper), lower, upper)

    def _around(self, view: _View, theta: Vector, width: float) -> Box:
        """How far each parameter may go from theta, for a guard to move by `width` spreads."""
        half = np.full(len(theta), np.inf)
        for guard in view.guards:
            spread = float(np.std(at(guard.left, theta)))
            for j, slope in guard.left.slopes.items():
                size = float(np.sqrt(np.mean(slope**2)))
                if spread > 0.0 and size > 0.0:
                    half[j] = min(half[j], width * spread / size)
        whole = (self.problem.upper - self.problem.lower) / 2.0
        half = np.where(np.isfinite(half), np.minimum(half, whole), whole)
        lower = np.maximum(theta - half, self.problem.lower)
        return Box(theta, lower, np.minimum(theta + half, self.problem.upper))

    def _ask(self, view: _View, found: _Found, box: Box, most: int) -> bool:
        """Whether z3 knew better parameters in the box, which are kept."""
        here = np.array(found.theta)
        lower, upper, centre = here.copy(), here.copy(), here.copy()
        unknown = list(view.numbers)
        lower[unknown], upper[unknown] = box.lower[unknown], box.upper[unknown]
        centre[unknown] = box.centre[unknown]
        box = Box(centre, lower, upper)
        count = len(self.looked_at.histories)
        with np.errstate(all="ignore"):
            must, may = settled(view.truth, box)
            right, _ = settled(view.truth, Box(here, here, here))
        open_ = np.broadcast_to(~must & may, (count,)) & view.usable
        among = np.flatnonzero(open_)
        wrong = ~np.broadcast_to(right, (count,))
        chosen = choose_histories(view.features, self.kinds, among, wrong, most, self.rng)
        if not len(chosen.numbers):
            self.effort -= max(_WRITING * most, int(self.how.effort * LEAST), 1)
            return False
        slice_ = min(self.effort, max(1, int(self.how.effort * PART)))
        answer = solve(view.truth, view.guards, chosen, box, MARGIN, slice_, self._left())
        spent = min(answer.effort, slice_) + _WRITING * len(chosen.numbers)
        self.effort -= max(spent, int(self.how.effort * LEAST), 1)
        self.answered = bool(answer.models)
        return self._keep(found, answer.models)

    def _keep(self, found: _Found, models: Sequence[Vector]) -> bool:
        better = False
        for theta in models:
            distance = self.score(theta)
            found.tried += 1
            found.others.append((distance, found.tried, theta))
            if distance < found.distance:
                found.theta, found.distance, better = theta, distance, True
        found.others = sorted(found.others, key=lambda other: other[:2])[:_FINALISTS]
        return better

    def _best(self, found: _Found) -> Tuned:
        """The closest on all histories, of those that were closest on the ones looked at."""
        score = Score(self.problem)
        candidates = [found.theta]
        if self.looked_at is not self.problem:
            candidates += [theta for _, _, theta in found.others]
        best = min((score.tuned(theta) for theta in candidates), key=lambda t: t.distance)
        return best if found.tried else replace(best, note=NO_ANSWER)


def _kinds(problem: TuningProblem) -> NDArray[np.int64]:
    """A number for each combination of discrete actions that the oracle takes, (N,)."""
    columns = [
        problem.labels[:, column]
        for column, spec in enumerate(problem.template.interface.actions)
        if isinstance(spec.domain, Choice)
    ]
    if not columns:
        return np.zeros(len(problem.labels), dtype=np.int64)
    _, kinds = np.unique(np.stack(columns, axis=1), axis=0, return_inverse=True)
    return np.asarray(kinds, dtype=np.int64).reshape(-1)
