"""Programs and environments that tests of plants share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from pirlc.cli.files import program_in
from pirlc.frontend import parse_sketch
from pirlc.ir.policy import Program
from pirlc.source import SourceText

PENDULUM = """policy pendulum
environment "Pendulum-v1"
sensor Height : [-1, 1] = 0
sensor Side   : [-1, 1] = 1
sensor Speed  : [-8, 8] = 2
action Torque : [-2, 2] safe 0 =
    if peek(Height, -1) > 0.7 then -24 * peek(Side, -1) - 5 * peek(Speed, -1)
    else 9 * peek(Side, -1) + 4 * peek(Speed, -1)
"""
"""Swings up and holds."""

SPRING = """policy spring
environment "Spring-v0"
sensor Place : [-2, 2] = 1
action Push : [-1, 1] = -0.4 * peek(Place, -1)
"""


def program(text: str) -> Program:
    source = SourceText("program.pirl", text)
    return program_in(source, parse_sketch(source))


class Spring(gym.Env[Any, Any]):
    """Place and speed of a weight on a spring with friction; reads (2 speed, place, 1).

    `memory`: what the environment remembers besides its `state`: nothing, the action of the step
    before, or (`hidden`) the state itself under another name. `sealed`: its state cannot be set.
    """

    A = np.array([[1.0, 0.1], [-0.05, 0.9]])
    B = np.array([[0.0], [0.1]])
    drift = np.zeros(2)

    def __init__(self, memory: str = "none", downhill: bool = False) -> None:
        self.memory = memory
        if downhill:
            # No spring, and a slope on which no push can hold the weight.
            self.A, self.drift = np.array([[1.0, 0.1], [0.0, 0.9]]), np.array([0.0, 0.5])
        self.observation_space = spaces.Box(-10.0, 10.0, (3,), np.float64)
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float64)
        self._now = np.zeros(2)
        self._last = 0.0

    @property
    def dt(self) -> float:
        return 0.1

    def __getattr__(self, name: str) -> Any:
        if name == "state" and self.memory != "hidden":
            return self._now
        raise AttributeError(name)

    def __setattr__(self, name: str, value: Any) -> None:
        if name == "state" and self.memory == "sealed":
            raise RuntimeError("the case is sealed")
        super().__setattr__("_now" if name == "state" else name, value)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        self._now = self.np_random.uniform(-0.5, 0.5, 2)
        self._last = float(self.np_random.uniform(-1.0, 1.0))
        return self._reading(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        push = np.array(action) + (self._last if self.memory == "action" else 0.0)
        self._last = float(action[0])
        self._now = self.A @ self._now + self.B @ push + self.drift
        return self._reading(), 0.0, False, False, {}

    def _reading(self) -> Any:
        return np.array([2.0 * self._now[1], self._now[0], 1.0])


@dataclass
class Data:
    qpos: Any
    qvel: Any


class Slide(Spring):
    """The same with its state where MuJoCo's environments have theirs."""

    def __init__(self) -> None:
        super().__init__("hidden")

    @property
    def data(self) -> Data:
        return Data(self._now[:1], self._now[1:])

    def set_state(self, qpos: Any, qvel: Any) -> None:
        assert np.shape(qpos) == np.shape(qvel) == (1,)
        self._now = np.concatenate([qpos, qvel])


def register_spring() -> None:
    for name, entry_point in (("Spring-v0", Spring), ("Slide-v0", Slide)):
        if name not in gym.registry:
            gym.register(name, entry_point, max_episode_steps=200)
