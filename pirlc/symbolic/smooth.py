"""A smoothed form of program templates, and objectives that gradient methods can go down on.

Only what depends on free parameters is smoothed. A comparison `a > b` becomes
`sigmoid((a - b) / (temperature * scale))` with a scale for each guard, truth values become
probabilities under product logic, `if` the mix of its branches, and a discrete action a probability
for each of its values. As the temperature goes to 0 this is the program itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from pirlc.ir.operators import COMPARISONS, Operator
from pirlc.ir.policy import ActionSpec, Choice, Continuous, ProgramTemplate
from pirlc.ir.types import Discrete, Type
from pirlc.semantics.histories import HistorySet
from pirlc.symbolic.blocks import Blocks, Blockwise, InputRows, blocks_of
from pirlc.symbolic.casadi_form import (
    ARITHMETIC,
    COMPARED,
    MX,
    Previous,
    Symbols,
    as_row,
    symbols_for,
)
from pirlc.symbolic.walk import Algebra, walk

FLOOR = 1e-3
"""The probability that cross-entropy shares out among a discrete action's values beforehand, so
that one wrong history costs at most about 7."""

MARGINS = 2**16
"""Histories on which guards are looked at, at most: their spread needs no more."""

CLIP_SOFTNESS = 0.1
"""How far, in ranges and for temperature 1, the smooth clip departs from the bounds."""


@dataclass(frozen=True)
class Distribution:
    """A discrete action: the probability of each value."""

    of: dict[int, MX]


def sigmoid(x: MX) -> MX:
    return 0.5 + 0.5 * ca.tanh(0.5 * x)


@dataclass
class SmoothSymbols(Symbols):
    """Adds the temperature, and a scale for each entry of `margins`."""

    temperature: MX = field(default_factory=lambda: ca.MX.sym("temperature"))
    scales: list[MX] = field(default_factory=list)

    def scaled(self, a: MX, b: MX) -> MX | None:
        """(a - b) / (temperature * scale), or None where no parameter can move a - b."""
        before = len(self.margins)
        difference = self.margin(a, b)
        if len(self.margins) == before:
            return None
        self.scales.append(ca.MX.sym(f"scale{len(self.scales)}"))
        return difference / (self.temperature * self.scales[-1])


def smooth_algebra(symbols: SmoothSymbols) -> Algebra[Any]:
    def compared(operator: Operator) -> Callable[[Any, Any], MX]:
        def comparison(a: Any, b: Any) -> MX:
            if isinstance(a, Distribution):
                same = sum((p * b.of[v] for v, p in a.of.items() if v in b.of), ca.MX(0.0))
                return same if operator is Operator.EQUAL else 1 - same
            scaled = symbols.scaled(a, b)
            if scaled is None:
                return COMPARED[operator](a, b)
            match operator:
                case Operator.GREATER | Operator.GREATER_EQUAL:
                    return sigmoid(scaled)
                case Operator.LESS | Operator.LESS_EQUAL:
                    return sigmoid(-scaled)
                case Operator.EQUAL:
                    return ca.exp(-scaled * scaled)
                case _:
                    return 1 - ca.exp(-scaled * scaled)

        return comparison

    def sign(x: MX) -> MX:
        scaled = symbols.scaled(x, ca.MX(0.0))
        return ca.sign(x) if scaled is None else ca.tanh(scaled)

    operators: dict[Operator, Callable[..., Any]] = {
        **ARITHMETIC,
        **{operator: compared(operator) for operator in COMPARISONS},
        Operator.SIGN: sign,
        Operator.NOT: lambda a: 1 - a,
        Operator.AND: lambda a, b: a * b,
        Operator.OR: lambda a, b: a + b - a * b,
        Operator.IMPLIES: lambda a, b: 1 - a + a * b,
    }

    def mixed(condition: MX, yes: MX, no: MX) -> MX:
        if not symbols.is_free(condition):
            return ca.if_else(condition, yes, no)
        return condition * yes + (1 - condition) * no

    def choose(condition: MX, yes: Any, no: Any) -> Any:
        if not isinstance(yes, Distribution):
            return mixed(condition, yes, no)
        values = sorted(yes.of.keys() | no.of.keys())
        zero = ca.MX(0.0)
        return Distribution(
            {v: mixed(condition, yes.of.get(v, zero), no.of.get(v, zero)) for v in values}
        )

    def discrete(value: int, type_: Discrete) -> Distribution:
        del type_
        return Distribution({value: ca.MX(1.0)})

    def previous(action: str, type_: Type) -> Any:
        row = symbols.input(Previous(action))
        if not isinstance(type_, Discrete):
            return row
        return Distribution({value: ca.eq(row, float(value)) for value in type_.values})

    return Algebra(
        literal=lambda value: ca.MX(value),
        discrete=discrete,
        parameter=symbols.parameter,
        element=symbols.element,
        previous=previous,
        operators=operators,
        choose=choose,
    )


class SmoothedObjective:
    """How badly a template fits an oracle's actions on N histories, and the gradient.

    For a continuous action the mean squared difference between the smoothly clipped result and the
    oracle's action, in units of the action's range; for a discrete one the mean cross-entropy of
    the oracle's value under the mixed probabilities. Several actions add up. `labels` (N, k) are in
    declaration order; `weights` (N,) default to 1 and count relative to their sum.

    Where the smoothed program is not finite, neither is the value. Not to be shared between
    threads.
    """

    def __init__(
        self,
        template: ProgramTemplate,
        histories: HistorySet,
        labels: NDArray[np.float64],
        weights: NDArray[np.float64] | None = None,
    ) -> None:
        blocks = blocks_of(len(histories))
        count = blocks.size
        plain = symbols_for(template, count)
        symbols = SmoothSymbols(count, plain.fixed, plain.names)
        algebra = smooth_algebra(symbols)
        specs = template.interface.actions
        targets = [ca.MX.sym(f"target{i}", 1, count) for i in range(len(specs))]
        share = ca.MX.sym("weights", 1, count)
        loss = ca.MX(0.0)
        for body, spec, target in zip(template.bodies, specs, targets, strict=True):
            error = _error(walk(body, algebra), spec, target, symbols.temperature)
            loss += ca.dot(as_row(error, count), share)
        self.names = symbols.names
        """The free parameters in the order of theta."""
        margins = [as_row(margin, count) for margin in symbols.margins]
        self._theta = np.zeros(len(self.names))
        self._temperature = np.ones(1)
        self._scales = np.ones(len(margins))
        even = np.ones(len(histories)) if weights is None else np.asarray(weights, np.float64)
        aims = [_clipped(labels[:, i], spec) for i, spec in enumerate(specs)]
        scale_symbol = ca.MX.sym("scales", len(margins))
        [loss] = ca.substitute(
            [loss], symbols.scales, [scale_symbol[i] for i in range(len(margins))]
        )
        inputs = symbols.used_in([loss])
        rows = inputs.values()
        self._objective = Blockwise(
            ca.Function(
                "objective",
                [symbols.theta, symbols.temperature, scale_symbol, share, *targets, *rows],
                [ca.densify(loss), ca.densify(ca.gradient(loss, symbols.theta))],
            ),
            [self._theta, self._temperature, self._scales],
            [blocks.shares(even / even.sum()), *(blocks.cut(aim) for aim in aims)],
            InputRows(tuple(inputs), histories, blocks),
            blocks,
        )
        chosen = _evenly(len(histories), count)
        looked_at = blocks if chosen is None else Blocks(count, tuple(range(0, len(chosen), count)))
        guards = symbols.used_in(margins)
        self._margins = Blockwise(
            ca.Function(
                "margins",
                [symbols.theta, *guards.values()],
                [ca.vertcat(ca.MX(0, count), *margins)],
            ),
            [self._theta],
            [],
            InputRows(tuple(guards), histories, looked_at, chosen),
            looked_at,
        )
        self._looked_at = looked_at
        self._size_of_margins = (
            len(margins),
            len(histories) if chosen is None else len(chosen),
        )

    def __call__(
        self, theta: NDArray[np.float64], temperature: float
    ) -> tuple[float, NDArray[np.float64]]:
        """Value and gradient (P,) at parameters theta (P,), under the scales last set."""
        self._theta[:] = theta
        self._temperature[0] = temperature
        total, slope = 0.0, np.zeros(len(self.names))
        for value, gradient in self._objective():
            total += float(value[0, 0])
            slope += gradient[:, 0]
        return total, slope

    def margins(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        """The differences behind the guards, (G, N).

        They serve to tell how far a guard's margins spread. Of more than `MARGINS` histories only
        about so many are looked at, evenly spaced.
        """
        self._theta[:] = theta
        found = np.empty(self._size_of_margins)
        blocks = self._looked_at
        for begin, (margins,) in zip(blocks.begins, self._margins(), strict=True):
            found[:, begin : begin + blocks.size] = margins
        return found

    def scales_at(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        """The spread of each guard's margin over the histories, (G,); 1 where it has none."""
        margins = self.margins(theta)
        spread = margins.std(axis=1) if margins.size else np.zeros(len(margins))
        return np.where(np.isfinite(spread) & (spread > 0.0), spread, 1.0)

    def set_scales(self, scales: NDArray[np.float64]) -> None:
        self._scales[:] = scales


def _evenly(count: int, size: int) -> NDArray[np.intp] | None:
    """Whole blocks' worth of histories, `MARGINS` at most; None: all of them."""
    if count <= MARGINS:
        return None
    looked_at = MARGINS // size * size
    return np.arange(looked_at, dtype=np.intp) * count // looked_at


def _error(result: Any, spec: ActionSpec, target: MX, temperature: MX) -> MX:
    match spec.domain:
        case Continuous(lower, upper):
            softness = CLIP_SOFTNESS * temperature * (upper - lower)
            clipped = (
                result
                + softness * _softplus((lower - result) / softness)
                - softness * _softplus((result - upper) / softness)
            )
            error = (clipped - target) / (upper - lower)
            return error * error
        case Choice(values):
            right = sum((p * ca.eq(target, float(v)) for v, p in result.of.items()), ca.MX(0.0))
            return -ca.log((1 - FLOOR) * right + FLOOR / len(values))


def _softplus(x: MX) -> MX:
    return ca.fmax(x, 0.0) + ca.log1p(ca.exp(-ca.fabs(x)))


def _clipped(labels: NDArray[np.float64], spec: ActionSpec) -> NDArray[np.float64]:
    match spec.domain:
        case Continuous(lower, upper):
            return np.clip(labels, lower, upper).astype(np.float64)
        case Choice():
            return np.ascontiguousarray(labels, dtype=np.float64)
