"""A program template evaluated over many histories at once.

Agrees bit for bit with the interpreter, in both precisions, wherever no `exp` or `tanh` is
involved (numpy's differ from libm's in the last places). Works through the histories in blocks that
stay in the cache; what is compiled once serves any number of parameter vectors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pirlc.ir.operators import Operator
from pirlc.ir.policy import ActionSpec, Choice, Continuous, Program, ProgramTemplate
from pirlc.semantics.histories import HistorySet, Layout, dtype_of
from pirlc.semantics.interpreter import SAFE_USED
from pirlc.semantics.plan import (
    Code,
    Constant,
    Number,
    Operation,
    ParameterValue,
    PreviousActions,
    Select,
    SensorReadings,
    compile_code,
)
from pirlc.semantics.precision import BINARY64, Precision

Array = NDArray[np.generic]
Kernel = Callable[..., object]
"""A kernel takes its operands, then the array for the result."""

BLOCK = 8192
"""Histories worked on at a time: a block of binary64 numbers is half of a first-level cache."""


@dataclass(frozen=True, eq=False)
class Applied:
    """`actions` (N, k) in declaration order, binary64; `status` (N,) with the bits of a step."""

    actions: NDArray[np.float64]
    status: NDArray[np.uint8]


class Plan:
    """A compiled template for one precision and layout. Not to be shared between threads."""

    def __init__(self, code: Code, precision: Precision, layout: Layout) -> None:
        self.code = code
        self.precision = precision
        self.layout = layout
        self._singles = [
            np.zeros((), _dtype(r.number, precision)) if r.single else None for r in code.registers
        ]
        for register, single in zip(code.registers, self._singles, strict=True):
            if isinstance(register.source, Constant):
                assert single is not None
                with np.errstate(over="ignore"):
                    single[...] = register.source.value
        self._workspace: _Workspace | None = None

    def run(self, values: Mapping[str, float], histories: HistorySet) -> NDArray[np.float64]:
        """The raw results (N, k) in declaration order; `values` of the free parameters.

        Results of binary32 are widened. The array is laid out action by action.
        """
        assert (histories.precision, histories.layout) == (self.precision, self.layout)
        raw = np.empty((len(self.code.outputs), histories.extent))
        with np.errstate(all="ignore"):
            for register, single in zip(self.code.registers, self._singles, strict=True):
                if isinstance(register.source, ParameterValue):
                    assert single is not None
                    single[...] = values[register.source.name]
            for instruction in self.code.prelude:
                operands = [self._singles[operand.register] for operand in instruction.operands]
                KERNELS[instruction.operation](*operands, self._singles[instruction.result])
            self._run_blocks(histories, raw)
        if histories.dense:
            return raw.T
        kept = np.empty((len(raw), len(histories)))
        for row, out in zip(raw, kept, strict=True):
            np.take(row, histories.places, out=out, mode="clip")
        return kept.T

    def _run_blocks(self, histories: HistorySet, raw: NDArray[np.float64]) -> None:
        extent = histories.extent
        if not extent:
            return
        blocks = -(-extent // BLOCK)
        size = -(-extent // blocks)
        workspace = self._workspace
        if workspace is None or workspace.size != size:
            workspace = self._workspace = _Workspace(self.code, self._singles, self.precision, size)
        for block in range(blocks):
            # The last block overlaps the one before rather than being shorter.
            begin = min(block * size, extent - size)
            workspace.look_at(histories, begin)
            for kernel, arguments in workspace.calls:
                kernel(*arguments)
            for row, output in zip(raw, workspace.outputs, strict=True):
                row[begin : begin + size] = output[0]


def _dtype(number: Number, precision: Precision) -> np.dtype[np.generic]:
    match number:
        case Number.REAL:
            return np.dtype(dtype_of(precision))
        case Number.DISCRETE:
            return np.dtype(np.float64)
        case Number.BOOL:
            return np.dtype(np.bool_)


class _Workspace:
    """The arrays for blocks of one size, and the calls bound to them."""

    def __init__(
        self, code: Code, singles: Sequence[Array | None], precision: Precision, size: int
    ) -> None:
        self.size = size
        buffers = _assign_buffers(code, precision, size)
        self._inputs: list[tuple[list[Array], int, SensorReadings | PreviousActions, int, int]] = []
        self._seen: tuple[HistorySet, int] | None = None

        def view(arguments: list[Array], register: int, offset: int, extra: int) -> None:
            single, source = singles[register], code.registers[register].source
            if single is not None:
                arguments.append(single)
            elif isinstance(source, SensorReadings | PreviousActions):
                self._inputs.append((arguments, len(arguments), source, offset, size + extra))
                arguments.append(np.empty(0))
            else:
                arguments.append(buffers[register][offset : offset + size + extra])

        self.calls: list[tuple[Kernel, list[Array]]] = []
        for instruction in code.body:
            arguments: list[Array] = []
            extra = code.registers[instruction.result].extra
            for operand in instruction.operands:
                view(arguments, operand.register, operand.offset, extra)
            view(arguments, instruction.result, 0, extra)
            self.calls.append((KERNELS[instruction.operation], arguments))
        self.outputs: list[list[Array]] = []
        for output in code.outputs:
            result: list[Array] = []
            view(result, output.register, output.offset, 0)
            self.outputs.append(result)

    def look_at(self, histories: HistorySet, begin: int) -> None:
        """Points the arguments that are inputs at the block that begins at this place."""
        if self._seen is not None and self._seen[0] is histories and self._seen[1] == begin:
            return
        self._seen = (histories, begin)
        for arguments, position, source, offset, length in self._inputs:
            match source:
                case SensorReadings(name, None):
                    array = histories.sensors[name]
                case SensorReadings(name, row):
                    array = histories.sensors[name][row]
                case PreviousActions(name):
                    array = histories.previous[name]
            start = begin + offset
            arguments[position] = array[start : start + length]


def _assign_buffers(code: Code, precision: Precision, size: int) -> dict[int, Array]:
    """A buffer for each computed register; registers whose lives do not overlap share one."""
    last_use = {output.register: len(code.body) for output in code.outputs}
    for position, instruction in enumerate(code.body):
        for operand in instruction.operands:
            last_use[operand.register] = max(last_use.get(operand.register, 0), position)
    buffers: dict[int, Array] = {}
    spare: dict[tuple[np.dtype[np.generic], int], list[Array]] = {}
    for position, instruction in enumerate(code.body):
        register = code.registers[instruction.result]
        shape = (_dtype(register.number, precision), register.extra)
        free = spare.setdefault(shape, [])
        # Taken before the operands are given back: an operation never overwrites its own operand
        # at another offset.
        buffers[instruction.result] = (
            free.pop() if free else np.zeros(size + register.extra, shape[0])
        )
        for ended in {operand.register for operand in instruction.operands}:
            if ended in buffers and last_use[ended] == position:
                old = code.registers[ended]
                spare.setdefault((_dtype(old.number, precision), old.extra), []).append(
                    buffers[ended]
                )
    return buffers


def compile_plan(
    template: ProgramTemplate | Program,
    precision: Precision = BINARY64,
    layout: Layout = Layout.FLAT,
) -> Plan:
    """Compiles a template or program for history sets of this precision and layout."""
    return Plan(compile_code(template, layout), precision, layout)


def evaluate(
    template: ProgramTemplate | Program, values: Mapping[str, float], histories: HistorySet
) -> NDArray[np.float64]:
    """The raw results (N, k); compile a plan instead to evaluate a template more than once."""
    return compile_plan(template, histories.precision, histories.layout).run(values, histories)


def apply_actions(raw: NDArray[np.float64], histories: HistorySet) -> Applied:
    """What leaves the controller for raw results (N, k): clipped, or safe."""
    failed = histories.of_histories(histories.failed)
    any_failed = bool(failed.any())
    actions = np.empty((raw.shape[1], raw.shape[0]))
    safe_used = failed.copy()
    for column, spec in enumerate(histories.interface.actions):
        out = actions[column]
        missing = applied(raw[:, column], spec, histories.precision, out)
        if missing is not None:
            safe_used |= missing
        if any_failed:
            out[failed] = safe_value(spec, histories.precision)
    status = histories.of_histories(histories.status) | np.where(safe_used, SAFE_USED, 0)
    return Applied(actions.T, status.astype(np.uint8))


def safe_value(spec: ActionSpec, precision: Precision) -> float:
    return precision.round(spec.safe) if isinstance(spec.domain, Continuous) else spec.safe


def applied(
    raw: NDArray[np.float64],
    spec: ActionSpec,
    precision: Precision,
    out: NDArray[np.float64],
) -> NDArray[np.bool_] | None:
    """Clips one action's raw results into `out`; NaN gives the safe value.

    Returns where that was so, or None where there was none.
    """
    match spec.domain:
        case Choice():
            out[...] = raw
            return None
        case Continuous(low, high):
            lower, upper = precision.round(low), precision.round(high)
            np.clip(raw, lower, upper, out=out)
            if lower == 0.0 or upper == 0.0:
                # A zero inside the bounds keeps its sign, which `np.clip` does not promise.
                zeros = raw == 0.0
                if zeros.any():
                    out[zeros] = raw[zeros]
            nan = np.isnan(out)
            if not nan.any():
                return None
            out[nan] = safe_value(spec, precision)
            return nan


def distances(
    actions: NDArray[np.float64], labels: NDArray[np.float64], specs: Sequence[ActionSpec]
) -> NDArray[np.float64]:
    """How far applied actions (N, k) are from the oracle's (N, k), for each history (N,).

    Both are in declaration order; the oracle's are clipped to the actions' ranges first. The
    Euclidean norm of the differences, each divided by its action's range; a discrete action
    counts 1 where it disagrees.
    """
    squares = np.zeros(len(actions))
    for column, spec in enumerate(specs):
        ours, theirs = actions[:, column], labels[:, column]
        match spec.domain:
            case Choice():
                squares += ours != theirs
            case Continuous(lower, upper):
                difference = ours - np.clip(theirs, lower, upper)
                difference /= upper - lower
                if len(specs) == 1:
                    return np.abs(difference)
                difference *= difference
                squares += difference
    return squares if _all_discrete_single(specs) else np.sqrt(squares)


def _all_discrete_single(specs: Sequence[ActionSpec]) -> bool:
    return len(specs) == 1 and isinstance(specs[0].domain, Choice)


def distance(
    actions: NDArray[np.float64], labels: NDArray[np.float64], specs: Sequence[ActionSpec]
) -> float:
    """The mean of `distances`: for one discrete action, the share of histories it disagrees on."""
    return float(distances(actions, labels, specs).mean())


def _select(condition: Array, consequent: Array, alternative: Array, out: Array) -> None:
    np.copyto(out, np.where(condition, consequent, alternative))


def _min(a: Array, b: Array, out: Array) -> None:
    np.copyto(out, np.where(np.less(a, b), a, b))


def _max(a: Array, b: Array, out: Array) -> None:
    np.copyto(out, np.where(np.greater(a, b), a, b))


def _clip(x: Array, low: Array, high: Array, out: Array) -> None:
    above = np.where(np.greater(x, high), high, x)
    np.copyto(out, np.where(np.less(x, low), low, above))


def _through_binary64(function: np.ufunc) -> Kernel:
    """Computed in binary64 and rounded, as the interpreter does it."""

    def kernel(x: Array, out: Array) -> None:
        np.copyto(out, function(x.astype(np.float64)), casting="same_kind")

    return kernel


KERNELS: dict[Operation, Kernel] = {
    Select.SELECT: _select,
    Operator.IMPLIES: np.less_equal,
    Operator.OR: np.logical_or,
    Operator.AND: np.logical_and,
    Operator.NOT: np.logical_not,
    Operator.LESS: np.less,
    Operator.LESS_EQUAL: np.less_equal,
    Operator.GREATER: np.greater,
    Operator.GREATER_EQUAL: np.greater_equal,
    Operator.EQUAL: np.equal,
    Operator.NOT_EQUAL: np.not_equal,
    Operator.ADD: np.add,
    Operator.SUBTRACT: np.subtract,
    Operator.MULTIPLY: np.multiply,
    Operator.DIVIDE: np.divide,
    Operator.NEGATE: np.negative,
    Operator.ABS: np.absolute,
    Operator.MIN: _min,
    Operator.MAX: _max,
    Operator.CLIP: _clip,
    Operator.SQRT: np.sqrt,
    Operator.EXP: _through_binary64(np.exp),
    Operator.TANH: _through_binary64(np.tanh),
    Operator.SIGN: np.sign,
}
"""`implies` on truth values is `<=`."""
