"""Histories run through the reference interpreter: no counterexample counts that it does not show.

A `Trial` says everything about a start: what the buffers hold, which readings are missing, what was
applied before. The interpreter then steps through warm windows, latency included.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction

from pirlc.ir.policy import ActionSpec, Choice, Continuous, Program, Sensor
from pirlc.semantics.interpreter import SensorState, State, initial_state, step
from pirlc.semantics.precision import BINARY64, Precision, to_binary32
from pirlc.verify.findings import History, Replay, Step
from pirlc.verify.model import finite_range


@dataclass(frozen=True)
class Trial:
    """`readings` by sensor, oldest first: window - 1 and then one for each step; a NaN in a step is
    a missing reading.

    `late` are the sensors that gave no good reading before the first step. `absent` counts the
    missing readings of a sensor just before it; `missing` are the steps without a reading of it
    where the window gets the one before again.
    """

    readings: Mapping[str, tuple[float, ...]]
    previous: Mapping[str, float]
    late: frozenset[str] = frozenset()
    absent: Mapping[str, int] = field(default_factory=dict)
    missing: Mapping[str, frozenset[int]] = field(default_factory=dict)

    @property
    def history(self) -> History:
        return History(self.readings, self.previous)


@dataclass(frozen=True)
class Observed:
    """One step: what the program saw (oldest first), what was applied before, what it answered."""

    windows: Mapping[str, tuple[float, ...]]
    previous: Mapping[str, float]
    raw: Mapping[str, float]
    applied: Mapping[str, float]


def run(program: Program, trial: Trial, precision: Precision = BINARY64) -> tuple[Observed, ...]:
    """The interpreter's steps on a trial, oldest first."""
    interface = program.interface
    window, latency = interface.window, interface.latency
    at_reset = initial_state(program, precision)
    sensors = []
    streams: dict[str, tuple[float, ...]] = {}
    for sensor, fresh in zip(interface.sensors, at_reset.sensors, strict=True):
        given = trial.readings[sensor.name]
        if sensor.name in trial.late:
            streams[sensor.name] = given[window - 1 :]
            sensors.append(fresh)
            continue
        # The program sees a reading `latency` steps after it was taken: those who were taken last
        # are never seen.
        stream = given + (given[-1],) * latency
        buffer = tuple(precision.round(x) for x in stream[: window + latency - 1])
        streams[sensor.name] = stream[window + latency - 1 :]
        last = next((x for x in reversed(buffer) if math.isfinite(x)), precision.round(given[0]))
        sensors.append(_warm(buffer, last, trial.absent.get(sensor.name, 0)))
    applied: Mapping[str, float] = {
        spec.name: _as_applied(spec, trial.previous[spec.name], precision)
        for spec in interface.actions
    }
    state = State(tuple(sensors), tuple(applied[spec.name] for spec in interface.actions))
    length = 1 + max((sensor.index for sensor in interface.sensors), default=0)
    count = min((len(stream) for stream in streams.values()), default=1)
    steps = []
    for number in range(count):
        observation = [0.0] * length
        for sensor in interface.sensors:
            lacks = number in trial.missing.get(sensor.name, ())
            observation[sensor.index] = math.nan if lacks else streams[sensor.name][number]
        result = step(program, state, observation, precision)
        names = [spec.name for spec in interface.actions]
        before, applied = applied, dict(zip(names, result.actions, strict=True))
        windows = {
            sensor.name: after.buffer[:window]
            for sensor, after in zip(interface.sensors, result.state.sensors, strict=True)
        }
        steps.append(Observed(windows, before, dict(zip(names, result.raw, strict=True)), applied))
        state = result.state
    return tuple(steps)


def _warm(buffer: tuple[float, ...], last: float, absent: int) -> SensorState:
    """A sensor's state with these readings in its buffer, whose oldest place is about to go."""
    stand_in = tuple(x if math.isfinite(x) else 0.0 for x in buffer)
    return SensorState((0.0, *stand_in), last if math.isfinite(last) else 0.0, True, absent)


def _as_applied(spec: ActionSpec, value: float, precision: Precision) -> float:
    match spec.domain:
        case Continuous(lower, upper):
            low, high = precision.round(lower), precision.round(upper)
            return min(max(precision.round(value), low), high)
        case Choice():
            return int(value)


def as_replay(trial: Trial, steps: tuple[Observed, ...]) -> Replay:
    return Replay(trial.history, tuple(Step(step.raw, step.applied) for step in steps))


def near_reading(
    sensor: Sensor, value: Fraction, precision: Precision, digits: int | None = None
) -> float:
    """A number of a precision near a reading, inside the sensor's widened range: the nearest, or
    with `digits` one that this many decimals tell, relative to the range's ends."""
    return _near(finite_range(sensor), value, precision, digits)


def near_action(
    spec: ActionSpec, value: Fraction, precision: Precision, digits: int | None = None
) -> float:
    """The same for an action that was applied."""
    match spec.domain:
        case Continuous(lower, upper):
            return _near((lower, upper), value, precision, digits)
        case Choice():
            return float(value)


def _near(
    ends: tuple[float, float], value: Fraction, precision: Precision, digits: int | None
) -> float:
    low, high = ends
    if digits is not None:
        value = round(value, digits - math.ceil(math.log10(max(-low, high))))
    near = float(value)
    near = near if precision is BINARY64 else to_binary32(near)
    return min(max(near, low), high)
