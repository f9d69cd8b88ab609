"""Simulators that can be put into a state: Gymnasium's own by `state`, MuJoCo's by `set_state`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirlc.analyze.plants.problems import NotResettable, failure
from pirlc.diagnostics import PirlcError
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
    identifier: str
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
        """Raises PirlcError E0932 where the simulator fails or leaves the finite numbers."""
        applied: Any = np.array(action, dtype=self._dtype)
        if self._discrete:
            applied = round(float(action[0]))
        try:
            self.put(state)
            observation, *_ = self.simulator.unwrapped.step(applied)
            after = self.state()
            reading = np.array(observation, dtype=np.float64).reshape(-1)
        except PirlcError:
            raise
        except Exception as error:
            words = f"stepping from a state that was set raised {type(error).__name__}: {error}"
            raise failure(NotResettable(self.identifier, words)) from error
        if after.shape != state.shape or not np.all(np.isfinite(np.concatenate([after, reading]))):
            words = "a step from a state that was set did not lead to a finite state of its kind"
            raise failure(NotResettable(self.identifier, words))
        return after, reading


def resettable(simulator: Simulator, identifier: str) -> Resettable:
    """The simulator as a map from states to states.

    It is reset, stepped and put back to see whether its state is all that it remembers. Raises
    PirlcError E0932 where it has no such state, or more memory than that.
    """
    try:
        simulator.reset(seed=0)
    except PirlcError:
        raise
    except Exception as error:
        words = f"its reset raised {type(error).__name__}: {error}"
        raise failure(NotResettable(identifier, words)) from error
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
        simulator,
        identifier,
        size,
        0.0,
        0.0,
        shape,
        None if discrete else space.dtype,
        discrete,
        mujoco,
    )
    _require_memoryless(made)
    return made


def _require_memoryless(made: Resettable) -> None:
    """A step from a state gives the same, also after other steps from other states."""
    action = middle_action(made.simulator.action_space)
    start = made.state()
    after, reading = made.advance(start, action)
    for seed in (1, 2):
        made.simulator.reset(seed=seed)
        made.advance(made.state(), action)
        again, read_again = made.advance(start, action)
        # Solvers that start from their last solution may differ in the last digits.
        if not (_alike(after, again) and _alike(reading, read_again)):
            reason = "the same step from the same state does not always end alike"
            raise failure(NotResettable(made.identifier, reason))
    made.resolution, made.seen = _rounding(after), _rounding(reading)


def _alike(one: Vector, other: Vector) -> bool:
    return one.shape == other.shape and np.allclose(one, other, rtol=1e-9, atol=1e-9)


def _rounding(numbers: Vector) -> float:
    single = np.array_equal(numbers.astype(np.float32).astype(np.float64), numbers)
    return 2.0**-23 if single else 2.0**-52


def middle_action(space: Any) -> Vector:
    """Zero, or the bound next to it; the middle value of a discrete action."""
    if hasattr(space, "low"):
        return np.clip(np.zeros(space.shape), space.low, space.high).astype(np.float64)
    return np.array([float(space.start + (space.n - 1) // 2)])
