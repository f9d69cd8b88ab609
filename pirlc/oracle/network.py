"""Oracles as data: a multilayer perceptron evaluated by numpy in binary32."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, assert_never

import numpy as np
from numpy.typing import NDArray

from pirlc.simulation.policy import Policy

Observations = NDArray[np.float64]


class Oracle(Policy, Protocol):
    """A policy without memory that can also be asked about many observations at once."""

    def actions(self, observations: Observations) -> NDArray[np.float64]:
        """The actions, shape (N, k), for observations of shape (N, d).

        Discrete actions (k = 1) are the environment's own numbers. Readings that are not finite
        count as 0.
        """

    def values(self, observations: Observations) -> NDArray[np.float64] | None:
        """The estimated return of each discrete action, shape (N, |A|), in the order of the values.

        None for an oracle that does not estimate them.
        """


ACTIVATIONS = ("relu", "tanh")


@dataclass(frozen=True)
class Scaling:
    """Observations enter the network as ``(x - offset) / scale``, each of shape (d,)."""

    offset: NDArray[np.float32]
    scale: NDArray[np.float32]


@dataclass(frozen=True)
class Network:
    """Layers ``W x + b`` with one activation between them, none after the last.

    `weights[i]` has shape (outputs, inputs), `biases[i]` shape (outputs,).
    """

    scaling: Scaling
    weights: tuple[NDArray[np.float32], ...]
    biases: tuple[NDArray[np.float32], ...]
    activation: str

    @property
    def inputs(self) -> int:
        return int(self.weights[0].shape[1])

    @property
    def outputs(self) -> int:
        return int(self.weights[-1].shape[0])

    @property
    def layers(self) -> tuple[int, ...]:
        """The widths, from the observation to the output."""
        return (self.inputs, *(int(weight.shape[0]) for weight in self.weights))

    def forward(self, observations: Observations) -> NDArray[np.float32]:
        """Outputs, shape (N, m), for observations of shape (N, d)."""
        x = np.asarray(observations, dtype=np.float32)
        if not np.isfinite(x).all():
            x = np.where(np.isfinite(x), x, np.float32(0))
        x = (x - self.scaling.offset) / self.scaling.scale
        last = len(self.weights) - 1
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = x @ weight.T
            x += bias
            if i < last:
                x = np.tanh(x) if self.activation == "tanh" else np.maximum(x, np.float32(0))
        return x


@dataclass(frozen=True)
class Greedy:
    """The action is the value with the largest output, the first of equal ones.

    `rated`: the outputs are estimated returns (as DQN's are), not mere preferences.
    """

    values: tuple[int, ...]
    rated: bool


@dataclass(frozen=True)
class Bounded:
    """The outputs are the action's components.

    `squashed`: through tanh and onto `reach`; then clipped to [lower, upper], which is all that is
    done to others. `reach` is [lower, upper] unless it is given; a wider one makes the bounds
    themselves easy to choose.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    squashed: bool
    reach: tuple[tuple[float, ...], tuple[float, ...]] | None = None


Head = Greedy | Bounded


def head_width(head: Head) -> int:
    """The number of outputs that a network with this head has."""
    match head:
        case Greedy(values):
            return len(values)
        case Bounded(lower):
            return len(lower)
        case _:
            assert_never(head)


@dataclass(frozen=True)
class NetworkOracle:
    """An oracle in pirlc's own format."""

    network: Network
    head: Head

    def actions(self, observations: Observations) -> NDArray[np.float64]:
        outputs = self.network.forward(observations)
        match self.head:
            case Greedy(values):
                known = np.array(values, dtype=np.float64)
                chosen: NDArray[np.float64] = known[outputs.argmax(axis=1)].reshape(-1, 1)
                return chosen
            case Bounded(lower, upper, squashed, reach):
                low, high = np.asarray(lower), np.asarray(upper)
                wide: NDArray[np.float64] = outputs.astype(np.float64)
                if squashed:
                    least, most = map(np.asarray, reach or (lower, upper))
                    wide = least + 0.5 * (np.tanh(wide) + 1.0) * (most - least)
                within: NDArray[np.float64] = np.minimum(np.maximum(wide, low), high)
                return within
            case _:
                assert_never(self.head)

    def values(self, observations: Observations) -> NDArray[np.float64] | None:
        if isinstance(self.head, Greedy) and self.head.rated:
            return self.network.forward(observations).astype(np.float64)
        return None

    def reset(self) -> None:
        """Nothing to forget."""

    def act(self, observation: Observations) -> tuple[float, ...]:
        return tuple(self.actions(observation[np.newaxis])[0].tolist())
