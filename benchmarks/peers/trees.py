"""scikit-learn's decision trees as plain data, and as closed .pirl programs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.peers.tasks import Array, Task
from pirlc.ir.operators import Operator
from pirlc.ir.policy import Program
from pirlc.ir.terms import Apply, If, Literal, Term


@dataclass(frozen=True)
class Leaf:
    """`value` is the action: one of the environment's own numbers, or a real."""

    value: float


@dataclass(frozen=True)
class Split:
    """Below where the feature's reading is at most the threshold, above where it is more."""

    feature: int
    threshold: float
    below: Tree
    above: Tree


Tree = Leaf | Split


def from_sklearn(fitted: Any) -> Tree:
    """The tree without the splits whose two sides do the same, which scikit-learn leaves in."""
    tree = fitted.tree_
    classes = getattr(fitted, "classes_", None)

    def at(node: int) -> Tree:
        if tree.children_left[node] < 0:
            values = tree.value[node][0]
            found = values[0] if classes is None else classes[int(np.argmax(values))]
            return Leaf(float(found))
        below, above = at(tree.children_left[node]), at(tree.children_right[node])
        if below == above:
            return below
        return Split(int(tree.feature[node]), float(tree.threshold[node]), below, above)

    return at(0)


def leaves(tree: Tree) -> int:
    match tree:
        case Leaf():
            return 1
        case Split(_, _, below, above):
            return leaves(below) + leaves(above)


def predict(fitted: Any, observations: Array) -> Array:
    """scikit-learn's own answers (N, 1), without the checks that cost most of its time."""
    where = fitted.tree_.apply(observations.astype(np.float32))
    values = fitted.tree_.value[:, 0, :]
    classes = getattr(fitted, "classes_", None)
    answers = values[:, 0] if classes is None else classes[values.argmax(axis=1)]
    chosen: Array = answers.astype(np.float64)[where][:, np.newaxis]
    return chosen


def program_of(tree: Tree, task: Task) -> Program:
    """Nested conditionals over the newest readings."""

    def term(of: Tree) -> Term:
        match of:
            case Leaf(value):
                return task.choose(int(value)) if task.discrete else Literal(value)
            case Split(feature, threshold, below, above):
                reading = task.reading(feature)
                guard = Apply(Operator.LESS_EQUAL, (reading, Literal(threshold)))
                return If(guard, term(below), term(above))

    return task.program(term(tree))
