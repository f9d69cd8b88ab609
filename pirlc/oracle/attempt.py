"""One attempt at training: a Stable-Baselines3 learner, evaluated as it goes."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from stable_baselines3 import DDPG, DQN, PPO, SAC, TD3
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecEnv

from pirlc.diagnostics import PirlcError, suggestion
from pirlc.oracle.adapted import Adapted, scaling_of
from pirlc.oracle.dueling import DuelingDoubleDQN, DuelingPolicy
from pirlc.oracle.exploration import acting_from_the_start, exploration_of, set_bias
from pirlc.oracle.export import export
from pirlc.oracle.manifest import Json
from pirlc.oracle.network import NetworkOracle, Scaling
from pirlc.oracle.problems import BadHyperparameter, TrainingFailed, UnsupportedNetwork, failure
from pirlc.oracle.training import FINALISTS, Candidate, Tell, Training
from pirlc.simulation.environments import make

THREADS = 1
"""Of torch: two make networks of this size slower (measured, see docs/oracles.md)."""
_TELL_EVERY = 250
_PROGRESS = 0.01
"""An evaluation counts as better from this relative gain on, when patience is counted."""

_LEARNERS: dict[str, tuple[Any, Any]] = {
    "ppo": (PPO, "MlpPolicy"),
    "dqn": (DQN, "MlpPolicy"),
    "duel-ddqn": (DuelingDoubleDQN, DuelingPolicy),
    "td3": (TD3, "MlpPolicy"),
    "sac": (SAC, "MlpPolicy"),
    "ddpg": (DDPG, "MlpPolicy"),
}
_EXPLORATION = {"noise", "drift", "fade", "bias"}
_OURS = {"net_arch", *_EXPLORATION}
"""Hyperparameters that are not arguments of the learner's constructor as they stand."""
_RESERVED = {
    *("self", "args", "kwargs", "policy", "env", "seed", "device", "verbose", "_init_setup_model"),
    *("policy_kwargs", "action_noise", "tensorboard_log", "replay_buffer_class"),
    *("replay_buffer_kwargs", "rollout_buffer_class", "rollout_buffer_kwargs"),
}
"""Arguments of the constructors that are not for users to set."""


@dataclass(frozen=True)
class Outcome:
    """The best policies of an attempt with their mean returns in the evaluations, best first."""

    best: tuple[Candidate, ...]
    steps: int


Evaluate = Callable[[NetworkOracle], float]


def run_attempt(
    training: Training, seed: int, evaluate: Evaluate, tell: Tell, trust: bool
) -> Outcome:
    """Train once from a seed. Raises PirlcError E0613, E0614, and what the environment raises."""
    settings = training.settings
    scaling = scaling_of(training)
    threads = torch.get_num_threads()
    torch.set_num_threads(THREADS)
    environments: VecEnv | None = None
    try:
        environments = make_vec_env(
            lambda: Adapted(make(training.environment, trust), scaling, training),
            n_envs=settings.copies,
            seed=seed,
        )
        learner = _learner(training, environments, seed)
        watch = _Watch(training, scaling, evaluate, tell)
        learner.learn(settings.steps, callback=watch)
        watch.judge()
    except (KeyboardInterrupt, PirlcError):
        raise
    except Exception as error:
        words = f"{type(error).__name__}: {error}"
        name = training.algorithm
        raise failure(TrainingFailed(name, training.facts.id, words)) from error
    finally:
        torch.set_num_threads(threads)
        if environments is not None:
            environments.close()
    return Outcome(tuple(watch.best), watch.num_timesteps)


def _learner(training: Training, environments: VecEnv, seed: int) -> Any:
    name, given = training.algorithm, dict(training.settings.learner)
    learner, policy = _LEARNERS[name]
    accepted = set(inspect.signature(learner.__init__).parameters)
    if "kwargs" in accepted:
        accepted |= set(inspect.signature(learner.__base__.__init__).parameters)
    accepted = (accepted - _RESERVED) | {"net_arch"}
    if name in ("td3", "ddpg", "sac"):
        accepted |= _EXPLORATION
    for key in given:
        if key not in accepted:
            reason = "Stable-Baselines3 has no argument of that name for it"
            raise failure(BadHyperparameter(name, key, reason, suggestion(key, sorted(accepted))))
    arguments = {
        key: _decoded(name, key, value) for key, value in given.items() if key not in _OURS
    }
    if "net_arch" in given:
        arguments["policy_kwargs"] = {"net_arch": given["net_arch"]}
    exploration = exploration_of(training, given, seed)
    if exploration.noise is not None:
        arguments["action_noise"] = exploration.noise
    if exploration.bias is not None:
        learner = acting_from_the_start(learner)
    try:
        made = learner(policy, environments, seed=seed, device="cpu", **arguments)
    except (TypeError, ValueError, AssertionError) as error:
        listed = ", ".join(sorted(given))
        raise failure(BadHyperparameter(name, listed, str(error), None)) from error
    if exploration.bias is not None:
        set_bias(made.policy, exploration.bias)
    return made


def _decoded(algorithm: str, key: str, value: Json) -> Any:
    if not isinstance(value, str) or not value.startswith("lin_"):
        return value
    try:
        start = float(value.removeprefix("lin_"))
    except ValueError:
        reason = f"{value!r} is not of the form 'lin_0.001'"
        raise failure(BadHyperparameter(algorithm, key, reason, None)) from None
    return lambda remaining: remaining * start


class _Watch(BaseCallback):
    """Evaluates, keeps the best, and says when to stop."""

    def __init__(
        self, training: Training, scaling: Scaling, evaluate: Evaluate, tell: Tell
    ) -> None:
        super().__init__()
        self.training, self.scaling = training, scaling
        self.evaluate, self.tell = evaluate, tell
        self.best: list[Candidate] = []
        self._mark = -math.inf
        self._stale = self._full = self._judged = self._told = 0

    def judge(self) -> bool:
        """Evaluate the policy as it is now; False when training need not go on."""
        settings = self.training.settings
        self._judged = self.num_timesteps
        try:
            oracle = export(self.model.policy, self.training.facts.actions, self.scaling)
        except ValueError as error:
            raise failure(UnsupportedNetwork(self.training.algorithm, str(error))) from error
        if not all(np.isfinite(w).all() for w in (*oracle.network.weights, *oracle.network.biases)):
            raise ArithmeticError("the network's weights are no longer finite")
        now = self.evaluate(oracle)
        # Sorting is stable: of equal ones the first seen stays ahead.
        self.best = sorted([*self.best, (now, oracle)], key=lambda c: -c[0])[:FINALISTS]
        best_return = self.best[0][0]
        self._full = self._full + 1 if settings.enough is not None and now >= settings.enough else 0
        if best_return > self._mark + _PROGRESS * abs(self._mark) or self._mark == -math.inf:
            self._mark, self._stale = best_return, 0
        else:
            self._stale += 1
        good = settings.acceptable is not None and best_return >= settings.acceptable
        return self._full < 2 and not (good and self._stale >= settings.patience)

    def _on_step(self) -> bool:
        taken = self.num_timesteps
        if taken - self._told >= _TELL_EVERY:
            self._told = taken
            recent = [episode["r"] for episode in self.model.ep_info_buffer or ()]
            scale = self.training.settings.reward_scale
            mean = math.fsum(recent) / len(recent) / scale if recent else None
            self.tell(taken, mean, self.best[0][0] if self.best else None)
        if taken - self._judged >= self.training.settings.evaluate_every:
            return self.judge()
        return True
