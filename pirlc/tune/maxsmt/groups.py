"""Histories that stand for others: MaxSMT looks at some dozens, weighted, rather than thousands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Indices = NDArray[np.intp]

_ROUNDS = 6


@dataclass(frozen=True, eq=False)
class Chosen:
    """Histories by number, each with the histories that it stands for, as a weight."""

    numbers: Indices
    weights: NDArray[np.int64]


def choose_histories(
    features: Vector,
    kinds: NDArray[np.int64],
    among: Indices,
    wrong: NDArray[np.bool_],
    most: int,
    rng: np.random.Generator,
) -> Chosen:
    """At most `most` of the histories `among`, one from each group of similar ones.

    Groups gather around histories that are `wrong` now and around others, half of each as far as
    there are. Histories of different `kinds` want different actions, so in a group they
    contradict each other: one of the most frequent kind stands for the group, with the majority
    as its weight. A group without a majority is left out.
    """
    if len(among) <= most:
        return Chosen(among, np.ones(len(among), dtype=np.int64))
    points = features[among]
    group, squares = _grouped(points, wrong[among], most, rng)
    numbers, weights = [], []
    for g in range(int(group.max()) + 1):
        members = np.flatnonzero(group == g)
        if not len(members):
            continue
        found, counts = np.unique(kinds[among[members]], return_counts=True)
        order = np.argsort(-counts, kind="stable")
        majority = int(counts[order[0]] - (counts[order[1]] if len(order) > 1 else 0))
        if majority:
            like = members[kinds[among[members]] == found[order[0]]]
            numbers.append(int(among[like[np.argmin(squares[like])]]))
            weights.append(majority)
    return Chosen(np.array(numbers, dtype=np.intp), np.array(weights, dtype=np.int64))


def _grouped(
    points: Vector, wrong: NDArray[np.bool_], count: int, rng: np.random.Generator
) -> tuple[Indices, Vector]:
    """Each point's group, and its squared distance from the group's centre: k-means."""
    first = np.flatnonzero(wrong)
    first = rng.permutation(first)[: count // 2]
    others = np.setdiff1d(np.arange(len(points)), first)
    starts = np.concatenate([first, rng.permutation(others)[: count - len(first)]])
    centres = points[starts].copy()
    sizes = np.einsum("nd,nd->n", points, points)
    group = np.zeros(len(points), dtype=np.intp)
    squares = np.zeros(len(points))
    for turn in range(_ROUNDS):
        away = sizes[:, None] - 2.0 * (points @ centres.T) + np.einsum("kd,kd->k", centres, centres)
        group = np.argmin(away, axis=1)
        squares = away[np.arange(len(points)), group]
        if turn < _ROUNDS - 1:
            members = np.bincount(group, minlength=count)
            sums = np.stack(
                [np.bincount(group, column, minlength=count) for column in points.T], axis=1
            )
            filled = members > 0
            centres[filled] = sums[filled] / members[filled, None]
    return group, squares
