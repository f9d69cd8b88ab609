"""Suprema of what is not piecewise linear, enclosed by branch and bound.

A program is evaluated over boxes of histories in interval arithmetic (mpmath's, rounded outward):
what comes out encloses every value in the box. The box that promises most is halved until no box
promises more than 1e-9 above a value that was seen. Where that takes too many boxes, the enclosure
found by then is still one.
"""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from mpmath import iv

from pirlc.ir.policy import Choice, Continuous, Program
from pirlc.ir.terms import PreviousAction, subterms
from pirlc.ir.types import Type
from pirlc.symbolic.walk import walk
from pirlc.verify.bounds.intervals import DIGITS, Interval, Possible, algebra, between, clip, end
from pirlc.verify.model import finite_range

CLOSE = Fraction(1, 10**9)
"""How near a bound must be to a value that some history gives."""

_STARTS = 10
_HOPELESS = 100
"""Boxes after which one without any bound is not expected to get one."""

Place = tuple[str, int]
"""A reading (sensor, number from the oldest) or an action's first `previous` (action, -1)."""

Box = dict[Place, tuple[float, float]]


@dataclass(frozen=True)
class IntervalStep:
    """By action, all that one step may give over a box where it is defined."""

    raw: Mapping[str, Possible]
    applied: Mapping[str, Possible]


Objective = Callable[[Sequence[IntervalStep]], Interval]


@dataclass(frozen=True)
class Enclosure:
    """The supremum is in [lower, upper] (None: no bound); `point` is a history that gives `lower`
    at least."""

    lower: Fraction | None
    upper: Fraction | None
    point: Mapping[Place, float]
    boxes: int


def enclose(
    program: Program, actions: Sequence[str], steps: int, objective: Objective, evaluations: int
) -> Enclosure:
    """The supremum of an objective of some actions over all histories of good readings, wherever
    it is defined."""
    saved = iv.prec
    iv.prec = DIGITS
    try:
        return _Search(program, actions, steps, objective, evaluations).run()
    finally:
        iv.prec = saved


class _Search:
    def __init__(
        self,
        program: Program,
        actions: Sequence[str],
        steps: int,
        objective: Objective,
        evaluations: int,
    ) -> None:
        self.left = evaluations
        self.program = program
        self.steps = steps
        self.objective = objective
        self.needed = needed(program, actions) if steps > 1 else set(actions)
        whole = _whole(program, steps)
        self.read: set[Place] = set()
        self.value(whole)
        self.order = sorted(self.read)
        # What is not read stays where it is: at the lower end.
        self.start: Box = {
            place: (low, high) if place in self.read else (low, low)
            for place, (low, high) in whole.items()
        }

    def value(self, box: Box) -> Interval:
        self.left -= 1
        return self.objective(self._evaluate(box))

    def at(self, point: Mapping[Place, float]) -> Fraction | None:
        """What a history gives at least; None where it may be undefined or infinite."""
        return end(self.value({place: (x, x) for place, x in point.items()}), 0)

    def top(self, box: Box) -> Fraction | None:
        """What no history in a box exceeds."""
        return end(self.value(box), 1)

    def _evaluate(self, box: Box) -> list[IntervalStep]:
        interface = self.program.interface
        previous: dict[str, Possible] = {}
        for action in interface.actions:
            match action.domain:
                case Continuous():
                    previous[action.name] = between(*box[action.name, -1])
                case Choice(values):
                    previous[action.name] = frozenset(values)
        done = []
        for step in range(self.steps):
            raw: dict[str, Possible] = {}
            applied: dict[str, Possible] = {}
            before = self._before(previous, free=step == 0)
            form = algebra(self.program, self._reader(box, step), before)
            for action, body in zip(interface.actions, self.program.bodies, strict=True):
                if action.name not in self.needed:
                    continue
                raw[action.name] = result = walk(body, form)
                match action.domain:
                    case Continuous(lower, upper):
                        applied[action.name] = clip(
                            result, between(lower, lower), between(upper, upper)
                        )
                    case Choice():
                        applied[action.name] = result
            done.append(IntervalStep(raw, applied))
            previous = {**previous, **applied}
        return done

    def _reader(self, box: Box, step: int) -> Callable[[str, int], Possible]:
        def element(sensor: str, index: int) -> Possible:
            place = (sensor, step + self.program.interface.window + index)
            self.read.add(place)
            return between(*box[place])

        return element

    def _before(
        self, previous: Mapping[str, Possible], *, free: bool
    ) -> Callable[[str, Type], Possible]:
        def before(action: str, _type: Type) -> Possible:
            value = previous[action]
            if free and not isinstance(value, frozenset):
                self.read.add((action, -1))
            return value

        return before

    def run(self) -> Enclosure:
        whole = self.top(self.start)
        best, point = self._seen(whole)
        used = 0
        settled: list[Fraction | None] = []
        heap = [_Promise.of(whole, 0, self.start)]
        while heap and self.left > 0:
            promise = heap[0]
            if promise.top is None and used >= _HOPELESS:
                break
            if promise.top is not None and best is not None and promise.top - best <= CLOSE / 2:
                break
            heapq.heappop(heap)
            place = self._to_halve(promise.box)
            if place is None:
                # No float lies inside: the enclosure is as good as it gets.
                settled.append(promise.top)
                continue
            low, high = promise.box[place]
            middle = low / 2 + high / 2
            for part in ((low, middle), (middle, high)):
                used += 1
                half = {**promise.box, place: part}
                centre = {p: a / 2 + b / 2 for p, (a, b) in half.items()}
                seen = self.at(centre)
                if seen is not None and (best is None or seen > best):
                    best, point = seen, centre
                heapq.heappush(heap, _Promise.of(self.top(half), used, half))
        tops = settled + ([heap[0].top] if heap else [])
        upper = None if None in tops else max(top for top in tops if top is not None)
        return Enclosure(best, upper, point, used)

    def _seen(self, most: Fraction | None) -> tuple[Fraction | None, Mapping[Place, float]]:
        """The best of some corners and middles, improved a reading at a time, unless `most`, which
        nothing exceeds, is reached before."""
        rng = random.Random(1)
        enough = self.left // 2
        point: Mapping[Place, float] = {p: a for p, (a, _) in self.start.items()}
        best = self.at(point)
        for start in range(_STARTS if self.order else 0):
            if self.left < enough or (most is not None and best == most):
                break
            here = {p: rng.choice((a, a / 2 + b / 2, b)) for p, (a, b) in self.start.items()}
            if start % 2:
                here = dict(point)
            reached = self.at(here)
            for place in self.order:
                low, high = self.start[place]
                for x in (low, high, low / 2 + high / 2, rng.uniform(low, high)):
                    trial = {**here, place: x}
                    seen = self.at(trial)
                    if seen is not None and (reached is None or seen > reached):
                        reached, here = seen, trial
            if reached is not None and (best is None or reached > best):
                best, point = reached, here
        return best, point

    def _to_halve(self, box: Box) -> Place | None:
        """The reading that what the box promises depends on most."""

        def left(place: Place) -> tuple[bool, Fraction, float]:
            low, high = box[place]
            middle = low / 2 + high / 2
            top = self.top({**box, place: (middle, middle)})
            return top is None, top or Fraction(0), low - high

        return min(
            (p for p in self.order if box[p][0] < box[p][0] / 2 + box[p][1] / 2 < box[p][1]),
            key=left,
            default=None,
        )


@dataclass(frozen=True, order=True)
class _Promise:
    """A box and its `top`, ordered: the largest first, no top before all others."""

    rank: tuple[int, Fraction, int]
    top: Any
    box: Any

    @staticmethod
    def of(top: Fraction | None, number: int, box: Box) -> _Promise:
        rank = (0, Fraction(0), number) if top is None else (1, -top, number)
        return _Promise(rank, top, box)


def needed(program: Program, actions: Sequence[str]) -> set[str]:
    """The actions whose earlier values the given ones depend on, and these."""
    bodies = dict(zip((a.name for a in program.interface.actions), program.bodies, strict=True))
    found: set[str] = set()
    waiting = list(actions)
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += [t.action for t in subterms(bodies[name]) if isinstance(t, PreviousAction)]
    return found


def _whole(program: Program, steps: int) -> Box:
    interface = program.interface
    box: Box = {}
    for sensor in interface.sensors:
        for i in range(interface.window + steps - 1):
            box[sensor.name, i] = finite_range(sensor)
    for action in interface.actions:
        if isinstance(action.domain, Continuous):
            box[action.name, -1] = (action.domain.lower, action.domain.upper)
    return box
