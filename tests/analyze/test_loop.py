"""Loops of programs around linear plants, against the reference interpreter around the same."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from pirlc.analyze.analysis import analyze
from pirlc.analyze.schur import by_lyapunov, characteristic, is_schur
from pirlc.diagnostics import PirlcError
from pirlc.ir.evidence import Kind
from pirlc.report.data import as_data
from pirlc.semantics.policies import InterpretedPolicy
from tests.support.analysis import plant_of, program_of

ENGINE = """policy engine
sensor Speed : [-100, 100] = 0
window 4
sample_time 0.1
{latency}
param r = {setpoint}
action Gas : [-1000, 1000] safe 0 = 2 * peek(r - Speed, -1) + 0.25 * fold(+, r - Speed)
                                  + 1.5 * (peek(Speed, -2) - peek(Speed, -1))
"""

TWO = """policy two
sensor X : [-100, 100] = 0
sensor Y : [-100, 100] = 1
window 2
action U : [-1000, 1000] safe 0 = 0.5 * peek({setpoint} - X, -1) + 0.125 * peek(Y, -2)
                                - 0.25 * previous(V)
action V : [-1000, 1000] safe 0 = -0.25 * peek(Y, -1) + 0.5 * previous(V) + 0.125 * previous(U)
"""

SPEED = plant_of([[0.9, 0.1], [0, 0.7]], [[0], [0.3]], [[1, 0]], ["Gas"], ["Speed"], 0.1)
PAIR = plant_of(
    [[0.8, 0.1], [-0.1, 0.9]], [[0.2, 0.1], [0, 0.3]], np.eye(2), ["U", "V"], ["X", "Y"]
)


def _simulated(program, plant, steps):
    """The interpreter around the plant, at rest before: readings and actions, (steps, k)."""
    a, b, c = (np.array(matrix) for matrix in (plant.a, plant.b, plant.c))
    state, policy, trace = np.zeros(len(a)), InterpretedPolicy(program), []
    for _ in range(steps):
        reading = c @ state
        action = policy.act(tuple(reading))
        trace.append([*reading, *action])
        state = a @ state + b @ np.array(action)
    return np.array(trace)


@pytest.mark.parametrize("latency", [0, 1, 3])
def test_the_step_response_is_the_interpreters(latency):
    text = ENGINE.replace("{latency}", f"latency {latency}")
    found = analyze(program_of(text.replace("{setpoint}", "0")), SPEED)
    (loop,) = found.loops
    assert loop.stable
    assert loop.latency == latency
    assert loop.step.what == "the setpoint of Speed"
    steps = len(loop.step.times)
    trace = _simulated(program_of(text.replace("{setpoint}", "1")), SPEED, steps)
    np.testing.assert_allclose(loop.step.outputs["Speed"], trace[:, 0], atol=1e-9)
    np.testing.assert_allclose(loop.step.action, trace[:, 1], atol=1e-9)
    assert loop.step.times[1] == pytest.approx(0.1)
    # The plant's gain at rest is 1, the program's 2 + 4 * 0.25.
    assert loop.step.final == pytest.approx(0.75)
    assert found.leaves[0].pids[0].error_share == pytest.approx(0.25)
    assert "with the plant's gain at rest of 1, 25.000%" in found.leaves[0].pids[0].steady_state


def test_two_actions_that_recall_each_other():
    found = analyze(program_of(TWO.replace("{setpoint}", "0")), PAIR)
    one, other = found.loops
    assert (one.others, other.others) == ({"V": "V"}, {"U": "U"})
    # The same closed loop, wherever it is broken.
    for first, second in zip(one.poles, other.poles, strict=True):
        assert first.magnitude == pytest.approx(second.magnitude, abs=1e-12)
    assert all(check.difference < 1e-9 for loop in found.loops for check in loop.checks)
    # Eigenvalues are the decay that the interpreter shows.
    trace = _simulated(program_of(TWO.replace("{setpoint}", "1")), PAIR, 120)
    rest = trace[-1, :2]
    sizes = np.linalg.norm(trace[40:80, :2] - rest, axis=1)
    rate = math.exp(np.polyfit(np.arange(40), np.log(sizes), 1)[0])
    assert rate == pytest.approx(one.poles[0].magnitude, rel=0.02)


def test_latency_of_the_command_takes_the_place_of_the_programs():
    program = program_of(ENGINE.replace("{latency}", "").replace("{setpoint}", "0"))
    margins = [analyze(program, SPEED, latency=k).loops[0].margins for k in (0, 1)]
    assert margins[0].delay_seconds - margins[1].delay_seconds == pytest.approx(0.1)
    lost = margins[0].phase_frequency * 0.1
    assert margins[0].phase - margins[1].phase == pytest.approx(math.degrees(lost))


def test_an_unstable_loop_has_no_margins_and_says_so_exactly():
    program = program_of(ENGINE.replace("{latency}", "latency 9").replace("{setpoint}", "0"))
    (loop,) = analyze(program, SPEED).loops
    assert (loop.stable, loop.margins, loop.step) == (False, None, None)
    assert loop.poles[0].magnitude > 1.0
    assert loop.evidence.kind is Kind.LINEARISED
    (note,) = loop.notes
    found = re.fullmatch(
        r"with its gain multiplied by a factor between 0 and (.*) this loop would be stable", note
    )
    for share, stable in ((0.999, True), (1.001, False)):
        text = ENGINE.replace("{latency}", "latency 9").replace("{setpoint}", "0").rstrip()
        changed = text.replace("safe 0 = ", f"safe 0 = {share * float(found[1])} * (") + ")\n"
        assert analyze(program_of(changed), SPEED).loops[0].stable is stable


def test_a_drift_that_no_sensor_shows_is_told():
    plant = plant_of([[0.5, 0], [1, 1]], [[1], [0]], [[1, 0]], ["Gas"], ["Speed"])
    text = (
        "policy p\nsensor Speed : [-1, 1] = 0\n"
        "action Gas : [-1, 1] safe 0 = -0.25 * peek(Speed, -1)\n"
    )
    (loop,) = analyze(program_of(text), plant).loops
    assert not loop.stable
    assert loop.notes == (
        "the plant's poles at 1 are not moved by this loop; the margins are those of the rest",
    )
    # Of 0.25 / (z - 0.5): the pole 0.5 - 0.25 k reaches -1 at k = 6.
    assert loop.margins.gain_up == pytest.approx(6.0)


@pytest.mark.parametrize(("fit", "told"), [(49.0, True), (51.0, False)])
def test_a_model_that_explains_little_is_told(fit, told):
    plant = replace(SPEED, fit={"Speed": fit})
    (loop,) = analyze(program_of(ENGINE.format(latency="", setpoint=0)), plant).loops
    assert any("(Speed 49 % in free runs)" in note for note in loop.notes) is told


def test_a_leaf_that_reads_nothing_of_the_plant_has_no_loop():
    plant = plant_of([[0.5]], [[1]], [[1]], ["U"], ["X"])
    text = TWO.replace("{setpoint}", "0").replace("previous(V)", "0").replace("previous(U)", "0")
    found = analyze(program_of(text), plant)
    assert [loop.action for loop in found.loops] == ["U"]
    assert "no loop of V: V does not act on the plant" in found.notes
    assert found.loops[0].notes == ("Y is not answered by the plant and stays at rest",)


def test_an_action_that_moves_nothing_it_reads():
    plant = plant_of([[0.5]], [[0, 1]], [[1]], ["Gas", "U"], ["Speed"])
    text = (
        "policy p\nsensor Speed : [-1, 1] = 0\n"
        "action Gas : [-1, 1] safe 0 = peek(Speed, -1)\naction U : [-1, 1] safe 0 = 0.125\n"
    )
    (loop,) = analyze(program_of(text), plant).loops
    assert (loop.stable, loop.margins) == (True, None)
    assert loop.notes == ("the action does not move what it reads: nothing to lose or to gain",)


def test_everything_is_plain_data():
    found = analyze(program_of(ENGINE.replace("{latency}", "").replace("{setpoint}", "0")), SPEED)
    data = as_data(found)
    assert json.loads(json.dumps(data, allow_nan=False)) == data
    assert data["loops"][0]["margins"]["gain_up"] > 1.0
    assert data["leaves"][0]["pids"][0]["ki"] == {"exact": "1/4", "decimal": 0.25}


def test_without_a_plant_the_leaves_alone():
    found = analyze(program_of(ENGINE.replace("{latency}", "").replace("{setpoint}", "0.5")))
    assert found.loops == ()
    assert found.leaves[0].pids[0].setpoint == Fraction(1, 2)
    assert found.notes == ("no plant: no loops, no margins",)


def test_schur_and_cohns_test_is_exact():
    """Eigenvalues at 1 - 2^-60 and at 1, which no eigenvalue routine tells apart."""
    near = Fraction(1) - Fraction(1, 2**60)
    for largest, stable in ((near, True), (Fraction(1), False), (-near, True), (-2 + near, False)):
        mixed = [[largest, Fraction(1)], [Fraction(0), Fraction(1, 2)]]
        assert is_schur(mixed) is stable
    rng = np.random.default_rng(0)
    for n in (1, 2, 3, 5, 8, 10):
        matrix = rng.normal(size=(n, n))
        matrix /= np.max(np.abs(np.linalg.eigvals(matrix))) * rng.uniform(0.9, 1.1)
        exact = [[Fraction(x) for x in row] for row in matrix.tolist()]
        np.testing.assert_allclose([float(x) for x in characteristic(exact)], np.poly(matrix))
        assert is_schur(exact) == (np.max(np.abs(np.linalg.eigvals(matrix))) < 1)


@pytest.mark.parametrize("n", [3, 17, 30])
def test_a_lyapunov_function_decides_larger_loops(n):
    rng = np.random.default_rng(n)
    for size in (0.9, 0.999, 1.001, 1.1):
        matrix = rng.normal(size=(n, n))
        matrix *= size / np.max(np.abs(np.linalg.eigvals(matrix)))
        # Rows and columns of different size, as states in their own units have.
        units = 10.0 ** rng.uniform(-4, 4, size=n)
        matrix = matrix * units[:, None] / units
        exact = [[Fraction(x) for x in row] for row in matrix.tolist()]
        assert by_lyapunov(exact) is (size < 1)
    assert by_lyapunov([[Fraction(1, 2), Fraction(0)], [Fraction(0), Fraction(1)]]) is None


def test_disagreement_stops_the_analysis(monkeypatch):
    """Two descriptions of one loop that differ: here, by a fault put into one of them."""
    from pirlc.analyze import loop

    whole = loop.composed
    monkeypatch.setattr(loop, "composed", lambda *parts: whole(*parts) * (1 + 1e-4))
    program = program_of(ENGINE.replace("{latency}", "").replace("{setpoint}", "0"))
    with pytest.raises(PirlcError) as caught:
        analyze(program, SPEED)
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.code == "E0921"
    assert diagnostic.message == "two ways to a margin of the loop with Gas disagree"


def test_random_sampled_plants_under_pids_pass_all_checks():
    """Integrators, lags, resonances, unstable poles, at 3 to 1000 samples a second, in the whole
    chain from program to margins; a disagreement would raise."""
    import scipy.linalg

    rng = np.random.default_rng(7)
    stable = 0
    while stable < 12:
        w = 10 ** rng.uniform(-1, 1.3)
        damping = 10 ** rng.uniform(-3, 0)
        a, b = [
            ([[0, 1], [0, 0]], [[0], [1]]),
            ([[0, 1], [0, -w]], [[0], [w]]),
            ([[0, 1], [-w * w, -2 * damping * w]], [[0], [w * w]]),
            ([[0, 1], [w * w, 0]], [[0], [w]]),
            ([[-w, w, 0], [0, -w, w], [0, 0, -w]], [[0], [0], [w]]),
        ][int(rng.integers(0, 5))]
        n, step = len(a), 10 ** rng.uniform(-3, -0.5)
        whole = np.zeros((n + 1, n + 1))
        whole[:n, :n], whole[:n, n:] = a, b
        held = scipy.linalg.expm(whole * step)
        row = np.eye(n)[:1]
        plant = plant_of(held[:n, :n], held[:n, n:], row, ["Gas"], ["Speed"], step)
        kp = 10 ** rng.uniform(-2, 2)
        ki, kd = kp * step * 10 ** rng.uniform(-2, 1), kp / step * 10 ** rng.uniform(-3, 0.3)
        program = program_of(
            "policy p\nsensor Speed : [-1, 1] = 0\n"
            f"window {rng.integers(2, 10)}\nlatency {rng.integers(0, 3)}\n"
            f"action Gas : [-1, 1] safe 0 = {kp!r} * peek(0 - Speed, -1) "
            f"+ {ki!r} * fold(+, 0 - Speed) + {kd!r} * (peek(Speed, -2) - peek(Speed, -1))\n"
        )
        (loop,) = analyze(program, plant).loops
        if loop.stable:
            stable += 1
            assert len(loop.checks) == 8
            assert max(check.difference for check in loop.checks) <= 1e-6
        else:
            assert max(pole.magnitude for pole in loop.poles) > 1.0 - 1e-9


def test_leaves_that_differ_in_their_offset_are_one_loop():
    guards = " + ".join(f"(if peek(Speed, -1) > 0.{i} then {i} else 0)" for i in range(1, 6))
    text = (
        "policy p\nsensor Speed : [-1, 1] = 0\n"
        f"action Gas : [-9, 9] safe 0 = {guards} - peek(Speed, -1)\n"
    )
    found = analyze(program_of(text), SPEED)
    assert len(found.leaves) == len(found.loops) == 32
    assert len({loop.margins for loop in found.loops}) == 1
    assert len({loop.leaf for loop in found.loops}) == 32


def test_of_many_different_loops_some_are_left_out_and_named():
    guards = " + ".join(
        f"(if peek(Speed, -1) > 0.{i} then {2**-i} * peek(Speed, -1) else 0)" for i in range(1, 6)
    )
    text = (
        "policy p\nsensor Speed : [-1, 1] = 0\n"
        f"action Gas : [-9, 9] safe 0 = {guards} - 2 * peek(Speed, -1)\n"
    )
    found = analyze(program_of(text), SPEED)
    assert (len(found.leaves), len(found.loops)) == (32, 24)
    assert "no loop of Gas 25: 24 loops are looked at" in found.notes
