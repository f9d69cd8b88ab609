"""TORCS as a Gymnasium environment, in lock-step with the simulator."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from pirlc.simulation.torcs.arguments import (
    require_car,
    require_preset,
    require_readings,
    require_real,
    require_switch,
    require_track,
    require_whole,
)
from pirlc.simulation.torcs.installation import CONTROL_INTERVAL, installed
from pirlc.simulation.torcs.presets import REWARDS, TERMINATIONS
from pirlc.simulation.torcs.protocol import COLUMN, FIRST_READING, Conditions, Status, Trace
from pirlc.simulation.torcs.readings import ACTIONS, READINGS
from pirlc.simulation.torcs.simulator import PATIENCE, Course, TorcsProcess

Observation = NDArray[np.float64]

MOST_LAPS = 1000

_WORDS = tuple(status.name.lower() for status in Status)
_REWARD, _LAPS, _LAP_TIME = COLUMN["reward"], COLUMN["laps"], COLUMN["lap_time"]
_DISTANCE, _DAMAGE = COLUMN["distance"], COLUMN["damage"]
_RUNNING, _TIME_LIMIT = float(Status.RUNNING), float(Status.TIME_LIMIT)


class Torcs(gym.Env[Observation, NDArray[np.float64]]):
    """A practice race of one car, from a standing start.

    Observations are the 29 `READINGS` (binary64, scaled); actions are steer in [-1, 1] and accel in
    [0, 1], and with `brake` a third in [0, 1]; beyond these they are clipped. Gears shift by speed.
    `laps` 0 races until something ends the race; TORCS itself ends it when the tank is empty, the
    car broken, or a lap takes too long (info's `status` is then `out`). `reward` and `termination`
    name presets. Readings named in `blocked` (separated by commas) are missing (NaN) with
    `block_probability` at each step; `noise` is the standard deviation of all readings' relative
    error; at each reset the grip is drawn from [1 - grip_variation, 1]. Without those three, every
    race with the same actions is the same race; with them, every race from the same seed.

    The space of observations has no bounds: the readings are scaled to the order of 1 already, but
    a car may be faster than 300 km/h, or beside the road, and whoever scales by a space's bounds
    would distort what the reference experiments use as it is. A missing reading is in no space.

    Raises BadArgument (a ValueError) E0527 to E0531 for what it cannot be, and PirlcError E0520 or
    E0524 where TORCS is not installed. A simulator that ends by itself raises `TorcsDied` from
    `reset`, `step` or `race`, one that does not answer within `patience` seconds `TorcsHangs`; the
    next reset starts another.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 (typed so by Gymnasium)
    dt = CONTROL_INTERVAL
    patience: float = PATIENCE

    def __init__(
        self,
        track: str = "aalborg",
        laps: int = 3,
        car: str = "car1-trb1",
        reward: str = "ndps",
        termination: str = "gym_torcs",
        brake: bool = False,
        blocked: str = "",
        block_probability: float = 0.0,
        noise: float = 0.0,
        grip_variation: float = 0.0,
    ) -> None:
        self.installation = installed()
        tracks, cars = self.installation.tracks, self.installation.cars
        track, car = require_track(track, tracks), require_car(car, cars)
        self.course = Course(track, tracks[track], car, require_whole("laps", laps, MOST_LAPS))
        self.conditions = Conditions(
            REWARDS[require_preset("reward", reward, REWARDS)],
            TERMINATIONS[require_preset("termination", termination, TERMINATIONS)],
            None,
            require_readings(blocked, READINGS),
            require_real("block_probability", block_probability, 1.0),
            require_real("noise", noise),
        )
        self.grip_variation = require_real("grip_variation", grip_variation, 1.0, closed=False)
        count = 3 if require_switch("brake", brake) else 2
        self.observation_space = spaces.Box(-np.inf, np.inf, (len(READINGS),), np.float64)
        low = np.array([-1.0, 0.0, 0.0][:count])
        self.action_space = spaces.Box(low, np.ones(count), (count,), np.float64)
        self._process: TorcsProcess | None = None
        self._running = False
        self._shape = (count,)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        self._running = False
        process = self._ready()
        frame = process.begin(self._drawn())
        self._running = process.values[0] == _RUNNING
        return frame[FIRST_READING:].copy(), _info(process.values)

    def step(
        self, action: NDArray[np.float64]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        process = self._process
        if process is None or not self._running:
            raise gym.error.ResetNeeded("no race is under way: call reset() first")
        given = np.asarray(action, np.float64)
        command = given.tolist()
        if given.shape != self._shape or not all(map(math.isfinite, command)):
            raise ValueError(f"not {self._shape[0]} finite numbers: {command}")
        self._running = False  # unless all goes well
        brake = command[2] if len(command) > 2 else 0.0
        frame = process.step(command[0], command[1], brake)
        values = process.values
        status = values[0]
        truncated = status == _TIME_LIMIT
        running = self._running = status == _RUNNING
        readings = frame[FIRST_READING:].copy()
        return readings, values[_REWARD], not (running or truncated), truncated, _info(values)

    def race(
        self,
        library: str,
        params: tuple[float, ...] | None,
        seed: int,
        most_steps: int | None,
        beams: bool = True,
    ) -> Trace:
        """The whole race of a compiled controller, from a reset with `seed`, run by TORCS itself.

        The same race as step by step; without `beams` theirs are 0 (it is faster). `params` None:
        the controller's own. The trace's status tells how it ended.
        """
        super().reset(seed=seed)
        self._running = False
        conditions = replace(self._drawn(), most_steps=most_steps)
        process = self._ready()
        return process.race(conditions, library, params, self._shape[0], beams)

    @property
    def deterministic(self) -> bool:
        """Whether every race with the same actions is the same race, whatever the seed."""
        conditions = self.conditions
        blocking = bool(conditions.blocked) and conditions.block_probability > 0.0
        return not blocking and conditions.noise == 0.0 and self.grip_variation == 0.0

    def close(self) -> None:
        if self._process is not None:
            self._process.close()
            self._process = None
        self._running = False

    def _drawn(self) -> Conditions:
        seed = int(self.np_random.integers(2**63))
        grip = 1.0 - self.grip_variation * float(self.np_random.random())
        return replace(self.conditions, seed=seed, grip=grip)

    def _ready(self) -> TorcsProcess:
        """The process that waits on the grid; another if it failed."""
        if self._process is not None and not self._process.usable():
            self.close()
        if self._process is None:
            self._process = TorcsProcess(self.installation, self.course, self.patience)
        return self._process


def _info(frame: memoryview[float]) -> dict[str, Any]:
    return {
        "status": _WORDS[int(frame[0])],
        "laps": int(frame[_LAPS]),
        "lap_time": frame[_LAP_TIME],
        "distance": frame[_DISTANCE],
        "damage": frame[_DAMAGE],
    }


__all__ = ["ACTIONS", "READINGS", "Torcs"]
