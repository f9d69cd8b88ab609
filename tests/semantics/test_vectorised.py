"""Applied actions, distances, and what plans do with parameters."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.scoring import per_second, pid, random_histories
from pirlc.ir.policy import ActionSpec, Choice, Continuous, Interface, Sensor
from pirlc.semantics.histories import Layout, histories_of
from pirlc.semantics.interpreter import SAFE_USED
from pirlc.semantics.plan import compile_code
from pirlc.semantics.precision import BINARY64, Precision
from pirlc.semantics.vectorised import (
    apply_actions,
    compile_plan,
    distance,
    distances,
    evaluate,
)

VALUES = {"setpoint": 0.1, "kp": 2.0, "ki": 0.5, "kd": 7.0}


def histories_for(*domains: Continuous | Choice):
    actions = tuple(ActionSpec(f"A{i}", domain, i) for i, domain in enumerate(domains))
    interface = Interface("i", None, (Sensor("x", 0.0, 1.0, 0),), actions)
    steps = 6
    return histories_of(interface, [(np.full((steps, 1), 0.5), np.zeros((steps, len(actions))))])


def test_clipping_keeps_signed_zeros_and_replaces_nan() -> None:
    histories = histories_for(Continuous(0.0, 2.0, 1.5), Continuous(-2.0, -0.0))
    column = [-0.0, 0.0, -3.0, 3.0, np.nan, np.inf]
    applied = apply_actions(np.column_stack([column, column]), histories)
    expected = [[-0.0, -0.0], [0.0, 0.0], [0.0, -2.0], [2.0, -0.0], [1.5, 0.0], [2.0, -0.0]]
    assert np.ascontiguousarray(applied.actions).tobytes() == np.array(expected).tobytes()
    assert applied.status.tolist() == [0, 0, 0, 0, SAFE_USED, 0]


def test_distances_divide_by_the_range() -> None:
    specs = histories_for(Continuous(-1.0, 3.0), Continuous(0.0, 1.0)).interface.actions
    ours = np.array([[0.0, 0.5], [3.0, 1.0], [1.0, 0.0]])
    theirs = np.array([[0.0, 0.5], [-9.0, 1.0], [-1.0, 0.5]])
    expected = [0.0, 1.0, np.hypot(0.5, 0.5)]
    np.testing.assert_allclose(distances(ours, theirs, specs), expected, rtol=1e-15)
    assert distance(ours, theirs, specs) == pytest.approx(np.mean(expected))
    one = distances(ours[:, :1], theirs[:, :1], specs[:1])
    np.testing.assert_allclose(one, [0.0, 1.0, 0.5], rtol=1e-15)


def test_distance_of_discrete_actions_is_disagreement() -> None:
    specs = histories_for(Choice((0, 1, 7))).interface.actions
    ours, theirs = np.array([[0.0], [7.0], [1.0], [1.0]]), np.array([[1.0], [7.0], [7.0], [1.0]])
    assert distances(ours, theirs, specs).tolist() == [1.0, 0.0, 1.0, 0.0]
    assert distance(ours, theirs, specs) == 0.5


@pytest.mark.parametrize("precision", list(Precision))
def test_one_plan_serves_many_parameters_and_sets(precision: Precision) -> None:
    template = pid()
    plan = compile_plan(template, precision)
    for count in (400, 30_000, 400):
        histories = random_histories(template, count, precision)
        for kp in (1.0, -3.5, 1.0):
            values = {**VALUES, "kp": kp}
            fixed = evaluate(template.close(values), {}, histories)
            assert plan.run(values, histories).tobytes() == fixed.tobytes()


def test_a_window_wide_operation_is_done_once() -> None:
    code = compile_code(pid(), Layout.FLAT)
    # setpoint - h; kp *; four sums; ki *; the difference; kd *; two sums.
    assert (len(code.body), len(code.prelude)) == (11, 0)


def test_scoring_is_fast() -> None:
    """A loose floor, for busy machines; `python -m benchmarks.scoring` measures."""
    template = pid()
    histories = random_histories(template, 20_000, BINARY64)
    plan = compile_plan(template)
    assert per_second(lambda: plan.run(VALUES, histories), len(histories), 0.5) > 2e7
