"""From a Stable-Baselines3 policy to the network that numpy evaluates."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import nn

from pirlc.oracle.dueling import DuelingHead
from pirlc.oracle.network import Bounded, Greedy, Head, Network, NetworkOracle, Scaling
from pirlc.simulation.environments import BoxActions, DiscreteActions

Arrays = list[tuple[NDArray[np.float32], NDArray[np.float32]]]

_ACTIVATIONS: dict[type[nn.Module], str] = {nn.ReLU: "relu", nn.Tanh: "tanh"}


def export(
    policy: Any, actions: DiscreteActions | BoxActions, scaling: Scaling | None = None
) -> NetworkOracle:
    """The acting network of a PPO, DQN, TD3, DDPG, SAC or dueling DQN policy.

    A policy that was trained on wider actions than `actions` has them clipped.
    The most probable action stands for PPO's and SAC's distributions. A ValueError says why a
    policy is not a plain multilayer perceptron.
    """
    features = getattr(policy, "features_extractor_class", None)
    if features is not None and features.__name__ != "FlattenExtractor":
        raise ValueError(f"its features come from {features.__name__}")
    modules, squashed, rated = _acting_modules(policy)
    pairs, activation = _linear_layers(modules)
    if scaling is None:
        inputs = pairs[0][0].shape[1]
        scaling = Scaling(np.zeros(inputs, np.float32), np.ones(inputs, np.float32))
    network = Network(
        scaling, tuple(weight for weight, _ in pairs), tuple(bias for _, bias in pairs), activation
    )
    head: Head
    match actions:
        case DiscreteActions():
            head = Greedy(actions.values, rated)
        case BoxActions(lower, upper):
            space = policy.action_space
            learned = (tuple(map(float, space.low)), tuple(map(float, space.high)))
            as_they_are = (tuple(map(_binary32, lower)), tuple(map(_binary32, upper)))
            plain = not squashed or learned in (as_they_are, (lower, upper))
            head = Bounded(lower, upper, squashed, None if plain else learned)
    return NetworkOracle(network, head)


def _acting_modules(policy: Any) -> tuple[list[nn.Module], bool, bool]:
    """The modules from features to action, whether tanh follows, whether they rate actions."""
    if hasattr(policy, "q_net"):
        return list(policy.q_net.q_net), False, True
    if hasattr(policy, "mlp_extractor"):
        if getattr(policy, "squash_output", False):
            raise ValueError("its actions are squashed PPO actions")
        return [*policy.mlp_extractor.policy_net, policy.action_net], False, False
    if hasattr(policy, "actor") and hasattr(policy.actor, "latent_pi"):
        return [*policy.actor.latent_pi, policy.actor.mu], True, False
    if hasattr(policy, "actor"):
        modules = list(policy.actor.mu)
        if isinstance(modules[-1], nn.Tanh):
            return modules[:-1], True, False
    raise ValueError(f"{type(policy).__name__} is not a policy of a known algorithm")


def _linear_layers(modules: list[nn.Module]) -> tuple[Arrays, str]:
    pairs: Arrays = []
    activations: set[str] = set()
    for position, module in enumerate(modules):
        match module:
            case nn.Linear():
                if len(pairs) != len(modules[:position]) - len(pairs):
                    raise ValueError("layers and activations do not alternate")
                pairs.append((_array(module.weight), _array(module.bias)))
            case DuelingHead():
                pairs.append(_folded(module))
            case _ if type(module) in _ACTIVATIONS:
                activations.add(_ACTIVATIONS[type(module)])
            case _:
                raise ValueError(f"it contains a layer of kind {type(module).__name__}")
    if len(activations) > 1 or not pairs or len(pairs) * 2 - 1 != len(modules):
        raise ValueError("layers and activations do not alternate, or differ in kind")
    return pairs, activations.pop() if activations else "relu"


def _folded(head: DuelingHead) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Value + advantage - mean advantage as the one linear layer that it is."""
    weight, bias = _array(head.advantage.weight), _array(head.advantage.bias)
    wide, offset = weight.astype(np.float64), bias.astype(np.float64)
    wide = wide - wide.mean(axis=0) + _array(head.value.weight)
    offset = offset - offset.mean() + _array(head.value.bias)
    return wide.astype(np.float32), offset.astype(np.float32)


def _binary32(number: float) -> float:
    return float(np.float32(number))


def _array(parameter: Any) -> NDArray[np.float32]:
    return np.array(parameter.detach().cpu().numpy(), dtype=np.float32)
