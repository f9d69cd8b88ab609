"""What is said to the host robot over its socket: runtime/torcs/protocol.h, from this side."""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pirlc.simulation.torcs.presets import Reward, Termination
from pirlc.simulation.torcs.readings import ACTIONS, READINGS

VERSION = 1
MOST_PARAMS = 256
_PATH = 1024


class Kind(IntEnum):
    LOCK_STEP = 1
    NATIVE = 2
    TRACK = 3
    ROBOT = 4


class Status(IntEnum):
    """How a race stands, or why it ended."""

    RUNNING = 0
    FINISHED = 1
    OFF_TRACK = 2
    TOO_SLOW = 3
    BACKWARDS = 4
    OUT = 5
    TIME_LIMIT = 6
    BAD_ACTION = 7
    NO_CONTROLLER = 8


FRAME = (
    *("status", "reward", "time", "laps", "lap_time", "distance", "damage", "x", "y", "yaw"),
    *("to_middle", "width", "speed", "gear", "fuel", "collisions", "invalid"),
    *(f"command_{name}" for name in ACTIONS),
    *READINGS,
)
"""The columns of a frame, all binary64; protocol.h tells their units."""

COLUMN = {name: place for place, name in enumerate(FRAME)}
FIRST_READING = COLUMN[READINGS[0]]
FIRST_COMMAND = COLUMN["command_steer"]
FRAME_BYTES = 8 * len(FRAME)

COMMAND = struct.Struct("=dddII")
"""Steer, accel, brake; whether to leave; one more than the processor to run on, or 0."""

TRACE_HEADER = struct.Struct("=Q")
PART = 4096
"""Frames of a trace that are sent at a time: a race that nobody waits for any more ends here."""

_REQUEST = struct.Struct(f"=IIIiiiiiiiIIQddddd{MOST_PARAMS}d{_PATH}s")


@dataclass(frozen=True)
class Conditions:
    """What a race is like, beside its track, car and laps.

    `most_steps`: control steps after which it is cut off (None: no limit). `blocked`: readings that
    are missing with `block_probability` at each step. `noise`: standard deviation of a relative
    error of every reading. `grip`: a factor on the friction of all surfaces. `seed`: of blocking
    and noise.
    """

    reward: Reward = Reward.NDPS
    termination: Termination = field(default_factory=Termination)
    most_steps: int | None = None
    blocked: tuple[str, ...] = ()
    block_probability: float = 0.0
    noise: float = 0.0
    grip: float = 1.0
    seed: int = 0

    def limited(self, most_steps: int) -> Conditions:
        """The same with another limit of steps."""
        return replace(self, most_steps=most_steps)


def request(
    kind: Kind,
    conditions: Conditions,
    laps: int,
    library: str = "",
    params: tuple[float, ...] | None = None,
    components: int = 2,
    beams: bool = True,
) -> bytes:
    """The bytes that ask the host for something. `params` None: the controller's own.

    Raises ValueError for more parameters, or a longer path, than fit into it.
    """
    termination = conditions.termination
    given, path = params or (), os.fsencode(library)
    if len(given) > MOST_PARAMS:
        raise ValueError(f"{len(given)} parameters; a request has room for {MOST_PARAMS}")
    if len(path) >= _PATH:
        raise ValueError(f"a path of {len(path)} bytes; a request has room for {_PATH - 1}")
    return _REQUEST.pack(
        VERSION,
        kind,
        conditions.reward,
        laps,
        conditions.most_steps or 0,
        -1 if termination.slow_after is None else termination.slow_after,
        termination.backwards,
        -1 if params is None else len(given),
        components,
        beams,
        sum(1 << READINGS.index(name) for name in conditions.blocked),
        PART,
        conditions.seed % 2**64,
        termination.slow,
        termination.off_track,
        conditions.block_probability,
        conditions.noise,
        conditions.grip,
        *given,
        *(0.0,) * (MOST_PARAMS - len(given)),
        path,
    )


@dataclass(frozen=True, eq=False)
class Trace:
    """A race, frame by frame: `frames` has shape (T + 1, len(FRAME)); the last has no action."""

    frames: NDArray[np.float64]

    def __getitem__(self, column: str) -> NDArray[np.float64]:
        return self.frames[:, COLUMN[column]]

    @property
    def status(self) -> Status:
        return Status(int(self.frames[-1, 0]))

    @cached_property
    def rewards(self) -> NDArray[np.float64]:
        """Shape (T,): what the step from each frame to the next earned."""
        return self.frames[1:, COLUMN["reward"]]

    @cached_property
    def observations(self) -> NDArray[np.float64]:
        """Shape (T, 29): what each action answers."""
        return self.frames[:-1, FIRST_READING:]

    @cached_property
    def actions(self) -> NDArray[np.float64]:
        """Shape (T, 3): steer, accel and brake as applied."""
        return self.frames[:-1, FIRST_COMMAND:FIRST_READING]

    @property
    def laps(self) -> tuple[float, ...]:
        """The times (s) of the laps that were completed."""
        count = self["laps"]
        (done,) = np.nonzero(np.diff(count) > 0)
        return tuple(float(t) for t in self["lap_time"][done + 1])
