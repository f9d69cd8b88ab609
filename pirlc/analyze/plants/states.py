"""Simulators that can be put into a state: Gymnasium's own by `state`, MuJoCo's by `set_state`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirlc.analyze.plants.problems import NotResettable, failure
from pirlc.simulation.environments import Simulator

Vector = NDArray[np.float64]


@dataclass
class Resettable:
    """A simulator whose whole state is a vector that can be read and written.

    `advance(state, action) -> (state of the next step, its observation)`, both in binary64. The
    simulator's own numbers may be binary32: `resolution` is the relative rounding of its state,
    `seen` that of its observations.
    """

    simulator: Simulator
    size: int
    resolution: float
    seen: float
    _shape: tuple[int, ...]
    _dtype: Any
    _discrete: bool
    _mujoco: tuple[int, int] | None

    def state(self) -> Vector:
        inner: Any = self.simulator.unwrapped
        if self._mujoco is None:
            return np.array(inner.state, dtype=np.float64).reshape(-1)
        return np.concatenate([inner.data.qpos, inner.data.qvel]).astype(np.float64)

    def put(self, state: Vector) -> None:
        inner: Any = self.simulator.unwrapped
        if self._mujoco is None:
            inner.state = np.array(state, dtype=np.float64).reshape(self._shape)
        else:
            positions = self._mujoco[0]
            inner.set_state(state[:positions].copy(), state[positions:].copy())

    def advance(self, state: Vector, action: Vector) -> tuple[Vector, Vector]:
        self.put(state)
        applied: Any = np.array(action, dtype=self._dtype)
        if self._discrete:
            applied = round(float(action[0]))
        observation, *_ = self.simulator.unwrapped.step(applied)
        return self.state(), np.array(observation, dtype=np.float64).reshape(-1)


def resettable(simulator: Simulator, identifier: str) -> Resettable:
    """The simulator as a map from states to states.

    It is reset, stepped and put back to see whether its state is all that it remembers. Raises
    PirlcError E0932 where it has no such state, or more memory than that.
    """
    simulator.reset(seed=0)
    inner: Any = simulator.unwrapped
    space: Any = simulator.action_space
    discrete = not hasattr(space, "low")
    mujoco: tuple[int, int] | None = None
    shape: tuple[int, ...] = ()
    if callable(getattr(inner, "set_state", None)) and hasattr(
        getattr(inner, "data", None), "qpos"
    ):
        mujoco = (len(inner.data.qpos), len(inner.data.qvel))
        size = sum(mujoco)
    else:
        try:
            own = np.array(getattr(inner, "state", None), dtype=np.float64)
        except (TypeError, ValueError):
            own = np.zeros(())
        if own.ndim != 1 or not own.size or not np.all(np.isfinite(own)):
            reason = "it has neither a vector `state` nor MuJoCo's `set_state`"
            raise failure(NotResettable(identifier, reason))
        size, shape = own.size, own.shape
    made = Resettable(
        simulator, size, 0.0, 0.0, shape, None if discrete else space.dtype, discrete, mujoco
    )
    _require_memoryless(made, identifier)
    return made


def _require_memoryless(made: Resettable, identifier: str) -> None:
    """A step from a state gives the same, also after other steps from other states."""
    space: Any = made.simulator.action_space
    action = middle_action(space)
    try:
        start = made.state()
        after, reading = made.advance(start, action)
        for seed in (1, 2):
            made.simulator.reset(seed=seed)
            made.simulator.unwrapped.step(
                round(float(action[0])) if made._discrete else np.array(action, dtype=made._dtype)
            )
            again, read_again = made.advance(start, action)
            if not (np.array_equal(after, again) and np.array_equal(reading, read_again)):
                reason = "the same step from the same state does not always end alike"
                raise failure(NotResettable(identifier, reason))
    except (TypeError, ValueError, AttributeError, AssertionError, IndexError) as error:
        words = f"stepping from a state that was set raised {type(error).__name__}: {error}"
        raise failure(NotResettable(identifier, words)) from error
    made.resolution, made.seen = _rounding(after), _rounding(reading)


def _rounding(numbers: Vector) -> float:
    single = np.array_equal(numbers.astype(np.float32).astype(np.float64), numbers)
    return 2.0**-23 if single else 2.0**-52


def middle_action(space: Any) -> Vector:
    """Zero, or the bound next to it; the middle value of a discrete action."""
    if hasattr(space, "low"):
        return np.clip(np.zeros(space.shape), space.low, space.high).astype(np.float64)
    return np.array([float(space.start + (space.n - 1) // 2)])
