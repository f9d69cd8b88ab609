"""A linear policy tuned on the return by CMA-ES: no oracle, no structure but the sensors.

Two readings of "linear": `cma-linear` pushes one way or the other by the sign of one weighted sum
(for a continuous action, takes the sum, clipped); `cma-argmax` has a sum for each discrete action
and takes the largest.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np

from benchmarks.peers.dagger import RUN_OFF
from benchmarks.peers.simulators import Which, returns_of_various
from benchmarks.peers.tasks import Array, Task
from pirlc.ir.operators import Operator
from pirlc.ir.policy import Program
from pirlc.ir.terms import Apply, If, Literal, Term

_TRAINING = 800_000


@dataclass(frozen=True)
class Settings:
    """`population` candidates are compared on the same `episodes`, new ones each generation."""

    restarts: int = 2
    generations: int = 50
    population: int = 16
    episodes: int = 32
    finalists: int = 4


@dataclass(frozen=True)
class Linear:
    """`rows`: (r, d + 1), the weights of the readings and a constant; r is 1, or one a value."""

    rows: Array
    validation: float


def tune(task: Task, rows: int, seed: int, settings: Settings) -> Linear:
    """The best weights, judged on the episodes of the trees' run-off."""
    from cmaes import CMA

    width = len(task.scales) + 1
    finalists: list[Array] = []
    for restart in range(settings.restarts):
        start = np.zeros(rows * width)
        search = CMA(
            mean=start,
            sigma=1.0,
            seed=seed * 100 + restart,
            population_size=settings.population,
        )
        scored: list[tuple[float, Array]] = []
        for generation in range(settings.generations):
            asked = np.array([search.ask() for _ in range(settings.population)])
            first = _TRAINING + (seed * 1_000 + restart * 200 + generation) * settings.episodes
            means = _means(task, asked, rows, range(first, first + settings.episodes))
            search.tell([(x, -mean) for x, mean in zip(asked, means.tolist(), strict=True)])
            scored += zip(means.tolist(), asked, strict=True)
        # Late candidates were judged on fewer episodes each, but they are many and alike.
        late = scored[-settings.population * 10 :]
        finalists += [x for _, x in sorted(late, key=lambda one: -one[0])[: settings.finalists]]
        finalists.append(search._mean.copy())
    judged = _means(task, np.array(finalists), rows, RUN_OFF)
    best = int(judged.argmax())
    return Linear(_scaled(task, finalists[best], rows), float(judged[best]))


def _means(task: Task, candidates: Array, rows: int, seeds: range) -> Array:
    """The mean return of each candidate (c, n) on the same episodes."""
    weights = np.array([_scaled(task, x, rows) for x in candidates])
    count = len(seeds)

    def policy(x: Array, which: Which) -> Array:
        mine = weights[which // count]
        sums = np.einsum("nrd,nd->nr", mine[:, :, :-1], x) + mine[:, :, -1]
        return _actions(task, sums)

    repeated = list(seeds) * len(candidates)
    returns = returns_of_various(task.environment, policy, repeated).reshape(-1, count)
    means: Array = returns.mean(axis=1)
    return means


def _scaled(task: Task, x: Array, rows: int) -> Array:
    """The search is in units of the sensors' ranges, and of the action's."""
    weights: Array = x.reshape(rows, -1) / np.append(task.scales, 1.0)
    # A sum of the readings' size reaches the bounds of a continuous action.
    return weights if task.discrete else weights * task.bounds[1]


def _actions(task: Task, sums: Array) -> Array:
    """(N, 1) for sums (N, r)."""
    if not task.discrete:
        return np.asarray(np.clip(sums, *task.bounds))
    values = np.array(task.values, float)
    if sums.shape[1] == 1:
        return np.asarray(np.where(sums > 0, values[-1], values[0]))
    return np.asarray(values[sums.argmax(axis=1)][:, np.newaxis])


def program_of(found: Linear, task: Task) -> Program:
    """The sums written out; of several, each difference to the first is one."""
    if not task.discrete:
        return task.program(_sum(task, found.rows[0]))
    if len(found.rows) == 1:
        return task.program(If(_above(task, found.rows[0]), *_ends(task)))
    first, second, third = found.rows
    choose = [task.choose(value) for value in task.values]
    last = If(_above(task, third - second), choose[2], choose[1])
    return task.program(
        If(
            _above(task, second - first),
            last,
            If(_above(task, third - first), choose[2], choose[0]),
        )
    )


def _ends(task: Task) -> tuple[Term, Term]:
    return task.choose(task.values[-1]), task.choose(task.values[0])


def _above(task: Task, row: Array) -> Term:
    """`w0*x0 + w1*x1 > -c`: two nodes fewer than with the constant on the left."""
    weighted = _weighted(task, row)
    return Apply(Operator.GREATER, (weighted, Literal(short(-float(row[-1])))))


def _sum(task: Task, row: Array) -> Term:
    return Apply(Operator.ADD, (_weighted(task, row), Literal(short(float(row[-1])))))


def _weighted(task: Task, row: Array) -> Term:
    terms = [
        Apply(Operator.MULTIPLY, (Literal(short(float(w))), task.reading(i)))
        for i, w in enumerate(row[:-1])
    ]
    return reduce(lambda a, b: Apply(Operator.ADD, (a, b)), terms)


def short(value: float) -> float:
    """Six digits are more than the tuning tells apart."""
    return float(f"{value:.6g}")
