"""MaxSMT finds parameters from histories as soft constraints, under a limit, and says what it
cannot take."""

from __future__ import annotations

from dataclasses import replace
from time import monotonic

import numpy as np
import pytest
from numpy.typing import NDArray

from pirlc.ir.expansion import expand, only_derivation
from pirlc.ir.policy import ProgramTemplate
from pirlc.semantics.histories import HistorySet, histories_of
from pirlc.semantics.vectorised import apply_actions, compile_plan, distance
from pirlc.tune import Tuned, TuningProblem
from pirlc.tune.how import Optimizer, Tuning
from pirlc.tune.maxsmt import tune, unsuitable
from pirlc.tune.maxsmt.limits import blocks
from pirlc.tune.maxsmt.search import LOOKED_AT, NO_ANSWER
from tests.search.sketches import sketch_of

HOW = Tuning(Optimizer.SMT, effort=300_000)

HEAD = """policy p
sensor S : [-1, 1] = 0
sensor T : [-2, 2] = 1
window 3
"""
GUARDS = """
    action A : {0, 1, 2} = if ?a * peek(S, -1) + ?b * peek(T, -1) > ?c then 2
                           else if peek(T, -1) > ?d then 1 else 0
"""
PLANTED = {"A_a": 1.0, "A_b": -0.4, "A_c": 0.2, "A_d": 0.6}


def template(text: str) -> ProgramTemplate:
    sketch = sketch_of(text, HEAD)
    derivations = only_derivation(sketch)
    assert derivations is not None
    return expand(sketch, derivations).template


def walk(found: ProgramTemplate, steps: int = 600, seed: int = 0) -> HistorySet:
    """Histories of readings that wander through the sensors' ranges."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(steps, 2)).cumsum(axis=0)
    readings = np.sin(0.4 * noise) * [1.0, 2.0]
    actions = np.zeros((steps, len(found.interface.actions)))
    return histories_of(found.interface, [(readings, actions)])


def actions_of(problem: TuningProblem, values: dict[str, float]) -> NDArray[np.float64]:
    histories = problem.histories
    plan = compile_plan(problem.template, histories.precision, histories.layout)
    return apply_actions(plan.run(values, histories), histories).actions


def planted(text: str, values: dict[str, float], steps: int = 600, **start: float) -> TuningProblem:
    found = template(text)
    histories = walk(found, steps)
    blank = TuningProblem(found, histories, np.zeros((steps, len(found.bodies))), start)
    return replace(blank, labels=actions_of(blank, values))


def check_distance(problem: TuningProblem, tuned: Tuned) -> None:
    """What is reported is the distance of the program."""
    ours = actions_of(problem, tuned.values)
    specs = problem.template.interface.actions
    assert tuned.distance == distance(ours, problem.labels, specs)
    for name, low, high in zip(problem.names, problem.lower, problem.upper, strict=True):
        assert low <= tuned.values[name] <= high


# Discrete actions.


@pytest.mark.parametrize("seed", range(3))
def test_planted_guards_are_found(seed: int) -> None:
    problem = planted(GUARDS, PLANTED)
    assert np.bincount(problem.labels[:, 0].astype(int), minlength=3).min() >= 60
    tuned = tune(problem, seed, HOW)
    check_distance(problem, tuned)
    assert tuned.distance <= 0.005
    assert not tuned.note


def test_a_threshold_is_found_exactly() -> None:
    text = "action A : {0, 1} = if peek(S, -1) > ?c then 1 else 0"
    tuned = tune(planted(text, {"A_c": 0.31}), 0, HOW)
    assert tuned.distance == 0.0
    assert tuned.values["A_c"] == pytest.approx(0.31, abs=0.02)


def test_guards_may_be_combined() -> None:
    text = """
        action A : {0, 1} = if (peek(S, -1) > ?a and peek(T, -1) < ?b) or not (peek(T, -2) < ?c)
                            then 1 else 0
    """
    problem = planted(text, {"A_a": -0.2, "A_b": 0.7, "A_c": 1.4})
    assert tune(problem, 0, HOW).distance <= 0.02


def test_min_max_abs_sign_clip_and_folds_are_cases() -> None:
    text = """
        action A : {0, 1} = if max(?a, peek(S, -1)) + abs(peek(T, -1) - ?b) > 0.9 * sign(?c)
                               and clip(fold(min, S), ?d, 0.5) < 0.4 then 1 else 0
    """
    problem = planted(text, {"A_a": 0.1, "A_b": 0.5, "A_c": 3.0, "A_d": -0.3})
    assert 0.2 < problem.labels.mean() < 0.8
    tuned = tune(problem, 0, replace(HOW, effort=600_000))
    check_distance(problem, tuned)
    assert tuned.distance <= 0.03


def test_previous_actions_are_data() -> None:
    text = "action A : {0, 1} = if peek(S, -1) > ?c or previous(A) == 1 then 1 else 0"
    found = template(text)
    rng = np.random.default_rng(1)
    readings, before = rng.uniform(-1, 1, (300, 2)), rng.integers(0, 2, (300, 1)).astype(float)
    histories = histories_of(found.interface, [(readings, before)])
    blank = TuningProblem(found, histories, np.zeros((300, 1)))
    problem = replace(blank, labels=actions_of(blank, {"A_c": -0.4}))
    assert unsuitable(found) is None
    assert tune(problem, 0, HOW).distance == 0.0


def test_the_majority_decides_where_histories_contradict_each_other() -> None:
    text = "action A : {0, 1} = if ?c > 0 then 1 else 0"
    found = template(text)
    histories = walk(found, 400)
    for share in (0.3, 0.7):
        labels = (np.arange(400) < share * 400).astype(np.float64)[:, None]
        tuned = tune(TuningProblem(found, histories, labels), 0, HOW)
        assert tuned.distance == pytest.approx(0.3)
        assert (tuned.values["A_c"] > 0.0) == (share > 0.5)


def test_an_action_that_the_template_never_takes_is_left_aside() -> None:
    text = "action A : {0, 1, 2} = if peek(S, -1) > ?c then 2 else 0"
    problem = planted(text, {"A_c": 0.1})
    problem.labels[::10] = 1.0
    tuned = tune(problem, 0, HOW)
    assert tuned.distance == pytest.approx(0.1, abs=0.005)


# Continuous actions.


def test_gains_are_found_within_the_tolerance() -> None:
    text = "action A : [-4, 4] = ?k * peek(S, -1) + ?l * (peek(T, -1) - peek(T, -2))"
    problem = planted(text, {"A_k": 2.0, "A_l": -0.5})
    assert np.abs(problem.labels).max() < 4.0
    for tolerance in (0.1, 0.01):
        tuned = tune(problem, 0, replace(HOW, tolerance=tolerance))
        check_distance(problem, tuned)
        assert tuned.distance <= tolerance


def test_a_result_beyond_the_bound_is_as_good_as_the_bound() -> None:
    text = "action A : [-1, 0.8] = ?k * peek(S, -1)"
    problem = planted(text, {"A_k": 6.0})
    assert 0.5 < np.isin(problem.labels, (-1.0, 0.8)).mean() < 0.95
    tuned = tune(problem, 0, replace(HOW, tolerance=0.02))
    assert tuned.distance <= 0.02
    assert tuned.values["A_k"] == pytest.approx(6.0, rel=0.1)


def test_a_setpoint_and_gains_are_solved_for_in_turn() -> None:
    text = (
        "action A : [-10, 10] = let e = ?(r in [-1, 1]) - S in ?kp * peek(e, -1) + ?ki * fold(+, e)"
    )
    problem = planted(text, {"A_r": 0.25, "A_kp": 3.5, "A_ki": 0.4})
    assert sorted(map(len, blocks(problem.template))) == [1, 2]
    tuned = tune(problem, 0, replace(HOW, tolerance=0.03))
    check_distance(problem, tuned)
    assert tuned.distance <= 0.07


# Budgets, starts and determinism.


def test_the_same_seed_and_effort_give_the_same_values() -> None:
    problem = planted(GUARDS, PLANTED)
    noisy = problem.labels.copy()
    noisy[::7] = 0.0
    problem = replace(problem, labels=noisy)
    first, again = (tune(problem, 3, HOW) for _ in range(2))
    assert first == again


def test_a_limit_before_the_first_answer_leaves_the_start() -> None:
    problem = planted(GUARDS, PLANTED, A_a=0.9, A_c=0.1)
    tuned = tune(problem, 0, replace(HOW, effort=1))
    assert tuned.note == NO_ANSWER
    assert tuned.values == {"A_a": 0.9, "A_b": 0.0, "A_c": 0.1, "A_d": 0.0}
    check_distance(problem, tuned)


def test_a_limit_in_seconds_is_kept() -> None:
    problem = planted(GUARDS, PLANTED)
    problem.labels[::3] = 1.0
    begun = monotonic()
    tuned = tune(problem, 0, replace(HOW, effort=10**9, seconds=1.0))
    assert monotonic() - begun < 6.0
    assert tuned.distance < 0.5


def test_a_start_that_is_right_is_kept() -> None:
    problem = planted(GUARDS, PLANTED, **PLANTED)
    tuned = tune(problem, 0, replace(HOW, effort=1000))
    assert tuned.values == PLANTED
    assert tuned.distance == 0.0


def test_a_template_without_parameters_is_only_scored() -> None:
    problem = planted("action A : {0, 1} = if peek(S, -1) > 0.2 then 1 else 0", {})
    assert tune(problem, 0, HOW) == Tuned({}, 0.0)


def test_more_histories_than_are_looked_at_count_in_the_score() -> None:
    problem = planted(GUARDS, PLANTED, steps=3 * LOOKED_AT)
    tuned = tune(problem, 0, HOW)
    check_distance(problem, tuned)
    assert tuned.distance <= 0.02


# What is beyond reach, in words.


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("let k = ?k in k * k * peek(S, -1)", "a parameter that is multiplied by itself"),
        ("exp(?k * peek(S, -1))", "the exponential of a value that depends on a parameter"),
        ("tanh(?k) * peek(S, -1)", "the hyperbolic tangent of a value that depends on a parameter"),
        ("sqrt(?k)", "the square root of a value that depends on a parameter"),
        ("peek(S, -1) / ?k", "a quotient by a value that depends on a parameter"),
        ("exp(peek(S, -1)) * ?k / sqrt(peek(T, -1))", None),
        ("?k * peek(S, -1) * ?l", None),
        (
            "min(?a, min(?b, min(?c, min(?d, min(?e, min(?f, min(?g, ?h)))))))",
            "a value of more than 64 cases",
        ),
    ],
)
def test_what_is_beyond_reach_is_told(body: str, reason: str | None) -> None:
    assert unsuitable(template(f"action A : [-1, 1] safe 0 = {body}")) == reason
