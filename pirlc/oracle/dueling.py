"""Dueling double DQN, the oracle of the paper, on top of Stable-Baselines3's DQN.

Three changes to DQN: the network's two heads (Wang et al., 2016), the double estimate of the
target (van Hasselt et al., 2016), and exploration that holds a random action for a random number
of steps (Dabney et al., 2021), without which MountainCar's flag is hardly ever reached.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import DQN
from stable_baselines3.common.noise import ActionNoise
from stable_baselines3.common.torch_layers import create_mlp
from stable_baselines3.dqn.policies import DQNPolicy, QNetwork
from torch import Tensor, nn
from torch.nn import functional

LONGEST_HOLD = 64
"""The most steps that a random action is held for."""


class DuelingHead(nn.Module):
    """Q = value + advantage - mean advantage, both linear in the features."""

    def __init__(self, features: int, actions: int) -> None:
        super().__init__()
        self.value = nn.Linear(features, 1)
        self.advantage = nn.Linear(features, actions)

    def forward(self, features: Tensor) -> Tensor:
        advantage: Tensor = self.advantage(features)
        value: Tensor = self.value(features)
        return value + advantage - advantage.mean(dim=1, keepdim=True)


class DuelingNetwork(QNetwork):
    """DQN's network with its last layer parted into value and advantage."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        trunk = create_mlp(self.features_dim, -1, self.net_arch, self.activation_fn)
        width = self.net_arch[-1] if self.net_arch else self.features_dim
        self.q_net = nn.Sequential(*trunk, DuelingHead(width, int(self.action_space.n)))


class DuelingPolicy(DQNPolicy):
    def make_q_net(self) -> DuelingNetwork:
        arguments = self._update_features_extractor(self.net_args, features_extractor=None)
        return DuelingNetwork(**arguments).to(self.device)


class DuelingDoubleDQN(DQN):
    """DQN with the double target and held exploration.

    `hold` is the exponent of the law of the holding time n, proportional to ``n ** -hold``;
    `None` draws a new action at every exploring step, as DQN does.
    """

    def __init__(self, *args: Any, hold: float | None = 2.0, **kwargs: Any) -> None:
        self.hold = hold
        super().__init__(*args, **kwargs)
        self._holding = np.random.default_rng(self.seed)
        self._left = np.zeros(self.n_envs, dtype=np.int64)
        self._held = np.zeros(self.n_envs, dtype=np.int64)

    def _sample_action(
        self,
        learning_starts: int,
        action_noise: ActionNoise | None = None,  # noqa: ARG002
        n_envs: int = 1,
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        assert self._last_obs is not None
        warming_up = self.num_timesteps < learning_starts
        if warming_up:
            actions = np.zeros(n_envs, dtype=np.int64)
        else:
            actions = self.policy.predict(self._last_obs, deterministic=True)[0]
        for i in range(n_envs):
            if self._left[i] == 0 and (
                warming_up or self._holding.random() < self.exploration_rate
            ):
                self._held[i] = self._holding.integers(self.action_space.n)  # type: ignore[attr-defined]
                drawn = 1 if self.hold is None else self._holding.zipf(self.hold)
                self._left[i] = min(int(drawn), LONGEST_HOLD)
            if self._left[i] > 0:
                actions[i] = self._held[i]
                self._left[i] -= 1
        return actions, actions

    def train(self, gradient_steps: int, batch_size: int = 100) -> None:
        """DQN.train with the online network choosing the action that the target network rates."""
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.policy.optimizer)
        assert self.replay_buffer is not None
        for _ in range(gradient_steps):
            batch = self.replay_buffer.sample(batch_size, env=self._vec_normalize_env)
            discounts = self.gamma if batch.discounts is None else batch.discounts
            with torch.no_grad():
                chosen = self.q_net(batch.next_observations).argmax(dim=1, keepdim=True)
                following = self.q_net_target(batch.next_observations).gather(1, chosen)
                target = batch.rewards + (1 - batch.dones) * discounts * following
            estimate = self.q_net(batch.observations).gather(1, batch.actions.long())
            loss = functional.smooth_l1_loss(estimate, target)
            self.policy.optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            nn.utils.clip_grad_norm_(self.policy.parameters(), self.max_grad_norm)
            self.policy.optimizer.step()
        self._n_updates += gradient_steps
