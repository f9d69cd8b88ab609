"""Actions that switch between values: switching functions, sliding, limit cycles."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pirlc.analyze.analysis import analyze
from pirlc.analyze.plants.find import find_plant
from pirlc.ir.evidence import Kind
from pirlc.semantics.policies import InterpretedPolicy
from tests.support.analysis import plant_of, program_of
from tests.support.command_line import POLE

ROOT = Path(__file__).parents[2]


def _relay(guard, sensors=("x", "v"), window=1):
    lines = "\n".join(f"sensor {name} : [-100, 100] = {i}" for i, name in enumerate(sensors))
    return program_of(
        f"policy p\n{lines}\nwindow {window}\nsample_time 0.1\n"
        f"action A : {{0, 1}} = if {guard} then 1 else 0\n"
    )


def test_cartpole_has_no_linear_loop_and_says_so():
    program = program_of(POLE)
    plant = find_plant(program, program.interface.environment)
    found = analyze(program, plant)
    assert found.loops == ()
    assert found.notes == (
        "Push switches between values: it has no linear loop, and no gain or phase margin; its "
        "switching functions are given instead",
    )
    (relay,) = found.relays
    assert relay.text == "3 * peek(Angle, -1) + peek(AngularVelocity, -1) > 0"
    assert [(f.sensor, f.coefficients) for f in relay.filters] == [
        ("Angle", (3,)), ("AngularVelocity", (1,)),
    ]  # fmt: skip
    assert (relay.low, relay.high) == (0.0, 1.0)
    # On 3 angle + speed = 0, Euler's step of 0.02 s leaves 1 - 0.06 of the angle; the cart drifts.
    sizes = sorted(pole.real for pole in relay.sliding_poles)
    assert sizes == pytest.approx([0.94, 1.0, 1.0], abs=1e-6)
    assert relay.sliding_stable is False
    assert "the action pushes s toward 0" in relay.notes
    assert relay.evidence.kind is Kind.LINEARISED


def test_sliding_on_a_stable_surface():
    """A double integrator, T = 0.1, held on x + v = 0: the position loses a tenth each step."""
    plant = plant_of(
        [[1, 0.1], [0, 1]], [[0], [-0.1]], np.eye(2), ["A"], ["x", "v"], 0.1, {"A": 0.5}
    )
    (relay,) = analyze(_relay("peek(x, -1) + peek(v, -1) > 0"), plant).relays
    assert [pole.real for pole in relay.sliding_poles] == pytest.approx([0.9])
    assert relay.sliding_stable is True
    assert "the action pushes s toward 0" in relay.notes


def test_a_surface_that_answers_late_is_told():
    plant = plant_of([[1, 0.1], [0, 1]], [[0], [-0.1]], np.eye(2), ["A"], ["x", "v"], 0.1)
    (relay,) = analyze(_relay("peek(x, -1) > 0"), plant).relays
    assert relay.sliding_poles == ()
    assert (
        "s answers the action after 2 steps: it cannot be held at 0 from one step to the next"
        in relay.notes
    )


def test_the_limit_cycle_is_near_the_simulated_one():
    """1 / (s + 1)^3 sampled at 0.1 s under a relay of +-1: the describing function of the
    continuous loop says sqrt(3) rad/s and an amplitude of 1 / (2 pi) (Astrom and Murray,
    Feedback Systems, 2nd ed., 10.5: 4 M / (pi a) = 8)."""
    import scipy.linalg

    a = np.array([[-1.0, 1, 0], [0, -1, 1], [0, 0, -1]])
    whole = np.zeros((4, 4))
    whole[:3, :3], whole[2, 3] = a, -2.0
    held = scipy.linalg.expm(whole * 0.1)
    # The action is 0 or 1; around 0.5 that is -1 or 1 through the gain of -2.
    plant = plant_of(held[:3, :3], held[:3, 3:], [[1, 0, 0]], ["A"], ["x"], 0.1, {"A": 0.5})
    program = _relay("peek(x, -1) > 0", ("x",))
    (relay,) = analyze(program, plant).relays
    (cycle,) = [cycle for cycle in relay.cycles if cycle.period > 3]
    assert cycle.stable
    assert cycle.frequency == pytest.approx(math.sqrt(3), rel=0.1)
    assert cycle.amplitude == pytest.approx(1 / (2 * math.pi), rel=0.25)
    state, policy, seen = np.array([0.3, 0.0, 0.0]), InterpretedPolicy(program), []
    for _ in range(1500):
        seen.append(state[0])
        (action,) = policy.act((state[0],))
        state = held[:3, :3] @ state + held[:3, 3] * (action - 0.5)
    late = np.array(seen[500:])
    crossings = np.count_nonzero((late[:-1] < 0) & (late[1:] >= 0))
    assert cycle.period == pytest.approx(len(late) / crossings, rel=0.05)
    assert cycle.amplitude == pytest.approx(np.max(late), rel=0.1)


def test_each_comparison_of_a_guard_is_a_switching_function():
    program = _relay("peek(x, -1) > 1 or (peek(v, -1) < 2 and not peek(x, -1) - peek(v, -1) >= 0)")
    found = analyze(program)
    assert [relay.text for relay in found.relays] == [
        "peek(x, -1) > 1", "peek(v, -1) < 2", "peek(x, -1) - peek(v, -1) >= 0",
    ]  # fmt: skip
    assert [(relay.low, relay.high) for relay in found.relays] == [(0, 1), (0, 1), (1, 0)]
    assert [float(relay.offset) for relay in found.relays] == [-1, 2, 0]
    assert all(relay.evidence.kind is Kind.PROVED for relay in found.relays)


def test_a_let_around_a_guard():
    program = _relay("(let e = 1 - x in peek(e, -1) > 0 and 2 * peek(e, -1) < 3)")
    one, other = analyze(program).relays
    assert (one.filters[0].coefficients, one.offset) == ((-1,), 1)
    assert (other.filters[0].coefficients, other.offset) == ((2,), 1)


def test_a_continuous_action_of_constants_is_a_relay_too():
    program = program_of(
        "policy p\nsensor x : [-1, 1] = 0\n"
        "action U : [-1, 1] safe 0 = if peek(x, -1) > 0.5 then -1 else 0.5\n"
    )
    (relay,) = analyze(program).relays
    assert (relay.low, relay.high, float(relay.offset)) == (0.5, -1.0, -0.5)


def test_every_classic_program_is_analysed_in_seconds():
    import time

    for name in ("acrobot", "mountain_car"):
        head = (ROOT / "examples" / name / f"{name}.pirl").read_text()
        head = head[: head.index("\naction")]
        body = (ROOT / "examples" / name / "README.md").read_text()
        body = body[body.index("```text\n") + 8 :]
        program = program_of(head + "\n" + body[: body.index("```")])
        before = time.perf_counter()
        found = analyze(program, find_plant(program, program.interface.environment))
        assert time.perf_counter() - before < 5.0
        assert found.relays
