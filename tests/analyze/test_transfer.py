"""Leaves as filters: exact, PIDs recognised, tangents elsewhere."""

from __future__ import annotations

import random
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from pirlc.analyze.paths import MOST_PATHS
from pirlc.analyze.transfer import leaves_of, operating_point
from pirlc.ir.evidence import Kind
from pirlc.semantics.policies import InterpretedPolicy
from tests.support.analysis import program_of

ROOT = Path(__file__).parents[2]
PRINTED = ROOT / "examples" / "torcs" / "printed"


def _leaves(text, at=None):
    program = program_of(text)
    return leaves_of(program, operating_point(program, at or {}))[0]


def _exact(*numbers):
    return tuple(Fraction(number) for number in numbers)


def _policy(action, sensors=("h",), window=5, params=""):
    lines = "\n".join(f"sensor {name} : [-1, 1] = {i}" for i, name in enumerate(sensors))
    return f"policy p\n{lines}\nwindow {window}\n{params}\naction A : [-9, 9] safe 0 = {action}\n"


# The printed programs


@pytest.mark.parametrize(
    ("file", "kp", "ki", "kd", "setpoints"),
    [
        ("aalborg", (0.97, 3.97), (0.05, 0.01), (49.98, 48.79), (0.44, 0.40)),
        ("g-track-1", (0.86, 0.95), (0.09, 5.02), (46.51, 43.89), (0.64, 0.60)),
    ],
)
def test_the_printed_pids_come_back_exactly(file, kp, ki, kd, setpoints):
    leaves = _leaves((PRINTED / f"{file}.pirl").read_text())
    assert [leaf.name for leaf in leaves] == ["steer", "accel 1", "accel 2"]
    for leaf, i in zip(leaves, (0, 1, 1), strict=True):
        assert leaf.linear
        assert leaf.evidence.kind is Kind.PROVED
        (filter_,), (pid,) = leaf.filters, leaf.pids
        p, s, d = _exact(kp[i], ki[i], kd[i])
        assert filter_.coefficients == (-(p + s + d), d - s, -s, -s, -s)
        assert (pid.kp, pid.ki, pid.kd, pid.window) == (p, s, d, 5)
        assert pid.dc_gain == p + 5 * s == -filter_.dc_gain
    assert [leaf.pids[0].setpoint for leaf in leaves] == [0, *_exact(*setpoints)]


def test_the_paths_of_a_switch_are_told_in_words():
    _, one, other = _leaves((PRINTED / "aalborg.pirl").read_text())
    guard = "0.001 - peek(trackPos, -1) > 0 and 0.001 + peek(trackPos, -1) > 0"
    assert (one.path, other.path) == ((guard,), (f"not ({guard})",))
    # At the middle of the road the first is taken.
    assert (one.active, other.active) == (True, False)


def test_the_finite_sum_is_said():
    steer, accel, _ = _leaves((PRINTED / "aalborg.pirl").read_text())
    assert steer.pids[0].steady_state == (
        "the integral is a sum over 5 readings: the gain at rest is kp + 5 ki = 1.22, not "
        "infinite; with a plant of gain 1, 45.045% of a change of the setpoint remains as an error"
    )
    assert accel.pids[0].error_share == pytest.approx(1 / (1 + 4.02))


# Signs and shapes


@pytest.mark.parametrize(
    ("action", "kp", "ki", "kd", "setpoint"),
    [
        ("2 * peek(0.25 - h, -1)", 2, 0, 0, 0.25),
        ("2 * peek(h - 0.25, -1)", -2, 0, 0, 0.25),
        ("2 * (0.25 - peek(h, -1)) + 4 * (peek(h, -2) - peek(h, -1))", 2, 0, 4, 0.25),
        ("2 * (0.25 - peek(h, -1)) - 4 * peek(diff(h), -1)", 2, 0, 4, 0.25),
        ("let e = 0.5 - h in 8 * peek(e, -1) + 0.5 * fold(+, e)", 8, 0.5, 0, 0.5),
        ("-(8 * peek(h, -1) + 0.5 * fold(+, h))", 8, 0.5, 0, 0),
        ("0.5 * fold(\\v acc -> acc - v, h, 0)", 0, 0.5, 0, 0),
    ],
)  # fmt: skip
def test_a_pid_is_known_in_any_spelling(action, kp, ki, kd, setpoint):
    (leaf,) = _leaves(_policy(action))
    (pid,) = leaf.pids
    assert (pid.kp, pid.ki, pid.kd) == (kp, ki, kd)
    assert pid.setpoint == Fraction(setpoint)
    assert pid.window == (5 if ki else 1)


def test_other_filters_are_not_called_pids():
    (leaf,) = _leaves(_policy("peek(h, -1) + 2 * peek(h, -4)"))
    assert leaf.filters[0].coefficients == (1, 0, 0, 2)
    assert leaf.pids == ()
    # A state feedback has no setpoint that its offset would tell.
    (leaf,) = _leaves(_policy("peek(h, -1) + 2 * peek(g, -1) + 1", ("h", "g")))
    assert (leaf.pids, leaf.offset) == ((), 1)
    (leaf,) = _leaves(_policy("fold(+, h) + 2 * peek(g, -1) + 1", ("h", "g")))
    assert leaf.pids[0].setpoint is None


def test_over_two_readings_a_sum_and_a_difference_are_one():
    (leaf,) = _leaves(_policy("3 * peek(0 - h, -1) + 2 * fold(+, 0 - h)", window=2))
    (pid,) = leaf.pids
    assert (pid.kp, pid.ki, pid.kd, pid.dc_gain) == (7, 0, -2, 7)
    assert leaf.notes == (
        "over two readings of h a sum and a difference cannot be told apart: written with a "
        "difference",
    )


def test_a_recalled_action_makes_a_true_integral():
    (leaf,) = _leaves(_policy("previous(A) + 0.125 * peek(0.5 - h, -1)"))
    assert [(r.action, r.coefficient) for r in leaf.recalls] == [("A", 1)]
    (pid,) = leaf.pids
    assert pid.error_share == 0.0
    assert pid.steady_state == ("true integral action through `previous`: no error remains at rest")


# Paths


def test_a_condition_that_stands_twice_is_decided_once():
    guard = "peek(h, -1) > 0"
    leaves = _leaves(_policy(f"(if {guard} then 1 else 2) + (if {guard} then 10 else 20)"))
    assert [leaf.offset for leaf in leaves] == [11, 22]


def test_side_by_side_conditions_are_combined_up_to_a_number():
    choices = " + ".join(f"(if peek(h, -1) > 0.{i} then 1 else 0)" for i in range(1, 4))
    assert len(_leaves(_policy(choices))) == 8
    choices = " + ".join(f"(if peek(h, -1) > 0.{i} then 1 else 0)" for i in range(1, 9))
    program = program_of(_policy(choices))
    leaves, notes = leaves_of(program, operating_point(program, {}))
    assert len(leaves) == MOST_PATHS
    assert notes == ("A has more than 64 paths; the first 64 are shown",)


def test_lets_around_a_condition_stay_with_it():
    text = _policy("let e = 0.5 - h in if peek(e, -1) > 0.25 then 2 * peek(e, -1) else 0")
    one, other = _leaves(text)
    assert one.path == ("peek(0.5 - h, -1) > 0.25",)
    assert (one.active, other.active) == (True, False)
    assert (one.offset, one.filters[0].coefficients) == (1, (-2,))


# Laws that are not affine


def test_a_tangent_is_called_one_and_names_its_bend():
    (leaf,) = _leaves(_policy("4 * sqrt(1 + peek(h, -1)) * peek(h, -2)"), {"h": 0.0})
    assert not leaf.linear
    assert leaf.evidence.kind is Kind.LINEARISED
    assert leaf.remainder == "a product, a square root"
    assert leaf.operating == {"h": 0.0}
    assert leaf.filters[0].coefficients == (0, 4)


def test_a_piece_of_a_piecewise_law_is_exact():
    (leaf,) = _leaves(_policy("abs(peek(h, -1)) + max(0, 2 * peek(h, -2) - 1)"), {"h": -0.5})
    assert leaf.filters[0].coefficients == (-1,)
    (leaf,) = _leaves(_policy("abs(peek(h, -1)) + max(0, 2 * peek(h, -2) - 1)"), {"h": 0.75})
    assert (leaf.filters[0].coefficients, leaf.offset) == ((1, 2), -1)
    assert leaf.remainder == "a max, an abs"


@pytest.mark.parametrize(
    ("action", "reason"),
    [
        ("abs(peek(h, -1))", "the corner of an abs"),
        ("max(peek(h, -1), 0)", "the corner of a max"),
        ("sqrt(peek(h, -1))", "a square root of 0"),
        ("sqrt(peek(h, -1) - 1)", "a square root of -1"),
        ("1 / peek(h, -1)", "a division by zero"),
        ("sign(peek(h, -1))", "the jump of a sign"),
        ("exp(1000 + peek(h, -1))", "an exp of 1000"),
    ],
)
def test_without_a_tangent_the_reason_is_told(action, reason):
    (leaf,) = _leaves(_policy(action))
    assert str(leaf.evidence) == f"unknown (no tangent at the operating point: {reason})"
    assert leaf.filters == ()


def test_tangents_are_casadis_derivatives():
    import casadi as ca

    from pirlc.symbolic.casadi_form import Element, hard_algebra, symbols_for
    from pirlc.symbolic.walk import walk

    program = program_of(
        _policy(
            "tanh(2 * peek(h, -1)) * sqrt(2 + peek(g, -1)) / (1.5 - peek(h, -2)) "
            "+ min(exp(peek(g, -1)), 3) + clip(4 * peek(h, -1), -1, peek(g, -2)) "
            "+ abs(peek(g, -1))",
            ("h", "g"),
        )
    )
    at = {"h": 0.375, "g": 0.25}
    (leaf,) = leaves_of(program, operating_point(program, at))[0]
    symbols = symbols_for(program, 1)
    raw = walk(program.bodies[0], hard_algebra(symbols))
    inputs = list(symbols.inputs.values())
    slopes = ca.Function("slopes", inputs, [ca.jacobian(raw, ca.vertcat(*inputs))])
    values = np.array(slopes(*(at[which.sensor] for which in symbols.inputs))).reshape(-1)
    found = {f.sensor: f.coefficients for f in leaf.filters}
    for which, value in zip(symbols.inputs, values, strict=True):
        assert isinstance(which, Element)
        taps = found[which.sensor]
        mine = float(taps[-1 - which.index]) if -which.index <= len(taps) else 0.0
        assert mine == pytest.approx(value, rel=1e-12, abs=1e-12)


def test_a_leaf_is_what_the_interpreter_computes():
    """On random readings the leaf whose conditions hold gives the interpreter's action."""
    program = program_of((PRINTED / "aalborg.pirl").read_text())
    leaves = leaves_of(program, operating_point(program, {}))[0]
    steer = leaves[0].filters[0]
    random_numbers = random.Random(1)
    policy = InterpretedPolicy(program)
    readings = []
    for _ in range(300):
        # Small and smooth, so that steering is seldom clipped.
        readings.insert(0, (readings[0] if readings else 0.0) + random_numbers.uniform(-0.01, 0.01))
        applied = policy.act((0.0, 0.0, readings[0], 0.0, 0.0, 0.4))[0]
        window = (readings + [readings[-1]] * 5)[:5]
        law = sum(float(c) * r for c, r in zip(steer.coefficients, window, strict=True))
        assert applied == pytest.approx(min(max(law, -1.0), 1.0), abs=1e-12)
