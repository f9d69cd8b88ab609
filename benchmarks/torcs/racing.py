"""Races of any driver, as traces, and where they came to harm."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from benchmarks.torcs.drivers import CompiledProgram, Driver, Network
from pirlc.simulation.torcs.installation import installed
from pirlc.simulation.torcs.presets import TERMINATIONS
from pirlc.simulation.torcs.protocol import (
    FIRST_COMMAND,
    FIRST_READING,
    Conditions,
    Status,
    Trace,
)
from pirlc.simulation.torcs.simulator import Course, Robot, TorcsProcess
from pirlc.simulation.torcs.summary import positions

LAPS = 3

WHOLE = Conditions(termination=TERMINATIONS["none"])
"""A race that only TORCS itself ends early: too much damage, or too slow a lap."""

UNTIL_CRASH = Conditions(termination=TERMINATIONS["ndps"])
"""A race that ends far beside the road, standing, or facing backwards."""


@lru_cache(maxsize=16)
def _process(course: Course) -> TorcsProcess:
    """One for each course, in each process of ours; it ends with that."""
    return TorcsProcess(installed(), course)


def race(driver: Driver, track: str, conditions: Conditions, laps: int = LAPS) -> Trace:
    """A race from standstill in the car of the reference experiments, `car1-trb1`."""
    wheel = driver.wheel
    robot = wheel if isinstance(wheel, Robot) else None
    process = _process(Course(track, laps=laps, robot=robot))
    match wheel:
        case CompiledProgram():
            return process.race(conditions, wheel.library, None, wheel.components, wheel.beams)
        case Network():
            return _lock_step(process, wheel, conditions)
        case Robot():
            return process.race_robot(conditions)


def _lock_step(process: TorcsProcess, network: Network, conditions: Conditions) -> Trace:
    frame = process.begin(conditions)
    values, act = process.values, network.oracle.act
    known = np.zeros(len(frame) - FIRST_READING)
    frames = []
    while values[0] == Status.RUNNING:
        readings = frame[FIRST_READING:]
        good = np.isfinite(readings)
        if network.held:
            np.copyto(known, readings, where=good)
        command = (*act(known if network.held else readings), 0.0)[:3]
        frames.append(frame.copy())
        frames[-1][FIRST_COMMAND:FIRST_READING] = command
        frame = process.step(*command)
    return Trace(np.array([*frames, frame]))


def distance_at(trace: Trace, happened: NDArray[np.bool_]) -> float:
    """The distance (m) of the first frame for which it is true, else that of the whole race."""
    (places,) = np.nonzero(happened)
    return float(trace["distance"][places[0] if len(places) else -1])


def distance_to_crash(trace: Trace) -> float:
    """How far (m) a race `UNTIL_CRASH` came before the car hit something, or else ended."""
    return distance_at(trace, trace["damage"] > trace["damage"][0])


def distance_on_road(trace: Trace) -> float:
    """How far (m) a race came before the middle of the car was beyond the road's edge."""
    return distance_at(trace, np.abs(positions(trace)) > 1.0)


def crashed(trace: Trace) -> bool:
    """Whether a race `UNTIL_CRASH` hit something, or did not come to its end."""
    return trace.status is not Status.FINISHED or bool(trace["damage"][-1] > trace["damage"][0])
