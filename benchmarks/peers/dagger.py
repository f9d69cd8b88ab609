"""VIPER (Bastani, Pu and Solar-Lezama, 2018): decision trees from an oracle's Q values.

Algorithm 1 of the paper, with its names:

    D <- {}; pi_0 <- pi*
    for i in 1..N:
        D <- D and M trajectories of pi_{i-1}, each state with the oracle's action
        D' <- resample D with probability proportional to l(s) = V(s) - min_a Q(s, a)
        pi_i <- a tree trained on D'
    the best of pi_1..pi_N by cross-validation

The size of a tree is limited by its leaves, one run of the algorithm for each limit. Without Q
values all weights are 1: plain DAgger (Ross et al., 2011), which is another method; between them
stands `viper-logits`, for oracles trained by policy gradients.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from benchmarks.peers.simulators import KINDS, episodes_of, returns_of
from benchmarks.peers.tasks import Array, Task, labels
from benchmarks.peers.trees import Tree, from_sklearn, predict
from pirlc.oracle.network import Greedy, NetworkOracle

VALIDATION = range(600_000, 600_200)
"""Episodes that every tree is judged on."""
RUN_OFF = range(610_000, 611_000)
"""Episodes that decide among the best of them."""
_TRAINING = 700_000
"""The first of the seeds of collected episodes; those of the evaluation start at 1,000,000."""


@dataclass(frozen=True)
class Settings:
    """`iterations`: N; `episodes`: M; `samples`: the size of D'; `finalists`: of the run-off."""

    iterations: int = 30
    episodes: int = 20
    samples: int = 20_000
    finalists: int = 5


@dataclass(frozen=True)
class Grown:
    """A tree; `validation` is its mean return in the run-off; `iteration`, where it came from;
    `fitted`, scikit-learn's own."""

    tree: Tree
    fitted: Any
    validation: float
    iteration: int


class NoValues(SystemExit):
    """VIPER was asked for with an oracle that has no Q values."""

    def __init__(self, environment: str, algorithm: str) -> None:
        super().__init__(
            f"viper on {environment}: its weights are max Q - min Q, and an oracle trained by "
            f"{algorithm} has no Q values; use dagger-tree, or an oracle of dqn or duel-ddqn"
        )


Weigh = Callable[[Array], Array]
"""The weight (N,) of each observation (N, d)."""


def q_weights(oracle: NetworkOracle, environment: str, algorithm: str) -> Weigh:
    """l(s) = max Q - min Q. Raises NoValues (a SystemExit)."""
    if oracle.values(np.zeros((1, oracle.network.inputs))) is None:
        raise NoValues(environment, algorithm)

    def weigh(observations: Array) -> Array:
        values = oracle.values(observations)
        assert values is not None
        spread: Array = values.max(axis=1) - values.min(axis=1)
        return spread

    return weigh


def logit_weights(oracle: NetworkOracle, environment: str, algorithm: str) -> Weigh:
    """Log-probabilities of a policy gradient's network in the place of Q values, as maximum-entropy
    reinforcement learning reads them. Raises NoValues for one without probabilities."""
    head = oracle.head
    if not isinstance(head, Greedy) or head.rated:
        raise NoValues(environment, algorithm)

    def weigh(observations: Array) -> Array:
        # The softmax's denominator is the same for all actions.
        logits = oracle.network.forward(observations).astype(np.float64)
        spread: Array = logits.max(axis=1) - logits.min(axis=1)
        return spread

    return weigh


def unit_weights(observations: Array) -> Array:
    return np.ones(len(observations))


def grow(
    task: Task,
    oracle: NetworkOracle,
    weigh: Weigh,
    most_leaves: int,
    seed: int,
    settings: Settings,
) -> Grown:
    """The best tree with so many leaves at most."""
    generator = np.random.default_rng([seed, most_leaves])
    where = task.environment
    policy: Callable[[Array], Array] = oracle.actions
    seen: list[Array] = []
    wanted: list[Array] = []
    weights: list[Array] = []
    judged: list[Grown] = []
    ceiling = float(KINDS[where].limit) if where.startswith("CartPole") else np.inf
    for iteration in range(1, settings.iterations + 1):
        first = _TRAINING + (seed * 1_000 + iteration) * settings.episodes
        observations, _ = episodes_of(where, policy, range(first, first + settings.episodes))
        seen.append(observations)
        wanted.append(labels(oracle, observations))
        weights.append(weigh(observations))
        fitted = _fit(task, seen, wanted, weights, most_leaves, settings.samples, generator)
        policy = partial(predict, fitted)
        mean = float(returns_of(where, policy, VALIDATION).mean())
        judged.append(Grown(from_sklearn(fitted), fitted, mean, iteration))
        if mean >= ceiling and _run_off(where, judged[-1]).validation >= ceiling:
            break
    best = sorted(judged, key=lambda one: -one.validation)[: settings.finalists]
    return max((_run_off(where, one) for one in best), key=lambda one: one.validation)


def _run_off(environment: str, one: Grown) -> Grown:
    returns = returns_of(environment, partial(predict, one.fitted), RUN_OFF)
    return Grown(one.tree, one.fitted, float(returns.mean()), one.iteration)


def _fit(
    task: Task,
    seen: list[Array],
    wanted: list[Array],
    weights: list[Array],
    most_leaves: int,
    samples: int,
    generator: np.random.Generator,
) -> Any:
    from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor

    x, y, w = np.concatenate(seen), np.concatenate(wanted), np.concatenate(weights)
    total = w.sum()
    chances = w / total if total > 0 else None
    chosen = generator.choice(len(x), min(samples, len(x)), p=chances)
    kind = DecisionTreeClassifier if task.discrete else DecisionTreeRegressor
    learner = kind(max_leaf_nodes=most_leaves, random_state=int(generator.integers(2**31)))
    return learner.fit(x[chosen].astype(np.float32), y[chosen])
