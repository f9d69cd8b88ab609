"""What each optimiser can take."""

from __future__ import annotations

import numpy as np
import pytest

from pirlc.tune import Optimizer, Tuning, TuningProblem, tune, tune_apart, unsuitable
from pirlc.tune.limits import MOST_BAYES
from tests.tune.test_tune import GUARDS, PID, actions_of, template, walk


def terms(count: int) -> str:
    return " + ".join(f"?k{i} * peek(S, -1)" for i in range(count))


def one_action(count: int) -> str:
    return f"action A : [-1, 1] = {terms(count)}"


@pytest.mark.parametrize("text", [GUARDS, PID, one_action(1), one_action(40)])
def test_casadi_takes_every_template(text: str) -> None:
    assert unsuitable(template(text), Optimizer.CASADI) is None


def test_bayes_takes_so_many_parameters_and_no_more() -> None:
    assert unsuitable(template(one_action(MOST_BAYES)), Optimizer.BAYES) is None
    assert (
        unsuitable(template(one_action(MOST_BAYES + 1)), Optimizer.BAYES)
        == "more than 30 parameters"
    )


def test_parameters_count_that_are_tuned_together() -> None:
    apart = f"{one_action(20)}\naction B : [-1, 1] = {terms(20)}"
    assert unsuitable(template(apart), Optimizer.BAYES) is None
    together = apart.replace("+ ?k19", "+ k").replace("action A", "param k in [0, 1]\naction A")
    assert unsuitable(template(together), Optimizer.BAYES) == "more than 30 parameters"


@pytest.mark.parametrize("optimizer", list(Optimizer))
def test_every_optimiser_takes_a_template_without_parameters(optimizer: Optimizer) -> None:
    found = template("action A : [-1, 1] = peek(S, -1) * peek(T, -1) * peek(S, -2)")
    assert unsuitable(found, optimizer) is None
    histories = walk(found)
    problem = TuningProblem(found, histories, actions_of(found, {}, histories))
    tuned = tune(problem, 0, Tuning(optimizer))
    assert tuned.values == {} and tuned.distance == 0.0


@pytest.mark.parametrize("optimizer", [Optimizer.CASADI, Optimizer.BAYES])
def test_actions_that_share_nothing_are_tuned_apart(optimizer: Optimizer) -> None:
    found = template(f"{one_action(1)}\naction B : [-1, 1] = {terms(1)}")
    histories = walk(found)
    labels = actions_of(found, {"A_k0": 0.5, "B_k0": -0.8}, histories)
    problem = TuningProblem(found, histories, labels)
    tuned = tune_apart(problem, 0, Tuning(optimizer, trials=15))
    again = actions_of(found, tuned.values, histories)
    expected = np.mean(np.linalg.norm((again - labels) / 2.0, axis=1))
    assert tuned.distance == pytest.approx(float(expected), rel=1e-9, abs=1e-12)
    assert tuned.distance < 0.02
