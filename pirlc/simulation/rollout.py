"""Episodes and returns of anything with the Policy protocol.

Most of a search's time is spent in this loop, so it steps the environment inside the standard
wrappers where it can: it counts the steps of `TimeLimit` itself and resets before it steps, as
`OrderEnforcing` asks. Nothing that the policy or the return depends on changes by that. A simulator
that can run a compiled policy by itself does so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from pirlc.diagnostics import PirlcError
from pirlc.simulation.environments import Simulator
from pirlc.simulation.native import LONGEST_EPISODE, peel, run_native
from pirlc.simulation.policy import Policy
from pirlc.simulation.problems import (
    BadAction,
    BadObservation,
    BadReward,
    EndlessEpisode,
    SimulatorRaised,
    failure,
)


@dataclass(frozen=True)
class Episode:
    """What a policy saw and did over T steps.

    `observations`: (T, d), each the one that the step's action answers, widened exactly to
    binary64. `actions`: (T, k), the policy's numbers before they are cast to the environment's
    type. `rewards`: (T,).
    """

    observations: NDArray[np.float64]
    actions: NDArray[np.float64]
    rewards: NDArray[np.float64]

    @property
    def missing_readings(self) -> int:
        """How many of the readings were NaN or infinite."""
        return int(np.count_nonzero(~np.isfinite(self.observations)))


@dataclass(frozen=True)
class ReturnEstimate:
    """The mean of the episodes' returns with its 95 % confidence interval (Student's t).

    `std` is that of one episode's return. With a single episode the interval is infinite, but for a
    deterministic environment, of which one episode tells all: there it is the mean itself.
    """

    mean: float
    low: float
    high: float
    std: float
    episodes: int

    @property
    def exact(self) -> bool:
        """Whether no further episode could change the mean."""
        return self.episodes == 1 and self.low == self.high


def estimate(returns: NDArray[np.float64], *, deterministic: bool = False) -> ReturnEstimate:
    """Summarise the returns (shape (n,), n at least 1) of independent episodes.

    In a `deterministic` environment all of them are the same episode.
    """
    from scipy.special import stdtrit

    n = len(returns)
    mean = math.fsum(returns) / n
    if deterministic:
        return ReturnEstimate(float(returns[0]), float(returns[0]), float(returns[0]), 0.0, 1)
    if n == 1:
        return ReturnEstimate(mean, -math.inf, math.inf, 0.0, 1)
    std = float(np.std(returns, ddof=1))
    half = float(stdtrit(n - 1, 0.975)) * std / math.sqrt(n)
    return ReturnEstimate(mean, mean - half, mean + half, std, n)


def episode_return(episode: Episode) -> float:
    """The undiscounted sum of the rewards."""
    return math.fsum(episode.rewards)


def run_episode(simulator: Simulator, policy: Policy, seed: int) -> Episode:
    """One episode from a seed. Raises PirlcError E0514 to E0518, E0540."""
    trace = run_native(simulator, policy, seed, everything=True)
    if trace is not None:
        components = math.prod(simulator.action_space.shape or ())
        return Episode(trace.observations, trace.actions[:, :components], trace.rewards)
    observations, actions, rewards = _play(simulator, policy, seed)
    return Episode(np.array(observations), np.array(actions, dtype=np.float64), np.array(rewards))


def run_return(simulator: Simulator, policy: Policy, seed: int) -> float:
    """The return of one episode from a seed. Raises PirlcError E0514 to E0518, E0540."""
    trace = run_native(simulator, policy, seed, everything=False)
    return math.fsum(_play(simulator, policy, seed)[2] if trace is None else trace.rewards.tolist())


def run_returns(simulator: Simulator, policy: Policy, seeds: Sequence[int]) -> NDArray[np.float64]:
    """The return from each seed, in order. Raises PirlcError E0514 to E0518, E0540."""
    return np.array([run_return(simulator, policy, seed) for seed in seeds], dtype=np.float64)


def _play(
    simulator: Simulator, policy: Policy, seed: int
) -> tuple[list[NDArray[np.float64]], list[tuple[float, ...]], list[float]]:
    inner, limit = peel(simulator)
    name = "" if inner.spec is None else inner.spec.id
    chosen, size = inner.action_space, inner.observation_space.shape
    assert size is not None
    discrete = isinstance(chosen, spaces.Discrete)
    if isinstance(chosen, spaces.Discrete):
        first, last = int(chosen.start), int(chosen.start + chosen.n) - 1
    else:
        dtype, components = chosen.dtype, math.prod(chosen.shape or ())
    longest = LONGEST_EPISODE if limit is None else limit
    step_inner, act, isfinite = inner.step, policy.act, math.isfinite
    observations: list[NDArray[np.float64]] = []
    actions: list[tuple[float, ...]] = []
    rewards: list[float] = []

    try:
        raw, _ = inner.reset(seed=seed)
    except PirlcError:
        raise
    except Exception as error:
        raise failure(SimulatorRaised(name, "reset", seed, 0, _words(error))) from error
    policy.reset()
    for step in range(longest):
        observation = _widened(raw)
        if observation is None or observation.shape != size:
            got = _shape(raw)
            raise failure(BadObservation(name, seed, step, math.prod(size), got))
        action = act(observation)
        applied: Any
        if discrete:
            value = action[0]
            if len(action) != 1 or not isfinite(value) or not first <= value <= last:
                raise failure(BadAction(name, seed, step, tuple(action), _words_of(chosen)))
            applied = int(value)
            if applied != value:
                raise failure(BadAction(name, seed, step, tuple(action), _words_of(chosen)))
        else:
            if len(action) != components or not all(map(isfinite, action)):
                raise failure(BadAction(name, seed, step, tuple(action), _words_of(chosen)))
            applied = np.array(action, dtype=dtype)
        observations.append(observation)
        actions.append(action)
        try:
            raw, reward, terminated, truncated, _ = step_inner(applied)
        except PirlcError:
            raise
        except Exception as error:
            raise failure(SimulatorRaised(name, "step", seed, step, _words(error))) from error
        try:
            gained = float(reward)
        except (TypeError, ValueError):
            gained = math.nan
        if not isfinite(gained):
            raise failure(BadReward(name, seed, step, repr(reward)))
        rewards.append(gained)
        if terminated or truncated:
            break
    else:
        if limit is None:
            raise failure(EndlessEpisode(name, seed, longest))
    return observations, actions, rewards


def _widened(raw: Any) -> NDArray[np.float64] | None:
    try:
        # A copy: some environments return the same array at every step.
        return np.array(raw, dtype=np.float64)
    except (TypeError, ValueError):
        return None


def _shape(raw: Any) -> str:
    if isinstance(raw, np.ndarray):
        return f"an array of shape {raw.shape}"
    return f"a value of type {type(raw).__name__}"


def _words(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


def _words_of(space: Any) -> str:
    return " ".join(str(space).split())
