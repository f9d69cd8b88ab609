"""Problems of several actions taken apart."""

from __future__ import annotations

import numpy as np
import pytest

from pirlc.frontend import parse_sketch
from pirlc.ir.expansion import expand
from pirlc.search.enumeration import Enumeration
from pirlc.semantics.histories import HistorySet, histories_of
from pirlc.source import SourceText
from pirlc.tune import TuningProblem, joined, separate, tune

HEAD = """policy two
sensor X : [-1, 1] = 0
sensor Y : [-1, 1] = 1
window 2
"""
APART = """
action A : [-1, 1] = ?a * peek(X, -1) + ?b
action B : [0, 2] safe 1 = ?c * peek(Y, -1) + 1
action C : [-1, 1] = 0.5 * previous(A)
"""
SHARED = "param common in [-5, 5]" + APART.replace("?b", "common").replace("+ 1", "+ common")


def problem_of(text: str, **start: float) -> TuningProblem:
    sketch = parse_sketch(SourceText("two.pirl", HEAD + text))
    derivations = next(Enumeration(sketch).shortest_first(80))
    rng = np.random.default_rng(0)
    observations = rng.uniform(-1, 1, (300, 2))
    actions = np.stack(
        [
            0.7 * observations[:, 0] - 0.2,
            -0.4 * observations[:, 1] + 1,
            np.append(0.0, 0.35 * observations[:-1, 0] - 0.1),
        ],
        axis=1,
    )
    histories: HistorySet = histories_of(sketch.interface, [(observations, actions)])
    return TuningProblem(expand(sketch, derivations).template, histories, actions, start)


def test_actions_that_share_nothing_are_apart():
    problem = problem_of(APART, A_a=0.5, B_c=0.1)
    first, second = separate(problem)
    assert (first.names, second.names) == (("A_a", "A_b"), ("B_c",))
    assert (first.start, second.start) == ({"A_a": 0.5}, {"B_c": 0.1})
    assert np.array_equal(first.labels[:, 0], problem.labels[:, 0])
    assert (first.labels[:, 1] == 1.0).all()
    assert (first.labels[:, 2] == 0.0).all()
    assert first.template.bodies[0] == problem.template.bodies[0]


def test_the_parts_tuned_are_the_whole_tuned():
    problem = problem_of(APART)
    tuned = joined(problem, [tune(part, 0).values for part in separate(problem)])
    assert tuned.values == pytest.approx({"A_a": 0.7, "A_b": -0.2, "B_c": -0.4}, abs=1e-6)
    assert tuned.distance == pytest.approx(0.0, abs=1e-6)


def test_a_part_is_the_same_whatever_the_other_actions_are():
    one = separate(problem_of(APART))[1]
    other = separate(problem_of(APART.replace("+ ?b", "* ?b")))[1]
    assert (one.template, one.names) == (other.template, other.names)
    assert np.array_equal(one.labels, other.labels)


def test_actions_that_share_a_parameter_stay_together():
    (part,) = separate(problem_of(SHARED))
    assert set(part.names) == {"A_a", "B_c", "common"}
    assert (part.labels[:, 2] == 0.0).all()


def test_what_does_not_come_apart_is_left_as_it_is():
    alone = problem_of(APART.replace("previous(A)", "?d * ?b2").replace("?b2", "?b"))
    assert len(separate(alone)) == 3
    fixed = problem_of(
        "action A : [-1, 1] = peek(X, -1)\naction B : [0, 2] = 1\naction C : [-1, 1] = 0\n"
    )
    assert separate(fixed) == (fixed,)
    assert joined(fixed, []).values == {}
