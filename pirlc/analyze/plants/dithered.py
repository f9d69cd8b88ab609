"""Rollouts of a program with a small dither on its actions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pirlc.analyze.plants.subject import Subject
from pirlc.ir.policy import ActionSpec, Choice, Continuous, Environment
from pirlc.semantics.policies import InterpretedPolicy
from pirlc.simulation.environments import Simulator
from pirlc.simulation.rollout import run_episode

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Rollouts:
    """Episodes with a dither on every continuous action: a level drawn anew after some steps.

    The level is uniform within `dither` times the action's range; how long it stays is geometric
    with a mean of `hold` steps. Discrete actions are replaced by another of their values in a share
    `dither` of the steps. `settled`: the share of an episode, from its start, that is left out;
    episodes are cut off after `most_steps`. Half of the episodes estimate the model, a quarter
    chooses its order (and then estimates too), a quarter tells its fit; episode i is from seed
    `seed + i`, its dither from (`seed`, i).
    """

    episodes: int = 12
    dither: float = 0.1
    hold: float = 12.0
    settled: float = 0.4
    most_steps: int = 1500
    seed: int = 0


@dataclass(frozen=True)
class Rollout:
    """Consecutive steps (T): observations (T, d), applied actions (T, k) and their dither (T, k).

    By the environment's components; the dither of a discrete action is 0 throughout.
    """

    observations: Vector
    actions: Vector
    dither: Vector

    def __len__(self) -> int:
        return len(self.actions)


class Dithered:
    """A program whose actions are disturbed; what it believes to have done stays its own."""

    def __init__(self, subject: Subject, rollouts: Rollouts, number: int) -> None:
        self._policy = InterpretedPolicy(subject.program)
        self._rollouts = rollouts
        self._number = number
        self._actions = sorted(subject.program.interface.actions, key=lambda a: a.component)
        self.reset()

    def reset(self) -> None:
        self._policy.reset()
        self._levels = [0.0] * len(self._actions)
        self._random = np.random.default_rng((self._rollouts.seed, self._number))
        self.dither: list[tuple[float, ...]] = []

    def act(self, observation: Vector) -> tuple[float, ...]:
        own = self._policy.act(observation)
        disturbed = tuple(
            self._disturbed(place, action, value)
            for place, (action, value) in enumerate(zip(self._actions, own, strict=True))
        )
        self.dither.append(tuple(self._levels))
        return disturbed

    def _disturbed(self, place: int, action: ActionSpec, value: float) -> float:
        chance = self._random.random()
        match action.domain:
            case Choice(values):
                if chance >= self._rollouts.dither or len(values) < 2:
                    return value
                return float(self._random.choice([other for other in values if other != value]))
            case Continuous(lower, upper):
                if chance < 1.0 / self._rollouts.hold:
                    size = self._rollouts.dither * (upper - lower)
                    self._levels[place] = float(self._random.uniform(-size, size))
                return min(max(value + self._levels[place], lower), upper)


def roll_out(subject: Subject, simulator: Simulator, rollouts: Rollouts) -> list[Rollout]:
    """The settled part of each episode, from behind the last reading that the program misses.

    Raises PirlcError E0514 to E0518.
    """
    read = [sensor.index for sensor in subject.program.interface.sensors]
    found = []
    for i in range(rollouts.episodes):
        policy = Dithered(subject, rollouts, i)
        episode = run_episode(simulator, policy, rollouts.seed + i)
        first = int(rollouts.settled * len(episode.actions))
        missing = np.flatnonzero(~np.isfinite(episode.observations[:, read]).all(axis=1))
        first = max(first, int(missing[-1]) + 1 if len(missing) else 0)
        dither = np.array(policy.dither, dtype=np.float64)
        found.append(Rollout(episode.observations[first:], episode.actions[first:], dither[first:]))
    return found


def shortened(environment: Environment, steps: int, limit: int | None) -> Environment:
    """The environment with episodes of at most `steps`; `limit` is its own."""
    fewer = steps if limit is None else min(steps, limit)
    return environment.with_arguments((("max_episode_steps", fewer),))
