"""Which parameters a template is affine in, given the others, and its design matrix.

A PID leaf `kp * (r - y) + ...` is affine in kp, ki, kd for a given setpoint r; a program whose
guards are given is affine in the parameters of its leaves. Such parameters need no search: they
solve a least-squares problem.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from pirlc.ir.policy import Continuous, ProgramTemplate
from pirlc.semantics.histories import HistorySet
from pirlc.symbolic.blocks import Blockwise, InputRows, blocks_of
from pirlc.symbolic.casadi_form import as_row, hard_algebra, symbols_for
from pirlc.symbolic.walk import walk


@dataclass(frozen=True)
class AffineSplit:
    """The raw results of the continuous actions are jointly affine in `linear`, given `others`.

    Every free parameter is in one of the two, in the template's order.
    """

    linear: tuple[str, ...]
    others: tuple[str, ...]


def affine_split(template: ProgramTemplate) -> AffineSplit:
    """A large set of parameters that the real results are affine in once the others are given.

    Parameters that move a guard are never linear. From each product of two parameters one is left
    out: first the one that meets the most others.
    """
    symbols = symbols_for(template, 1)
    algebra = hard_algebra(symbols)
    results = [walk(body, algebra) for body in template.bodies]
    raw = [
        result
        for result, spec in zip(results, template.interface.actions, strict=True)
        if isinstance(spec.domain, Continuous)
    ]
    count = len(symbols.names)
    guards = ca.vertcat(ca.MX(0, 1), *symbols.margins)
    barred = {i for i, moves in enumerate(_depends(guards, symbols.theta, count)) if moves}
    # clash[i] holds j where the derivative by parameter i still depends on parameter j.
    clash: dict[int, set[int]] = {i: set() for i in range(count)}
    if raw:
        jacobian = ca.jacobian(ca.vertcat(*raw), symbols.theta)
        for i in range(count):
            for j, depends in enumerate(_depends(jacobian[:, i], symbols.theta, count)):
                if depends:
                    clash[i].add(j)
                    clash[j].add(i)
    barred |= {i for i in range(count) if i in clash[i]}
    linear = set(range(count)) - barred
    while True:
        degree = {i: len(clash[i] & linear) for i in linear}
        worst = max(sorted(linear), key=lambda i: degree[i], default=None)
        if worst is None or not degree[worst]:
            break
        linear.discard(worst)
    return AffineSplit(
        tuple(name for i, name in enumerate(symbols.names) if i in linear),
        tuple(name for i, name in enumerate(symbols.names) if i not in linear),
    )


def _depends(expression: ca.MX, theta: ca.MX, count: int) -> list[bool]:
    if not count or not expression.numel():
        return [False] * count
    return [bool(flag) for flag in ca.which_depends(ca.densify(expression), theta, 1, False)]


@dataclass(frozen=True)
class Design:
    """One action's raw results as `matrix @ linear + offset`: (N, P) and (N,)."""

    matrix: NDArray[np.float64]
    offset: NDArray[np.float64]


class DesignMatrices:
    """The design matrices of a template's continuous actions over a history set."""

    def __init__(
        self, template: ProgramTemplate, split: AffineSplit, histories: HistorySet
    ) -> None:
        self._blocks = blocks_of(len(histories))
        self._count = len(histories)
        count = self._blocks.size
        symbols = symbols_for(template, count)
        algebra = hard_algebra(symbols)
        self.split = split
        self.actions = tuple(
            i
            for i, spec in enumerate(template.interface.actions)
            if isinstance(spec.domain, Continuous)
        )
        """The numbers of the continuous actions, in declaration order."""
        outputs = []
        for i in self.actions:
            raw = as_row(walk(template.bodies[i], algebra), count)
            outputs.append(raw)
            for name in split.linear:
                direction = ca.DM.zeros(len(symbols.names))
                direction[symbols.names.index(name)] = 1.0
                outputs.append(ca.densify(ca.jtimes(raw, symbols.theta, direction)))
        self._position = {name: i for i, name in enumerate(symbols.names)}
        self._theta = np.zeros(len(symbols.names))
        inputs = symbols.used_in(outputs)
        self._function = Blockwise(
            ca.Function("design", [symbols.theta, *inputs.values()], outputs),
            [self._theta],
            [],
            InputRows(tuple(inputs), histories, self._blocks),
            self._blocks,
        )

    def __call__(self, others: Mapping[str, float]) -> list[Design]:
        """One `Design` for each of `actions`, given the values of the other parameters."""
        self._set(others)
        width = 1 + len(self.split.linear)
        rows = np.empty((len(self.actions) * width, self._count))
        for begin, results in zip(self._blocks.begins, self._function(), strict=True):
            for row, result in zip(rows, results, strict=True):
                row[begin : begin + self._blocks.size] = result[0]
        return _designs(list(rows), width)

    @property
    def pieces(self) -> int:
        """How many `in_blocks` gives."""
        return len(self._blocks)

    def in_blocks(self, others: Mapping[str, float]) -> Iterator[tuple[int, list[Design]]]:
        """The same in pieces, each with its first history; every history is in one piece."""
        self._set(others)
        width = 1 + len(self.split.linear)
        done = 0
        for begin, results in zip(self._blocks.begins, self._function(), strict=True):
            yield done, _designs([result[0][done - begin :] for result in results], width)
            done = begin + self._blocks.size

    def _set(self, others: Mapping[str, float]) -> None:
        self._theta[:] = 0.0
        for name in self.split.others:
            self._theta[self._position[name]] = others[name]


def _designs(rows: Sequence[NDArray[np.float64]], width: int) -> list[Design]:
    """For each action the row of the offset, and those of the parameters."""
    return [
        Design(
            matrix=np.concatenate([np.zeros((0, len(rows[0]))), rows[i + 1 : i + width]]).T,
            offset=rows[i].copy(),
        )
        for i in range(0, len(rows), width)
    ]
