"""Environments that misbehave, for the tests of what is reported then."""

from __future__ import annotations

import os
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces


class Broken(gym.Env[Any, Any]):
    """Counts its steps; from step 3 of an episode on it does what `fault` says."""

    def __init__(self, fault: str = "none", length: int = 5) -> None:
        self.fault, self.length = fault, length
        self.observation_space = spaces.Box(-10.0, 10.0, (2,), np.float32)
        self.action_space = spaces.Discrete(3, start=-1)
        self.taken = 0
        self.start = 0.0

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        if self.fault == "reset raises":
            raise RuntimeError("the motor is off")
        self.taken, self.start = 0, float(self.np_random.random())
        return np.array([self.start, 0.0], np.float32), {}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        assert self.action_space.contains(action)
        self.taken += 1
        observation: Any = np.array([self.start, self.taken], np.float32)
        reward: Any = self.start + action
        if self.taken >= 3:
            match self.fault:
                case "raises":
                    raise ValueError("the belt slipped")
                case "nan reward":
                    reward = float("nan")
                case "no reward":
                    reward = None
                case "wrong shape":
                    observation = observation[:1]
                case "no observation":
                    observation = None
                case "nan observation":
                    observation = np.array([np.nan, np.inf], np.float32)
                case "dies":
                    os._exit(3)
        return observation, reward, self.taken >= self.length, False, {}


class Images(Broken):
    def __init__(self) -> None:
        super().__init__()
        self.observation_space = spaces.Box(0, 255, (4, 4), np.uint8)


class ManyChoices(Broken):
    def __init__(self) -> None:
        super().__init__()
        self.action_space = spaces.MultiDiscrete([2, 3])


gym.register("Broken-v0", entry_point=Broken)
gym.register("Images-v0", entry_point=Images)
gym.register("ManyChoices-v0", entry_point=ManyChoices)


def wrapped(**arguments: Any) -> gym.Env[Any, Any]:
    """CartPole within wrappers that rollouts must not look through."""
    inner = gym.make("CartPole-v1", disable_env_checker=True, **arguments)
    negated = gym.wrappers.TransformReward(inner, lambda reward: -2.0 * float(reward))
    return gym.wrappers.TimeLimit(negated, 30)


gym.register("WrappedCartPole-v0", entry_point=wrapped, order_enforce=True)
