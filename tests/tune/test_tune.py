"""Tuning finds again the parameters of programs whose actions it is given."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pirlc.ir.expansion import expand, only_derivation
from pirlc.ir.policy import ProgramTemplate
from pirlc.semantics.histories import HistorySet, histories_of
from pirlc.semantics.vectorised import apply_actions, compile_plan
from pirlc.tune import Tuned, TuningProblem, natural_scales, tune
from tests.search.sketches import sketch_of

HEAD = """policy p
sensor S : [-1, 1] = 0
sensor T : [-2, 2] = 1
window 5
"""
PID = """
    action A : [-10, 10] = let e = ?r - S in
        ?kp * peek(e, -1) + ?(ki in [0, 10]) * fold(+, e) + ?kd * (peek(S, -2) - peek(S, -1))
"""
GAINS = {"A_r": 0.25, "A_kp": 3.5, "A_ki": 0.4, "A_kd": -7.0}

GUARDS = """
    action A : {0, 1, 2} = if ?a * peek(S, -1) + ?b * peek(T, -1) > ?c then 2
                           else if peek(T, -1) > ?d then 1 else 0
"""


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


def actions_of(
    found: ProgramTemplate, values: dict[str, float], histories: HistorySet
) -> NDArray[np.float64]:
    plan = compile_plan(found, histories.precision, histories.layout)
    return apply_actions(plan.run(values, histories), histories).actions


def problem_of(text: str, values: dict[str, float], **start: float) -> TuningProblem:
    found = template(text)
    histories = walk(found)
    return TuningProblem(found, histories, actions_of(found, values, histories), start)


def check_distance(problem: TuningProblem, tuned: Tuned) -> None:
    """The distance that is reported is that of the program."""
    ours = actions_of(problem.template, tuned.values, problem.histories)
    widths = [
        spec.domain.upper - spec.domain.lower if hasattr(spec.domain, "upper") else None
        for spec in problem.template.interface.actions
    ]
    if None in widths:
        expected = np.mean(np.any(ours != problem.labels, axis=1))
    else:
        scaled = (ours - problem.labels) / np.array(widths)
        expected = np.mean(np.linalg.norm(scaled, axis=1))
    assert tuned.distance == pytest.approx(float(expected), rel=1e-9, abs=1e-12)


def test_gains_are_found_exactly_where_the_setpoint_is_known() -> None:
    text = PID.replace("?r", "0.25")
    gains = {name: GAINS[name] for name in ("A_kp", "A_ki", "A_kd")}
    problem = problem_of(text, gains)
    tuned = tune(problem, seed=0)
    assert tuned.distance < 1e-9
    assert tuned.values == pytest.approx(gains, rel=1e-6)


def test_gains_are_found_although_the_action_saturates() -> None:
    text = PID.replace("?r", "0.25").replace("[-10, 10] =", "[-1, 0.8] =")
    gains = {name: GAINS[name] for name in ("A_kp", "A_ki", "A_kd")}
    problem = problem_of(text, gains)
    saturated = np.isin(problem.labels, (-1.0, 0.8)).mean()
    assert 0.3 < saturated < 0.9
    tuned = tune(problem, seed=0)
    check_distance(problem, tuned)
    assert tuned.distance < 1e-9
    assert tuned.values == pytest.approx(gains, rel=1e-6)


def test_a_setpoint_is_found_with_the_gains() -> None:
    problem = problem_of(PID, GAINS)
    tuned = tune(problem, seed=0)
    check_distance(problem, tuned)
    assert tuned.distance < 1e-4


@pytest.mark.parametrize("seed", range(4))
def test_guards_are_found_from_random_starts(seed: int) -> None:
    problem = problem_of(GUARDS, {"A_a": 1.0, "A_b": -0.4, "A_c": 0.2, "A_d": 0.6})
    counts = np.bincount(problem.labels[:, 0].astype(int), minlength=3)
    assert counts.min() >= 60
    tuned = tune(problem, seed)
    check_distance(problem, tuned)
    assert tuned.distance <= 0.02


def test_switched_gains_are_found() -> None:
    text = """
        action A : [-10, 10] = if peek(T, -1) > ?c then ?k * peek(S, -1) else ?l * peek(S, -1) + ?m
    """
    problem = problem_of(text, {"A_c": 0.4, "A_k": 4.0, "A_l": -2.0, "A_m": 1.0})
    tuned = tune(problem, seed=1)
    check_distance(problem, tuned)
    assert tuned.distance < 0.005


# Where tuning starts, and where it may not go.

NARROW = """
    action A : {0, 1} = if peek(S, -1) > ?a and peek(S, -1) < ?b and peek(T, -1) > ?c
                        and peek(T, -1) < ?d then 1 else 0
"""


def test_a_start_is_used() -> None:
    values = {"A_a": 0.30, "A_b": 0.36, "A_c": 0.9, "A_d": 1.4}
    problem = problem_of(NARROW, values, **values)
    assert 3 <= problem.labels.sum() <= 60
    tuned = tune(problem, seed=0)
    assert tuned.distance == 0.0


def test_a_guess_is_used() -> None:
    text = NARROW
    values = {"A_a": 0.30, "A_b": 0.36, "A_c": 0.9, "A_d": 1.4}
    for name, value in values.items():
        hole = name.removeprefix("A_")
        text = text.replace(f"?{hole} ", f"?({hole} = {value}) ")
    assert tune(problem_of(text, values), seed=0).distance == 0.0


def test_a_start_for_some_parameters_is_enough() -> None:
    problem = problem_of(PID, GAINS, A_r=0.25)
    assert tune(problem, seed=0).distance < 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_bounds_are_kept(seed: int) -> None:
    text = """
        action A : [-10, 10] = ?(k in [0, 1]) * peek(S, -1) + ?(l in [-3, -2]) * peek(T, -1)
        action B : {0, 1} = if peek(S, -1) > ?(c in [0.5, 0.6]) then 1 else 0
    """
    problem = problem_of(text, {"A_k": 5.0, "A_l": 4.0, "B_c": -0.2})
    tuned = tune(problem, seed)
    check = {p.name: (p.lower, p.upper) for p in problem.template.free}
    for name, value in tuned.values.items():
        lower, upper = check[name]
        assert lower <= value <= upper
    assert tuned.values["A_k"] > 0.5
    assert tuned.values["A_l"] == pytest.approx(-2.0, abs=0.2)


def test_the_best_within_the_bounds_is_at_the_bound() -> None:
    text = "action A : [-10, 10] = ?(k in [0, 1]) * peek(S, -1)"
    tuned = tune(problem_of(text, {"A_k": 5.0}), seed=0)
    assert tuned.values == {"A_k": 1.0}


@pytest.mark.parametrize("value", [0.0, 0.3])
@pytest.mark.parametrize(
    "text",
    [
        "action A : {{0, 1}} = if peek(S, -1) > ?(c in [{0}, {0}]) then 1 else 0",
        "action A : {{0, 1}} = if ?a * peek(S, -1) > ?(c in [{0}, {0}]) + ?b then 1 else 0",
        "action A : [-1, 1] = ?(c in [{0}, {0}]) * peek(S, -1) + ?b",
    ],
)
def test_bounds_that_leave_one_value(text: str, value: float) -> None:
    problem = problem_of(text.format(value), {"A_a": 1.0, "A_b": 0.1, "A_c": value})
    tuned = tune(problem, seed=0)
    assert tuned.values["A_c"] == value
    assert tuned.distance <= 0.01


def test_a_template_without_parameters_is_only_scored() -> None:
    found = template("action A : {0, 1} = if peek(S, -1) > 0 then 1 else 0")
    histories = walk(found)
    labels = np.ones((len(histories), 1))
    tuned = tune(TuningProblem(found, histories, labels), seed=0)
    assert tuned.values == {}
    negative = float(np.mean(histories.element("S", -1) <= 0.0))
    assert 0.1 < negative < 0.9
    assert tuned.distance == pytest.approx(negative)


def test_a_single_parameter() -> None:
    text = "action A : {0, 1} = if peek(S, -1) > ?c then 1 else 0"
    tuned = tune(problem_of(text, {"A_c": 0.31}), seed=0)
    assert tuned.distance <= 0.005
    linear = tune(problem_of("action A : [-9, 9] = ?k * peek(T, -1)", {"A_k": 2.5}), seed=0)
    assert linear.values == pytest.approx({"A_k": 2.5}, rel=1e-9)


@pytest.mark.parametrize("text", [PID, GUARDS])
def test_the_same_seed_gives_the_same_result(text: str) -> None:
    found = template(text)
    histories = walk(found, steps=120)
    rng = np.random.default_rng(5)
    labels = rng.integers(0, 3, (len(histories), 1)).astype(np.float64)
    once, again = (tune(TuningProblem(found, histories, labels), seed=3) for _ in range(2))
    assert once == again
    assert tune(TuningProblem(found, histories, labels), seed=4) != once


def test_a_parameter_that_does_nothing_does_no_harm() -> None:
    text = "action A : [-10, 10] = ?k * peek(S, -1) + 0 * ?idle"
    tuned = tune(problem_of(text, {"A_k": 2.0, "A_idle": 1.0}), seed=0)
    assert tuned.distance < 1e-9
    assert tuned.values["A_k"] == pytest.approx(2.0)


# Scales.


def test_a_scale_is_the_step_that_matters() -> None:
    found = template("""
        action A : [-10, 10] = if peek(S, -1) > ?c then ?k * peek(T, -1) else 0 * ?idle
    """)
    histories = walk(found)
    values = {"A_c": 0.0, "A_k": 1.0, "A_idle": 0.0}
    scales = dict(
        zip([p.name for p in found.free], natural_scales(found, values, histories), strict=True)
    )
    spread = float(np.std(histories.element("S", -1)))
    assert scales["A_c"] == pytest.approx(spread, rel=1e-6)
    moved = np.where(histories.element("S", -1) > 0.0, histories.element("T", -1), 0.0)
    assert scales["A_k"] == pytest.approx(20.0 / float(np.sqrt(np.mean(moved**2))), rel=1e-6)
    assert scales["A_idle"] == pytest.approx(2.0)
