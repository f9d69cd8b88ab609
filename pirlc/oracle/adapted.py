"""Environments as learners like them."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from pirlc.oracle.network import Scaling
from pirlc.oracle.problems import BadHyperparameter, failure
from pirlc.oracle.training import Training
from pirlc.simulation.environments import DiscreteActions, Simulator


class Adapted(gym.Wrapper[Any, Any, Any, Any]):
    """An environment as a learner likes it: scaled binary32 observations, actions from 0.

    Each action is taken `repeat` times, unless the episode ends before; the rewards' sum times
    `reward_scale` is the step's. Actions may be of a wider `reach`; they are clipped.
    """

    def __init__(self, simulator: Simulator, scaling: Scaling, training: Training) -> None:
        super().__init__(simulator)
        self.scaling = scaling
        self.repeat, self.reward_scale = training.settings.repeat, training.settings.reward_scale
        reach = reach_of(training)
        self.clipped: spaces.Box | None = None
        if reach is not None and isinstance(simulator.action_space, spaces.Box):
            self.clipped = simulator.action_space
        shape = scaling.offset.shape
        self.observation_space = spaces.Box(-np.inf, np.inf, shape, np.float32)
        self.first = 0
        if isinstance(simulator.action_space, spaces.Discrete):
            self.first = int(simulator.action_space.start)
            self.action_space = spaces.Discrete(int(simulator.action_space.n))
        if reach is not None:
            self.action_space = reach

    def _seen(self, observation: Any) -> NDArray[np.float32]:
        x = np.asarray(observation, dtype=np.float32)
        x = np.where(np.isfinite(x), x, np.float32(0))
        scaled: NDArray[np.float32] = (x - self.scaling.offset) / self.scaling.scale
        return scaled

    def reset(self, **arguments: Any) -> tuple[Any, dict[str, Any]]:
        observation, info = self.env.reset(**arguments)
        return self._seen(observation), info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        if isinstance(self.action_space, spaces.Discrete):
            action = int(action) + self.first
        if self.clipped is not None:
            action = np.clip(action, self.clipped.low, self.clipped.high)
        total = 0.0
        for _ in range(self.repeat):
            observation, reward, terminated, truncated, info = self.env.step(action)
            total += float(reward)
            if terminated or truncated:
                break
        return self._seen(observation), total * self.reward_scale, terminated, truncated, info


def reach_of(training: Training) -> spaces.Box | None:
    """The range of the learner's actions, None where it is the environment's own.

    Raises PirlcError E0613 for a range that does not hold the environment's.
    """
    settings, actions = training.settings, training.facts.actions
    if not settings.least and not settings.most:
        return None
    if isinstance(actions, DiscreteActions):
        reason = "the environment's actions are discrete"
        raise failure(BadHyperparameter(training.algorithm, "least", reason, None))
    least, most = settings.least or actions.lower, settings.most or actions.upper
    k = len(actions.lower)
    for name, given in (("least", least), ("most", most)):
        if len(given) != k:
            reason = f"it has {len(given)} numbers, and an action {k} components"
            raise failure(BadHyperparameter(training.algorithm, name, reason, None))
    low, high = np.array(least, np.float32), np.array(most, np.float32)
    if (low > np.array(actions.lower)).any() or (high < np.array(actions.upper)).any():
        name = "least" if (low > np.array(actions.lower)).any() else "most"
        reason = "the range must hold the environment's"
        raise failure(BadHyperparameter(training.algorithm, name, reason, None))
    return spaces.Box(low, high, dtype=np.float32)


def scaling_of(training: Training) -> Scaling:
    """As the settings say; else onto [-1, 1] where the observation space is bounded.

    Raises PirlcError E0613 for a centre or spread that does not fit the observations.
    """
    facts, settings, algorithm = training.facts, training.settings, training.algorithm
    if settings.centre or settings.spread:
        d = facts.observation_size
        centre, spread = settings.centre or (0.0,) * d, settings.spread or (1.0,) * d
        for name, given in (("centre", centre), ("spread", spread)):
            if len(given) != d:
                reason = f"it has {len(given)} numbers, and {facts.id} {d} readings"
                raise failure(BadHyperparameter(algorithm, name, reason, None))
        if not min(spread) > 0:
            reason = "its numbers must be above 0"
            raise failure(BadHyperparameter(algorithm, "spread", reason, None))
        return Scaling(np.array(centre, np.float32), np.array(spread, np.float32))
    scale = settings.scale
    low, high = np.array(facts.observation_lower), np.array(facts.observation_upper)
    # Binary32's largest number stands for "unbounded" in some environments.
    bounded = scale & (np.abs(low) < 1e30) & (np.abs(high) < 1e30) & (high > low)
    with np.errstate(invalid="ignore", over="ignore"):
        offset = np.where(bounded, low * 0.5 + high * 0.5, 0.0)
        half = np.where(bounded, high * 0.5 - low * 0.5, 1.0)
    return Scaling(offset.astype(np.float32), half.astype(np.float32))
