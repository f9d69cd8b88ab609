"""The vectorised evaluator computes what the interpreter does, to the last bit."""

from __future__ import annotations

import random

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pirlc.ir.policy import Program
from pirlc.semantics.histories import HistorySet, histories_of, join
from pirlc.semantics.interpreter import initial_state, step
from pirlc.semantics.precision import Precision
from pirlc.semantics.vectorised import apply_actions, compile_plan
from tests.support.observations import random_observations
from tests.support.programs import random_program


def interpreted(program: Program, observations, precision):
    """Raw results, applied actions (T, k) and status (T,) of one run of the interpreter."""
    state = initial_state(program, precision)
    raw, actions, status = [], [], []
    for observation in observations:
        result = step(program, state, observation, precision)
        state = result.state
        raw.append(result.raw)
        actions.append(result.actions)
        status.append(result.status)
    k = len(program.interface.actions)
    return (
        np.array(raw, dtype=np.float64).reshape(-1, k),
        np.array(actions, dtype=np.float64).reshape(-1, k),
        np.array(status, dtype=np.uint8),
    )


def assert_same_bits(ours, theirs, what: str) -> None:
    """Equal bits; any NaN equals any other."""
    ours, theirs = np.ascontiguousarray(ours), np.ascontiguousarray(theirs)
    same = (ours.view(np.int64) == theirs.view(np.int64)) | (np.isnan(ours) & np.isnan(theirs))
    assert same.all(), f"{what}: {ours[~same][:5]} instead of {theirs[~same][:5]}"


def check(program: Program, rng: random.Random, precision: Precision, lengths: list[int]) -> None:
    runs = [random_observations(rng, program.interface, steps) for steps in lengths]
    results = [interpreted(program, run, precision) for run in runs]
    raw, actions, status = (np.concatenate(parts) for parts in zip(*results, strict=True))
    trajectories = [(run, result[1]) for run, result in zip(runs, results, strict=True)]
    flat = histories_of(program.interface, trajectories, precision)
    assert len(flat) == len(raw)
    joined = join([histories_of(program.interface, [t], precision) for t in trajectories])
    chosen = sorted(rng.sample(range(len(flat)), min(len(flat), 11)))
    sample = flat.select(chosen)
    cases: list[tuple[HistorySet, object]] = [
        (flat, slice(None)),
        (joined, slice(None)),
        (sample, chosen),
        (join([sample, sample]), chosen + chosen),
    ]
    for histories, rows in cases:
        plan = compile_plan(program, precision, histories.layout)
        ours = plan.run({}, histories)
        assert_same_bits(ours, raw[rows], "raw result")
        applied = apply_actions(ours, histories)
        assert_same_bits(applied.actions, actions[rows], "applied action")
        assert applied.status.tolist() == status[rows].tolist()


@pytest.mark.parametrize("precision", list(Precision))
@given(rng=st.randoms(use_true_random=False))
@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
def test_hypothesis_programs(precision: Precision, rng: random.Random) -> None:
    check(random_program(rng), rng, precision, [12, 0, 1, 5])


@pytest.mark.parametrize("precision", list(Precision))
def test_many_programs(precision: Precision) -> None:
    for seed in range(400):
        rng = random.Random(seed)
        check(random_program(rng), rng, precision, [20, 3, 10])


def test_long_runs_in_several_blocks() -> None:
    rng = random.Random(7)
    for _ in range(3):
        check(random_program(rng), rng, Precision.BINARY64, [9000, 3, 500])
