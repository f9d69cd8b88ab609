"""The Bayesian optimiser on problems whose answer is known."""

from __future__ import annotations

import logging
import time

import numpy as np
import pytest

from pirlc.tune import Optimizer, Tuning, TuningProblem, tune
from tests.tune.test_tune import GUARDS, check_distance, problem_of, template, walk

SHORT = Tuning(Optimizer.BAYES, trials=22)


def test_a_threshold_is_found() -> None:
    text = "action A : {0, 1} = if peek(S, -1) > ?c then 1 else 0"
    problem = problem_of(text, {"A_c": 0.31})
    tuned = tune(problem, 0, SHORT)
    check_distance(problem, tuned)
    assert tuned.distance <= 0.01


def test_gains_whose_size_is_not_known_are_found() -> None:
    text = "action A : [-1, 1] = ?k * peek(S, -1) + ?m"
    for factor in (0.02, 40.0):
        scaled = text.replace("peek(S, -1)", f"({factor} * peek(S, -1))")
        problem = problem_of(scaled, {"A_k": 0.8 / factor, "A_m": -0.1})
        tuned = tune(problem, 0, SHORT)
        check_distance(problem, tuned)
        assert tuned.distance < 0.06


def test_guards_are_found_better_with_more_trials() -> None:
    problem = problem_of(GUARDS, {"A_a": 1.0, "A_b": -0.4, "A_c": 0.2, "A_d": 0.6})
    few, many = (tune(problem, 0, Tuning(Optimizer.BAYES, trials=n)) for n in (10, 40))
    check_distance(problem, many)
    assert many.distance < few.distance
    assert many.distance < 0.2


def test_a_guard_far_from_zero_is_within_the_box() -> None:
    text = "action A : {0, 1} = if 50 + 0.1 * peek(S, -1) > ?c then 1 else 0"
    problem = problem_of(text, {"A_c": 50.02})
    assert 0.2 < problem.labels.mean() < 0.8
    assert tune(problem, 0, SHORT).distance <= 0.02


def test_bounds_are_kept_also_where_0_is_outside() -> None:
    text = "action A : [-10, 10] = ?(k in [3, 4]) * peek(S, -1) + ?(l in [-80, -2]) * peek(T, -1)"
    tuned = tune(problem_of(text, {"A_k": 9.0, "A_l": 4.0}), 0, SHORT)
    assert tuned.values["A_k"] == pytest.approx(4.0, abs=0.2)
    assert -80 <= tuned.values["A_l"] <= -2 and tuned.values["A_l"] > -2.5


def test_bounds_that_leave_one_value() -> None:
    text = "action A : [-1, 1] = ?(c in [0.3, 0.3]) * peek(S, -1) + ?b"
    tuned = tune(problem_of(text, {"A_c": 0.3, "A_b": 0.1}), 0, SHORT)
    assert tuned.values["A_c"] == 0.3
    assert tuned.distance <= 0.01
    alone = problem_of("action A : [-1, 1] = ?(c in [2, 2]) * peek(S, -1)", {"A_c": 2.0})
    assert tune(alone, 0, SHORT).values == {"A_c": 2.0}


def test_a_start_and_a_guess_are_tried_first() -> None:
    text = """
    action A : {0, 1} = if peek(S, -1) > ?a and peek(S, -1) < ?(b = 0.36) and peek(T, -1) > ?c
                        and peek(T, -1) < ?d then 1 else 0
    """
    values = {"A_a": 0.30, "A_b": 0.36, "A_c": 0.9, "A_d": 1.4}
    known = {name: value for name, value in values.items() if name != "A_b"}
    problem = problem_of(text, values, **known)
    one = Tuning(Optimizer.BAYES, trials=1)
    assert tune(problem, 0, one).values == pytest.approx(values)
    assert tune(problem, 0, one).distance == 0.0


def test_a_template_without_parameters_is_only_scored() -> None:
    found = template("action A : {0, 1} = if peek(S, -1) > 0 then 1 else 0")
    histories = walk(found)
    tuned = tune(TuningProblem(found, histories, np.ones((len(histories), 1))), 0, SHORT)
    assert tuned.values == {}
    assert tuned.distance == pytest.approx(float(np.mean(histories.element("S", -1) <= 0.0)))


def test_the_same_seed_gives_the_same_result() -> None:
    found = template(GUARDS)
    histories = walk(found, steps=120)
    labels = np.random.default_rng(5).integers(0, 3, (len(histories), 1)).astype(np.float64)
    once, again, other = (
        tune(TuningProblem(found, histories, labels), seed, SHORT) for seed in (3, 3, 4)
    )
    assert once == again
    assert once != other


def test_seconds_end_it_early() -> None:
    found = template(GUARDS)
    histories = walk(found, steps=120)
    labels = np.random.default_rng(5).integers(0, 3, (len(histories), 1)).astype(np.float64)
    problem = TuningProblem(found, histories, labels)
    tune(problem, 0, SHORT)
    began = time.monotonic()
    tuned = tune(problem, 0, Tuning(Optimizer.BAYES, trials=100_000, seconds=0.5))
    assert time.monotonic() - began < 10.0
    check_distance(problem, tuned)


def test_optuna_says_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    before = logging.getLogger("optuna").level
    tune(problem_of(GUARDS, {"A_a": 1.0, "A_b": -0.4, "A_c": 0.2, "A_d": 0.6}), 0, SHORT)
    assert capfd.readouterr() == ("", "")
    assert logging.getLogger("optuna").level == before
