"""Whole episodes run by the simulator itself, with a compiled policy inside it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import gymnasium as gym
import numpy as np
from gymnasium.wrappers import OrderEnforcing, PassiveEnvChecker, TimeLimit

from pirlc.diagnostics import PirlcError
from pirlc.simulation.policy import CompiledPolicy, Policy
from pirlc.simulation.problems import (
    BadAction,
    BadReward,
    ControllerNotLoaded,
    EndlessEpisode,
    SimulatorRaised,
    failure,
)

if TYPE_CHECKING:
    from pirlc.simulation.torcs.protocol import Trace

LONGEST_EPISODE = 1_000_000
"""Steps after which an episode without a time limit is taken to be endless."""


@runtime_checkable
class NativeSimulator(Protocol):
    """An environment that can run a compiled policy by itself, exactly as step by step."""

    def race(
        self,
        library: str,
        params: tuple[float, ...] | None,
        seed: int,
        most_steps: int | None,
        beams: bool = True,
    ) -> Trace:
        """The episode that begins with a reset from `seed`, of `most_steps` steps at most."""


def peel(simulator: gym.Env[Any, Any]) -> tuple[gym.Env[Any, Any], int | None]:
    """The environment inside the standard wrappers, and the time limit that they set."""
    limit: int | None = None
    while True:
        # Exactly these classes: one that inherits from them may do more.
        if type(simulator) is TimeLimit:
            own = simulator._max_episode_steps
            limit = own if limit is None else min(limit, own)
        elif type(simulator) not in (OrderEnforcing, PassiveEnvChecker):
            return simulator, limit
        simulator = simulator.env  # type: ignore[attr-defined]


def is_native(simulator: gym.Env[Any, Any]) -> bool:
    """Whether the environment runs compiled policies by itself."""
    return isinstance(peel(simulator)[0], NativeSimulator)


def is_deterministic(simulator: gym.Env[Any, Any]) -> bool:
    """Whether the environment says, by `deterministic`, that its seed changes nothing."""
    return getattr(peel(simulator)[0], "deterministic", False) is True


def run_native(
    simulator: gym.Env[Any, Any], policy: Policy, seed: int, *, everything: bool
) -> Trace | None:
    """The whole episode, or None where the simulator or the policy are not of the kind.

    `everything`: observations are wanted too, and not only the rewards. Raises PirlcError E0514,
    E0515, E0517, E0518, E0540.
    """
    from pirlc.simulation.torcs.protocol import MOST_PARAMS, Status
    from pirlc.simulation.torcs.readings import FIRST_BEAM

    inner, limit = peel(simulator)
    if not isinstance(inner, NativeSimulator) or not isinstance(policy, CompiledPolicy):
        return None
    compiled = policy.compiled
    if len(compiled.params) > MOST_PARAMS:
        return None
    name = "" if inner.spec is None else inner.spec.id
    beams = everything or any(index >= FIRST_BEAM for index in compiled.reads)
    longest = LONGEST_EPISODE if limit is None else limit
    try:
        trace = inner.race(compiled.library, compiled.params, seed, longest, beams)
    except PirlcError:
        raise
    except Exception as error:
        words = f"{type(error).__name__}: {error}"
        raise failure(SimulatorRaised(name, "race", seed, 0, words)) from error
    steps = len(trace.rewards)
    status = trace.status
    if status is Status.NO_CONTROLLER:
        raise failure(ControllerNotLoaded(name))
    if status is Status.BAD_ACTION:
        space = " ".join(str(inner.action_space).split())
        raise failure(BadAction(name, seed, steps, (math.nan,), space))
    if status is Status.TIME_LIMIT and limit is None:
        raise failure(EndlessEpisode(name, seed, longest))
    sound = np.isfinite(trace.rewards)
    if not sound.all():
        step = int(np.argmin(sound))
        raise failure(BadReward(name, seed, step, repr(float(trace.rewards[step]))))
    return trace
