"""TORCS as a Gymnasium environment, in lock-step with the simulator."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from pirlc.simulation.torcs.installation import installed
from pirlc.simulation.torcs.presets import REWARDS, TERMINATIONS
from pirlc.simulation.torcs.protocol import COLUMN, FIRST_READING, Conditions, Status, Trace
from pirlc.simulation.torcs.readings import ACTIONS, READINGS
from pirlc.simulation.torcs.simulator import Course, TorcsDied, TorcsHangs, TorcsProcess

Observation = NDArray[np.float64]

CONTROL_INTERVAL = 0.02
"""Seconds between two commands."""


class Torcs(gym.Env[Observation, NDArray[np.float64]]):
    """A practice race of one car.

    Observations are the 29 `READINGS` (binary64, scaled); actions are steer in [-1, 1] and accel in
    [0, 1], and with `brake` a third in [0, 1]. Gears shift by speed. `laps` 0 races until something
    ends the race. Readings named in `blocked` (separated by commas) are missing (NaN) with
    `block_probability` at each step; `noise` is the standard deviation of all readings' relative
    error; at each reset the grip is drawn from [1 - grip_variation, 1]. Without those three, every
    race with the same actions is the same race.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}
    dt = CONTROL_INTERVAL

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
        self.course = Course(track, self.installation.tracks[track], car, laps)
        self.conditions = Conditions(
            REWARDS[reward],
            TERMINATIONS[termination],
            None,
            tuple(name.strip() for name in blocked.split(",") if name.strip()),
            block_probability,
            noise,
        )
        self.grip_variation = grip_variation
        count = 3 if brake else 2
        self.observation_space = spaces.Box(-np.inf, np.inf, (len(READINGS),), np.float64)
        low = np.array([-1.0, 0.0, 0.0][:count])
        self.action_space = spaces.Box(low, np.ones(count), (count,), np.float64)
        self._process: TorcsProcess | None = None
        self._running = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        frame = self._attended(lambda process: process.begin(self._drawn()))
        self._running = True
        return frame[FIRST_READING:].copy(), _info(frame)

    def step(
        self, action: NDArray[np.float64]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        if not self._running:
            raise gym.error.ResetNeeded("the race is over: call reset() first")
        command = [float(component) for component in action]
        if len(command) != self.action_space.shape[0] or not all(map(math.isfinite, command)):
            raise ValueError(f"not a command: {command}")
        brake = command[2] if len(command) > 2 else 0.0
        frame = self._attended(lambda process: process.step(command[0], command[1], brake))
        status = Status(int(frame[0]))
        self._running = status is Status.RUNNING
        truncated = status is Status.TIME_LIMIT
        ended = not self._running and not truncated
        return frame[FIRST_READING:].copy(), float(frame[1]), ended, truncated, _info(frame)

    def race(
        self,
        library: str,
        params: tuple[float, ...] | None,
        seed: int,
        most_steps: int | None,
        beams: bool = True,
    ) -> Trace:
        """The whole race of a compiled controller, from a reset with `seed`, run by TORCS itself."""
        super().reset(seed=seed)
        self._running = False
        conditions = replace(self._drawn(), most_steps=most_steps)
        components = self.action_space.shape[0]
        return self._attended(
            lambda process: process.race(conditions, library, params, components, beams)
        )

    def close(self) -> None:
        if self._process is not None:
            self._process.close()
            self._process = None
        self._running = False

    def _drawn(self) -> Conditions:
        seed = int(self.np_random.integers(2**63))
        grip = 1.0 - self.grip_variation * float(self.np_random.random())
        return replace(self.conditions, seed=seed, grip=grip)

    def _attended(self, do: Any) -> Any:
        """What `do` returns; a process that failed is gone, and the next reset starts another."""
        if self._process is None:
            self._process = TorcsProcess(self.installation, self.course)
        try:
            return do(self._process)
        except (TorcsDied, TorcsHangs):
            self.close()
            raise


def _info(frame: NDArray[np.float64]) -> dict[str, Any]:
    return {
        "status": Status(int(frame[0])).name.lower(),
        "laps": int(frame[COLUMN["laps"]]),
        "lap_time": float(frame[COLUMN["lap_time"]]),
        "distance": float(frame[COLUMN["distance"]]),
        "damage": float(frame[COLUMN["damage"]]),
    }


__all__ = ["ACTIONS", "READINGS", "Torcs"]
