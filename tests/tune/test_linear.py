"""Least squares over many histories: a triangle for each block says what all rows say."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.growth import workloads as given
from pirlc.symbolic import blocks
from pirlc.tune import TuningProblem
from pirlc.tune.linear import LinearSolver


@pytest.mark.parametrize("gain", [0.5, 5.0])
def test_blocks_change_no_solution(gain: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a small gain the oracle never saturates, with a large one it does mostly."""
    template = given.every_sensor(3, 4)
    histories = given.history_set(template, 1_003)
    problem = TuningProblem(template, histories, gain * given.labels_for(histories))
    theta = np.array(list(given.values_of(template).values()))
    whole = LinearSolver(problem)
    assert whole.any
    assert not whole.solves_all
    monkeypatch.setattr(blocks, "BLOCK", 100)
    many = LinearSolver(problem)
    expected, found = whole.solved(theta), many.solved(theta)
    assert np.abs(expected - theta).max() > 0.1
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-10)


def test_too_few_histories_leave_the_parameters_alone() -> None:
    template = given.one_law(3, 4)
    histories = given.history_set(template, 2)
    theta = np.array(list(given.values_of(template).values()))
    solver = LinearSolver(TuningProblem(template, histories, given.labels_for(histories)))
    np.testing.assert_array_equal(solver.solved(theta), theta)
