"""Sets of histories: what a program saw at every step of some trajectories.

A history is the windows, the previous actions and the status that a program meets at one step. A
`HistorySet` keeps them as views of the trajectories, not as copies a window long: the readings of
a sensor lie in one flat array, each trajectory preceded by its warm-up, so that element `j` of
*every* history's window is one contiguous slice of that array. (The last `window - 1` places of a
trajectory start no history; evaluation passes over them and drops their results.)

A sample of single histories has nothing to share; it is gathered instead into an array of one row
for each element of the window. A selection that would grow too large by that stays a view.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pirlc.ir.policy import ActionSpec, Choice, Fill, Hold, Interface, Sensor
from pirlc.semantics.interpreter import MISSING, OUT_OF_RANGE
from pirlc.semantics.precision import BINARY64, Precision, middle, widened

FloatArray = NDArray[np.floating]
ScalarType = TypeVar("ScalarType", bound=np.generic)


class Layout(Enum):
    """How the windows of a set lie in memory."""

    FLAT = "flat"
    """Sensor arrays of shape (M + window - 1,); element j of the histories is `[j : j + M]`."""
    GATHERED = "gathered"
    """Sensor arrays of shape (window, M); element j of the histories is row j."""


GATHERED_BYTES = 2**28
"""The most that `HistorySet.select` gathers: a sample as large as 4,000 histories of 64 sensors
over a window of 64 takes half of it."""


def dtype_of(precision: Precision) -> np.dtype[np.floating]:
    match precision:
        case Precision.BINARY64:
            return np.dtype(np.float64)
        case Precision.BINARY32:
            return np.dtype(np.float32)


def _dtype_of_action(action: ActionSpec, precision: Precision) -> np.dtype[np.floating]:
    """Discrete values are exact integers in either precision."""
    return np.dtype(np.float64) if isinstance(action.domain, Choice) else dtype_of(precision)


@dataclass(frozen=True, eq=False)
class HistorySet:
    """An immutable set of N histories, laid out over M >= N places.

    `places` (N,) are the places of the histories, in their order; at the other places are gaps
    between trajectories, and histories of a larger set that were not selected. `sensors` are
    arrays in the working precision (see `Layout`), missing readings replaced as each sensor's
    declaration says; `previous` (M,) is the applied action of the step before, in the working
    precision for a continuous action and in binary64 for a discrete one. `status` (M,) has the
    bits of the readings (missing, outside the range); `failed` (M,) tells where a staleness limit
    makes every action take its safe value.
    """

    interface: Interface
    precision: Precision
    layout: Layout
    sensors: Mapping[str, FloatArray]
    previous: Mapping[str, FloatArray]
    status: NDArray[np.uint8]
    failed: NDArray[np.bool_]
    places: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.places)

    @property
    def extent(self) -> int:
        """M, the number of places that evaluation passes over."""
        return len(self.status)

    @cached_property
    def dense(self) -> bool:
        """Whether the histories are the places, one after the other."""
        return len(self.places) == len(self.status) and bool(
            np.array_equal(self.places, np.arange(len(self.places)))
        )

    def of_histories(self, at_places: NDArray[ScalarType]) -> NDArray[ScalarType]:
        """Values (M, ...) at places -> values (N, ...) of the histories."""
        if self.dense:
            return at_places
        chosen: NDArray[ScalarType] = at_places[self.places]
        return chosen

    def element(self, sensor: str, index: int) -> FloatArray:
        """An element of every history's window (N,): index -1 is the newest reading."""
        readings = self.sensors[sensor]
        place = self.interface.window + index
        match self.layout:
            case Layout.FLAT:
                return self.of_histories(readings[place : place + self.extent])
            case Layout.GATHERED:
                return self.of_histories(readings[place])

    def window(self, sensor: str) -> FloatArray:
        """The windows of a sensor, (N, window), oldest reading first: a copy, for looking."""
        readings = self.sensors[sensor]
        length = self.interface.window
        match self.layout:
            case Layout.FLAT:
                windows: FloatArray = readings[self.places[:, None] + np.arange(length)]
                return windows
            case Layout.GATHERED:
                return readings[:, self.places].T

    def select(self, indices: ArrayLike) -> HistorySet:
        """The histories with these numbers (0..N-1), in this order.

        Gathered, if that takes no more than `GATHERED_BYTES`. Otherwise the windows stay where they
        are, and evaluation passes over the whole set: such a selection is a large part of it.
        """
        chosen = self.places[np.asarray(indices, dtype=np.intp)]
        length = self.interface.window
        width = len(self.sensors) * length * dtype_of(self.precision).itemsize
        if self.layout is Layout.FLAT and len(chosen) * width > GATHERED_BYTES:
            return replace(self, places=_locked(chosen))
        sensors: dict[str, FloatArray] = {}
        for name, readings in self.sensors.items():
            match self.layout:
                case Layout.FLAT:
                    rows = sensors[name] = np.empty((length, len(chosen)), readings.dtype)
                    for j, row in enumerate(rows):
                        np.take(readings[j:], chosen, out=row, mode="clip")
                case Layout.GATHERED:
                    sensors[name] = readings[:, chosen]
        return HistorySet(
            interface=self.interface,
            precision=self.precision,
            layout=Layout.GATHERED,
            sensors=_frozen(sensors),
            previous=_frozen({name: values[chosen] for name, values in self.previous.items()}),
            status=_locked(self.status[chosen]),
            failed=_locked(self.failed[chosen]),
            places=_locked(np.arange(len(chosen), dtype=np.intp)),
        )

    def sample(self, count: int, seed: int) -> HistorySet:
        """`count` histories chosen evenly at random (all of them if there are no more)."""
        return self if count >= len(self) else self.select(sample_indices(len(self), count, seed))

    @property
    def nbytes(self) -> int:
        arrays = [*self.sensors.values(), *self.previous.values()]
        return sum(a.nbytes for a in arrays) + sum(
            a.nbytes for a in (self.status, self.failed, self.places)
        )


def sample_indices(size: int, count: int, seed: int) -> NDArray[np.intp]:
    """`min(count, size)` different numbers below `size`, rising; always the same ones."""
    generator = np.random.default_rng(seed)
    return np.sort(generator.choice(size, min(count, size), replace=False)).astype(np.intp)


def histories_of(
    interface: Interface,
    trajectories: Iterable[tuple[ArrayLike, ArrayLike]],
    precision: Precision = BINARY64,
) -> HistorySet:
    """The histories of some trajectories, in order, one for each step.

    A trajectory is `(observations, actions)`: the environment's observation vectors (T, d), and the
    applied actions (T, k) in the order in which the interface declares them. The last row of the
    actions is not looked at, for nothing came after it.
    """
    pieces = [
        piece
        for observations, actions in trajectories
        for piece in _pieces(
            interface,
            np.asarray(observations, dtype=np.float64),
            np.asarray(actions, dtype=np.float64),
            precision,
        )
    ]
    return _chain(interface, precision, pieces)


def join(sets: Sequence[HistorySet]) -> HistorySet:
    """One set with the histories of several, in order; they share interface, precision, layout."""
    first = sets[0]
    assert all(
        (s.interface, s.precision, s.layout) == (first.interface, first.precision, first.layout)
        for s in sets
    )
    if len(sets) == 1:
        return first
    match first.layout:
        case Layout.FLAT:
            return _chain(first.interface, first.precision, sets)
        case Layout.GATHERED:
            return HistorySet(
                interface=first.interface,
                precision=first.precision,
                layout=Layout.GATHERED,
                sensors=_frozen(
                    {
                        name: np.concatenate([s.sensors[name] for s in sets], axis=1)
                        for name in first.sensors
                    }
                ),
                previous=_frozen(
                    {
                        name: np.concatenate([s.previous[name] for s in sets])
                        for name in first.previous
                    }
                ),
                status=_locked(np.concatenate([s.status for s in sets])),
                failed=_locked(np.concatenate([s.failed for s in sets])),
                places=_locked(np.arange(sum(map(len, sets)), dtype=np.intp)),
            )


def _chain(interface: Interface, precision: Precision, parts: Sequence[HistorySet]) -> HistorySet:
    """Flat sets one behind the other, gaps of window - 1 places between them."""
    parts = [part for part in parts if len(part)]
    gap = interface.window - 1
    dtype = dtype_of(precision)
    places, offset = [], 0
    for part in parts:
        places.append(part.places + offset)
        offset += part.extent + gap

    def with_gaps(
        arrays: list[NDArray[ScalarType]], kind: np.dtype[ScalarType]
    ) -> NDArray[ScalarType]:
        filler = np.zeros(gap, kind)
        spaced = [piece for array in arrays for piece in (array, filler)]
        return np.concatenate([np.zeros(0, kind), *spaced[:-1]])

    sensors: dict[str, FloatArray] = {
        sensor.name: np.concatenate(
            [np.zeros(0, dtype), *(part.sensors[sensor.name] for part in parts)]
        )
        for sensor in interface.sensors
    }
    previous: dict[str, FloatArray] = {
        action.name: with_gaps(
            [part.previous[action.name] for part in parts], _dtype_of_action(action, precision)
        )
        for action in interface.actions
    }
    return HistorySet(
        interface=interface,
        precision=precision,
        layout=Layout.FLAT,
        sensors=_frozen(sensors),
        previous=_frozen(previous),
        status=_locked(with_gaps([part.status for part in parts], np.dtype(np.uint8))),
        failed=_locked(with_gaps([part.failed for part in parts], np.dtype(np.bool_))),
        places=_locked(np.concatenate([np.zeros(0, np.intp), *places])),
    )


def _pieces(
    interface: Interface,
    observations: NDArray[np.float64],
    actions: NDArray[np.float64],
    precision: Precision,
) -> list[HistorySet]:
    """A trajectory as one piece; more where a sensor's first good reading comes late.

    Under `fill first` that reading replaces what the window held before, so the histories before
    and after it share no readings.
    """
    steps = len(observations)
    status = np.zeros(steps, np.uint8)
    failed = np.zeros(steps, np.bool_)
    takes = [
        _take_in(interface, sensor, observations[:, sensor.index], precision, status, failed)
        for sensor in interface.sensors
    ]
    previous: dict[str, FloatArray] = {}
    for column, action in enumerate(interface.actions):
        kind = _dtype_of_action(action, precision)
        values = np.empty(steps, np.float64)
        values[:1] = action.safe
        values[1:] = actions[: steps - 1, column]
        with np.errstate(over="ignore"):
            previous[action.name] = values.astype(kind)
    cuts = sorted({0, steps} | {take.start for take in takes if 0 < take.start < steps})
    return [
        HistorySet(
            interface=interface,
            precision=precision,
            layout=Layout.FLAT,
            sensors={
                sensor.name: take.piece(interface, begin, end)
                for sensor, take in zip(interface.sensors, takes, strict=True)
            },
            previous={name: values[begin:end] for name, values in previous.items()},
            status=status[begin:end],
            failed=failed[begin:end],
            places=np.arange(end - begin, dtype=np.intp),
        )
        for begin, end in pairwise(cuts)
        if end > begin
    ]


@dataclass(frozen=True, eq=False)
class _Taken:
    """A sensor's readings (window - 1 + latency + T,) as its buffer holds them from `start` on.

    `before` fills the windows of the steps before `start`.
    """

    readings: FloatArray
    start: int
    before: float

    def piece(self, interface: Interface, begin: int, end: int) -> FloatArray:
        """The readings that the histories of the steps [begin, end) see."""
        if end <= self.start:
            return np.full(end - begin + interface.window - 1, self.before, self.readings.dtype)
        return self.readings[begin : end + interface.window - 1]


def _take_in(
    interface: Interface,
    sensor: Sensor,
    observed: NDArray[np.float64],
    precision: Precision,
    status: NDArray[np.uint8],
    failed: NDArray[np.bool_],
) -> _Taken:
    """What `interpreter.take_in` does, for all steps at once; adds to `status` and `failed`."""
    dtype = dtype_of(precision)
    with np.errstate(over="ignore"):
        readings = observed.astype(dtype)
        before = np.float64(middle(sensor.lower, sensor.upper)).astype(dtype)
    good = np.isfinite(readings)
    step = np.arange(len(readings))
    latest = np.maximum.accumulate(np.where(good, step, -1)) if len(step) else step
    low, high = widened(sensor.lower, sensor.upper)
    status[~good] |= MISSING
    status[good & ~((readings >= low) & (readings <= high))] |= OUT_OF_RANGE
    zero = dtype.type(0.0)
    match sensor.missing:
        case Hold(limit):
            if limit is not None:
                failed |= step - latest > limit
            kept = np.where(latest >= 0, readings[np.maximum(latest, 0)], zero)
        case _:
            kept = np.where(good, readings, zero)
    padding = interface.window - 1 + interface.latency
    start = 0
    warm = zero
    if interface.fill is Fill.FIRST:
        start = int(np.argmax(good)) if good.any() else len(readings)
        warm = readings[start] if start < len(readings) else before
        kept[:start] = warm
    filled: FloatArray = np.concatenate([np.full(padding, warm, dtype), kept])
    return _Taken(filled, start, float(before))


def _locked(array: NDArray[ScalarType]) -> NDArray[ScalarType]:
    array.flags.writeable = False
    return array


def _frozen(arrays: dict[str, FloatArray]) -> dict[str, FloatArray]:
    for array in arrays.values():
        array.flags.writeable = False
    return arrays
