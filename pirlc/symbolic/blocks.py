"""Histories taken some thousands at a time, so that a symbolic form holds no more than a block.

A CasADi function over N histories keeps every value of its expression for all of them, and wants
each element of each window as a row of its own. Over blocks of one size it is made once, for that
size, and what it needs besides the histories themselves does not grow with them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirlc.semantics.histories import HistorySet, Layout
from pirlc.symbolic.casadi_form import BoundFunction, Element, Input, row_of

BLOCK = 4096
"""Histories in a block at most: the sample that a search tunes on is one."""

KEPT = 2**28
"""Bytes of rows that are kept; where there are more, each block's are gathered when needed."""


@dataclass(frozen=True)
class Blocks:
    """`begins[i]` is the first of `size` histories; the last block overlaps the one before."""

    size: int
    begins: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.begins)

    def cut(self, values: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """The values (N,) of each block (size,): views."""
        return [values[begin : begin + self.size] for begin in self.begins]

    def shares(self, weights: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """As `cut`, but each history counts in one block only: in others its weight is 0."""
        shares = self.cut(weights)
        overlap = (len(self) - 1) * self.size - self.begins[-1]
        if overlap:
            shares[-1] = shares[-1].copy()
            shares[-1][:overlap] = 0.0
        return shares


def blocks_of(count: int) -> Blocks:
    """As few blocks of one size, `BLOCK` at most, as `count` histories need."""
    number = max(1, -(-count // BLOCK))
    size = -(-count // number)
    return Blocks(size, tuple(min(i * size, count - size) for i in range(number)))


class InputRows:
    """The numbers of some inputs in each block, for all histories or those that are `chosen`."""

    def __init__(
        self,
        inputs: Sequence[Input],
        histories: HistorySet,
        blocks: Blocks,
        chosen: NDArray[np.intp] | None = None,
    ) -> None:
        self._inputs = tuple(inputs)
        self._histories = histories
        self._blocks = blocks
        self._places = histories.places if chosen is None else histories.places[chosen]
        self._kept: list[list[NDArray[np.float64]]] | None = None
        copied = 8 * len(self._places) * len(inputs)
        if chosen is None and (len(blocks) == 1 or copied <= KEPT):
            self._kept = [blocks.cut(row_of(which, histories)) for which in inputs]
        else:
            self._buffers = np.empty((len(inputs), blocks.size))

    def block(self, number: int) -> list[NDArray[np.float64]]:
        """A row (size,) for each input; what was returned before may be overwritten."""
        if self._kept is not None:
            return [rows[number] for rows in self._kept]
        begin = self._blocks.begins[number]
        places = self._places[begin : begin + self._blocks.size]
        for which, buffer in zip(self._inputs, self._buffers, strict=True):
            readings = _readings(which, self._histories)
            if readings.dtype == buffer.dtype:
                np.take(readings, places, out=buffer, mode="clip")
            else:
                buffer[:] = readings[places]
        return list(self._buffers)


def _readings(which: Input, histories: HistorySet) -> NDArray[np.floating]:
    """An input at every place of the set, (M,) or longer."""
    if not isinstance(which, Element):
        return histories.previous[which.action]
    row = histories.interface.window + which.index
    match histories.layout:
        case Layout.FLAT:
            return histories.sensors[which.sensor][row:]
        case Layout.GATHERED:
            readings: NDArray[np.floating] = histories.sensors[which.sensor][row]
            return readings


class Blockwise:
    """A CasADi function of one block, called for one block after the other.

    Its arguments are the `fixed` arrays, which may be written into between two runs, one of each of
    the `cut` ones, and the rows of inputs.
    """

    def __init__(
        self,
        function: Any,
        fixed: Sequence[NDArray[np.float64]],
        cut: Sequence[list[NDArray[np.float64]]],
        rows: InputRows,
        blocks: Blocks,
    ) -> None:
        self._cut = cut
        self._rows = rows
        self._count = len(blocks)
        self._first = len(fixed)
        self._function = BoundFunction(function, [*fixed, *self._arguments(0)])

    def __call__(self) -> Iterator[list[NDArray[np.float64]]]:
        """The results for each block, which the next block's overwrite."""
        for number in range(self._count):
            if self._count > 1:
                self._function.bind(self._first, self._arguments(number))
            yield self._function()

    def _arguments(self, number: int) -> list[NDArray[np.float64]]:
        return [*(pieces[number] for pieces in self._cut), *self._rows.block(number)]
