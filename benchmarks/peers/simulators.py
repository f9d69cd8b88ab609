"""Gymnasium's classic-control environments, many episodes at once, bit for bit.

Training and judging trees takes some 10^9 steps, too many for one environment at a time. Each class
here repeats its environment's arithmetic in the same order over arrays; `returns_of` and
`episodes_of` start from Gymnasium's own seeded resets. Only the last bit of Pendulum's costs
may differ. Tests compare whole episodes with Gymnasium's, and every record repeats some of its own
there (`benchmarks.peers.evaluation`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pirlc.ir.policy import Environment
from pirlc.simulation.workers import shared_simulator

Array = NDArray[np.float64]

Batch = Callable[[Array], Array]
"""Actions (N, k) for observations (N, d)."""

Which = NDArray[np.intp]
Various = Callable[[Array, Which], Array]
"""The same for policies that differ from episode to episode: the numbers of those that run."""


class Dynamics(Protocol):
    def observe(self, state: Array) -> Array:
        """What is read of states (N, s): (N, d), numbers of binary32."""

    def step(self, state: Array, action: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """The states after actions (N, k) of the environment's dtype; rewards; whether it ends."""


def _binary32(*columns: Array) -> Array:
    return np.stack(columns, axis=1).astype(np.float32).astype(np.float64)


class CartPole:
    def observe(self, state: Array) -> Array:
        return state.astype(np.float32).astype(np.float64)

    def step(self, state: Array, action: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        x, x_dot, theta, theta_dot = np.ascontiguousarray(state.T)
        force = np.where(action[:, 0] == 1, 10.0, -10.0)
        total, polemass_length = 0.1 + 1.0, 0.1 * 0.5
        cos, sin = np.cos(theta), np.sin(theta)
        temp = (force + polemass_length * np.square(theta_dot) * sin) / total
        thetaacc = (9.8 * sin - cos * temp) / (0.5 * (4.0 / 3.0 - 0.1 * np.square(cos) / total))
        xacc = temp - polemass_length * thetaacc * cos / total
        x, x_dot = x + 0.02 * x_dot, x_dot + 0.02 * xacc
        theta, theta_dot = theta + 0.02 * theta_dot, theta_dot + 0.02 * thetaacc
        most = 12 * 2 * math.pi / 360
        ends = (x < -2.4) | (x > 2.4) | (theta < -most) | (theta > most)
        return np.stack([x, x_dot, theta, theta_dot], axis=1), np.ones(len(x)), ends


class MountainCar:
    def observe(self, state: Array) -> Array:
        return state.astype(np.float32).astype(np.float64)

    def step(self, state: Array, action: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        position, velocity = state[:, 0], state[:, 1]
        # Gymnasium takes the C library's cosine here, which numpy's need not equal.
        cosine = np.array([math.cos(3 * x) for x in position.tolist()])
        velocity = velocity + ((action[:, 0] - 1) * 0.001 + cosine * (-0.0025))
        velocity = np.clip(velocity, -0.07, 0.07)
        position = np.clip(position + velocity, -1.2, 0.6)
        velocity = np.where((position == -1.2) & (velocity < 0), 0.0, velocity)
        ends = (position >= 0.5) & (velocity >= 0)
        return np.stack([position, velocity], axis=1), np.full(len(position), -1.0), ends


class Acrobot:
    def observe(self, state: Array) -> Array:
        a, b = np.ascontiguousarray(state[:, 0]), np.ascontiguousarray(state[:, 1])
        return _binary32(np.cos(a), np.sin(a), np.cos(b), np.sin(b), state[:, 2], state[:, 3])

    def step(self, state: Array, action: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        torque = action[:, 0] - 1.0
        dt = 0.2
        y0 = np.ascontiguousarray(state.T)
        k1 = self._slope(y0, torque)
        k2 = self._slope(y0 + dt / 2.0 * k1, torque)
        k3 = self._slope(y0 + dt / 2.0 * k2, torque)
        k4 = self._slope(y0 + dt * k3, torque)
        theta1, theta2, speed1, speed2 = y0 + dt / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4)
        theta1, theta2 = _wrapped(theta1), _wrapped(theta2)
        speed1 = np.clip(speed1, -4 * np.pi, 4 * np.pi)
        speed2 = np.clip(speed2, -9 * np.pi, 9 * np.pi)
        ends = -np.cos(theta1) - np.cos(theta2 + theta1) > 1.0
        new = np.stack([theta1, theta2, speed1, speed2], axis=1)
        return new, np.where(ends, 0.0, -1.0), ends

    @staticmethod
    def _slope(y: Array, torque: Array) -> Array:
        theta1, theta2, dtheta1, dtheta2 = y
        lc, g = 0.5, 9.8
        cos2, sin2 = np.cos(theta2), np.sin(theta2)
        d1 = lc**2 + (1.0 + lc**2 + 2 * lc * cos2) + 1.0 + 1.0
        d2 = lc**2 + lc * cos2 + 1.0
        phi2 = lc * g * np.cos(theta1 + theta2 - np.pi / 2.0)
        phi1 = (
            -lc * dtheta2**2 * sin2
            - 2 * lc * dtheta2 * dtheta1 * sin2
            + (lc + 1.0) * g * np.cos(theta1 - np.pi / 2)
            + phi2
        )
        ddtheta2 = (torque + d2 / d1 * phi1 - lc * dtheta1**2 * sin2 - phi2) / (
            lc**2 + 1.0 - d2**2 / d1
        )
        ddtheta1 = -(d2 * ddtheta2 + phi1) / d1
        return np.stack([dtheta1, dtheta2, ddtheta1, ddtheta2])


def _wrapped(angle: Array) -> Array:
    around = np.pi - (-np.pi)
    while (over := angle > np.pi).any():
        angle = np.where(over, angle - around, angle)
    while (under := angle < -np.pi).any():
        angle = np.where(under, angle + around, angle)
    return angle


class Pendulum:
    def observe(self, state: Array) -> Array:
        theta = np.ascontiguousarray(state[:, 0])
        return _binary32(np.cos(theta), np.sin(theta), state[:, 1])

    def step(self, state: Array, action: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        theta, speed = np.ascontiguousarray(state.T)
        # The environment's arithmetic with the torque is partly in binary32, as the action is.
        torque = np.clip(action[:, 0].astype(np.float32), np.float32(-2.0), np.float32(2.0))
        angle = ((theta + np.pi) % (2 * np.pi)) - np.pi
        squared = (np.float32(0.001) * (torque**2)).astype(np.float64)
        costs = angle**2 + 0.1 * speed**2 + squared
        push = (np.float32(3.0) * torque).astype(np.float64)
        speed = np.clip(speed + (15.0 * np.sin(theta) + push) * 0.05, -8.0, 8.0)
        theta = theta + speed * 0.05
        return np.stack([theta, speed], axis=1), -costs, np.zeros(len(theta), bool)


@dataclass(frozen=True)
class Kind:
    """An environment and its limit of steps."""

    dynamics: Dynamics
    limit: int


KINDS = {
    "CartPole-v0": Kind(CartPole(), 200),
    "CartPole-v1": Kind(CartPole(), 500),
    "MountainCar-v0": Kind(MountainCar(), 200),
    "Acrobot-v1": Kind(Acrobot(), 500),
    "Pendulum-v1": Kind(Pendulum(), 200),
}


@lru_cache(maxsize=64)
def _starts(environment: str, seeds: Sequence[int]) -> Array:
    simulator: Any = shared_simulator(Environment(environment)).unwrapped
    states = []
    for seed in seeds:
        simulator.reset(seed=seed)
        states.append(np.array(simulator.state, dtype=np.float64))
    return np.array(states)


def starts(environment: str, seeds: Sequence[int]) -> Array:
    """The states (N, s) that Gymnasium begins with."""
    return _starts(environment, seeds if isinstance(seeds, range) else tuple(seeds)).copy()


def returns_of(environment: str, policy: Batch, seeds: Sequence[int]) -> Array:
    """The return from each seed, in order."""
    return returns_of_various(environment, lambda x, _: policy(x), seeds)


def returns_of_various(environment: str, policy: Various, seeds: Sequence[int]) -> Array:
    """The return of each episode; `seeds` may repeat."""
    return _play(environment, policy, seeds, None)


def episodes_of(environment: str, policy: Batch, seeds: Sequence[int]) -> tuple[Array, Array]:
    """All observations (T, d) of the episodes, step by step, and the returns."""
    seen: list[Array] = []
    returns = _play(environment, lambda x, _: policy(x), seeds, seen)
    return np.concatenate(seen), returns


def _play(
    environment: str, policy: Various, seeds: Sequence[int], seen: list[Array] | None
) -> Array:
    kind = KINDS[environment]
    state = starts(environment, seeds)
    running = np.arange(len(state))
    rewards: list[tuple[Which, Array]] = []
    for _ in range(kind.limit):
        observation = kind.dynamics.observe(state)
        if seen is not None:
            seen.append(observation)
        state, reward, ends = kind.dynamics.step(state, policy(observation, running))
        rewards.append((running, reward))
        if ends.any():
            state, running = state[~ends], running[~ends]
            if not len(running):
                break
    table = np.zeros((len(rewards), len(seeds)))
    for row, (who, reward) in zip(table, rewards, strict=True):
        row[who] = reward
    if environment == "Pendulum-v1":
        # Only here are the rewards not whole, and the sum's rounding counts.
        return np.array([math.fsum(column) for column in table.T.tolist()])
    total: Array = table.sum(axis=0)
    return total
