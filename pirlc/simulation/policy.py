"""What a rollout needs of whatever chooses the actions, and who may run it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class Policy(Protocol):
    """Anything that acts: a program, a compiled controller, an oracle."""

    def reset(self) -> None:
        """Forget the episode before; called once ahead of every episode."""

    def act(self, observation: NDArray[np.float64]) -> tuple[float, ...]:
        """The action for an observation of shape (d,): one number a component of the environment.

        A discrete action is the environment's own number, as a float. NaN in an observation is a
        reading that is missing.
        """


@dataclass(frozen=True)
class Compiled:
    """A policy as a library that a simulator can load; `backend.toolchain` says what is in it.

    `params`: the values of its parameters, in the program's order. `reads`: the components of the
    observation that its actions depend on.
    """

    library: str
    params: tuple[float, ...]
    reads: frozenset[int]


@runtime_checkable
class CompiledPolicy(Policy, Protocol):
    """A policy that a simulator may run by itself: the actions are those of `act`."""

    @property
    def compiled(self) -> Compiled: ...


PolicyFactory = Callable[[], Policy]
"""Makes a policy; picklable (by cloudpickle), since worker processes call it."""


@dataclass(frozen=True)
class Ready:
    """The factory of a policy that can itself be pickled, such as an oracle."""

    policy: Policy

    def __call__(self) -> Policy:
        return self.policy
