"""One MaxSMT question to z3: anytime, under a limit, in linear real arithmetic.

Coefficients are rounded to a hundredth and less of what they reach, as small integers: z3's exact
sums are as slow as its numbers are long. A guard has to be clear of zero by a margin, so that
rounding does not turn it over. What the answer is worth, the program itself tells.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import z3

from pirlc.symbolic import z3_terms as exact
from pirlc.tune.maxsmt.groups import Chosen
from pirlc.tune.maxsmt.piecewise import Both, Guard, Known, Not, Truth
from pirlc.tune.maxsmt.regions import Box, Vector, at

LEVELS = 128
"""A coefficient of a parameter is one of so many integers, with either sign."""

_FINEST = 2.0**-12
"""What a guard is rounded to, as a part of what it reaches."""


@dataclass(frozen=True)
class Answer:
    """Parameters (P,) of the models, each better than the one before, and what they took."""

    models: list[Vector]
    effort: int


def solve(
    truth: Truth,
    guards: Sequence[Guard],
    chosen: Chosen,
    box: Box,
    margin: float,
    effort: int,
    seconds: float | None,
) -> Answer:
    """Parameters in the box that satisfy the formula in many of the chosen histories, by weight.

    `margin` is a part of what each guard reaches over the histories. z3 spends `effort` of its own
    units, and at most `seconds` if given.
    """
    context = z3.Context()
    question = _Question(guards, box, margin, context)
    optimiser = z3.Optimize(ctx=context)
    optimiser.add(*question.bounds())
    asked = 0
    for i, weight in zip(chosen.numbers.tolist(), chosen.weights.tolist(), strict=True):
        formula = question.at(truth, i)
        if not isinstance(formula, bool):
            optimiser.add_soft(formula, weight=weight)
            asked += 1
    if not asked:
        return Answer([], 0)
    models: list[Vector] = []
    optimiser.set_on_model(lambda model: models.append(question.read(model)))
    optimiser.set("rlimit", max(1, effort))
    if seconds is not None:
        optimiser.set("timeout", max(1, math.ceil(seconds * 1000.0)))
    try:
        if optimiser.check() == z3.sat:
            models.append(question.read(optimiser.model()))
    except z3.Z3Exception:
        # A limit that is reached at some places of z3 is told like this.
        return Answer(models, effort)
    return Answer(models, _spent(optimiser, effort))


def _spent(optimiser: Any, effort: int) -> int:
    found = optimiser.statistics()
    counted = [found.get_key_value(key) for key in found.keys() if key == "rlimit count"]  # noqa: SIM118
    return int(counted[0]) if counted else effort


class _Question:
    """Variables y = (parameter - centre) * unit, one for each parameter that guards depend on."""

    def __init__(
        self, guards: Sequence[Guard], box: Box, margin: float, context: z3.Context
    ) -> None:
        self._box, self._context = box, context
        largest: dict[int, float] = {}
        for guard in guards:
            for j, slope in guard.left.slopes.items():
                largest[j] = max(largest.get(j, 0.0), _largest(slope))
        self._units = {j: _dyadic(size / LEVELS) for j, size in sorted(largest.items()) if size}
        self._variables = {j: z3.Real(f"y{j}", context) for j in self._units}
        self._rows = {id(guard): self._row(guard, margin) for guard in guards}

    def _row(self, guard: Guard, margin: float) -> tuple[dict[int, Any], Vector, float, Fraction]:
        """Integer coefficients, the values at the centre, what those are rounded to, the margin."""
        here = at(guard.left, self._box.centre)
        half = (self._box.upper - self._box.lower) / 2.0
        spreads = [float(np.std(slope)) * half[j] for j, slope in guard.left.slopes.items()]
        telling = [spread for spread in (float(np.std(here)), *spreads) if spread > 0.0]
        # What tells histories apart may be small beside what shifts them all.
        reach = min(telling, default=1.0)
        whole = {
            j: np.rint(slope / self._units[j]).astype(np.int64)
            for j, slope in guard.left.slopes.items()
            if j in self._units
        }
        return whole, here, _dyadic(reach * _FINEST), Fraction(_dyadic(reach * margin))

    def bounds(self) -> list[Any]:
        found = []
        for j, y in self._variables.items():
            unit, centre = Fraction(self._units[j]), Fraction(float(self._box.centre[j]))
            lower = (Fraction(float(self._box.lower[j])) - centre) * unit
            upper = (Fraction(float(self._box.upper[j])) - centre) * unit
            found.append(y >= exact.number(lower, self._context))
            found.append(y <= exact.number(upper, self._context))
        return found

    def at(self, truth: Truth, i: int) -> Any:
        """The formula in history i: a bool, or z3's."""
        made: dict[tuple[int, bool], Any] = {}

        def go(t: Truth, wanted: bool) -> Any:
            key = (id(t), wanted)
            if key not in made:
                made[key] = make(t, wanted)
            return made[key]

        def make(t: Truth, wanted: bool) -> Any:
            match t:
                case Known(values):
                    return bool(values[i % len(values)]) == wanted
                case Not(of):
                    return go(of, not wanted)
                case Both(a, b):
                    join = exact.conjunction if wanted else exact.disjunction
                    return join((go(a, wanted), go(b, wanted)))
                case Guard():
                    return self._guard(t, i, wanted)

        return go(truth, True)

    def _guard(self, guard: Guard, i: int, wanted: bool) -> Any:
        coefficients, here, finest, margin = self._rows[id(guard)]
        value = float(here[i % len(here)])
        terms = [
            (int(column[i % len(column)]), self._variables[j])
            for j, column in coefficients.items()
            if column[i % len(column)]
        ]
        if not terms:
            return (value >= 0.0 if guard.at_zero else value > 0.0) == wanted
        constant = Fraction(finest) * round(value / finest)
        total = z3.Sum([coefficient * y for coefficient, y in terms])
        if wanted:
            return total >= exact.number(margin - constant, self._context)
        return total <= exact.number(-margin - constant, self._context)

    def read(self, model: Any) -> Vector:
        theta = self._box.centre.copy()
        for j, y in self._variables.items():
            value = model.eval(y, model_completion=True)
            theta[j] += float(exact.fraction(value)) / self._units[j]
        return np.clip(theta, self._box.lower, self._box.upper)


def _largest(column: Vector) -> float:
    finite = np.abs(column[np.isfinite(column)])
    return float(finite.max()) if len(finite) else 0.0


def _dyadic(x: float) -> float:
    """The power of two at or below x; 1 where there is none."""
    if not (np.isfinite(x) and x > 0.0):
        return 1.0
    return float(2.0 ** max(-300, min(300, math.floor(math.log2(x)))))
