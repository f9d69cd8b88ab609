from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pirlc.analyze.findings import Leaf, Origin, Plant, ResponseFinding
from pirlc.analyze.plants.dithered import Rollouts
from pirlc.analyze.plants.find import find_plant
from pirlc.analyze.response import response_of
from pirlc.analyze.transfer import leaves_of, operating_point
from pirlc.ir.evidence import Kind
from pirlc.ir.policy import Environment, Program
from pirlc.simulation.torcs.installation import Installation
from tests.support.plants import SPRING, program, register_spring

HOLD = """policy hold
environment "Pendulum-v1"
sensor Side : [-1, 1] = 1
sensor Speed : [-8, 8] = 2
window 3
action Torque : [-2, 2] = -16 * peek(Side, -1) - 4 * peek(Speed, -1)
"""

TARGET = """policy target
environment "Pendulum-v1"
sensor Side : [-1, 1] = 1
window 3
param target = 0
action Torque : [-2, 2] = let e = target - Side in
                          14 * peek(e, -1) + fold(+, e) + 50 * (peek(e, -1) - peek(e, -2))
"""


def found(policy: Program, plant: Plant) -> tuple[Leaf, ...]:
    return leaves_of(policy, operating_point(policy, plant.operating))[0]


def answer(policy: Program, origin: Origin | None = None) -> tuple[Plant, ResponseFinding]:
    environment = policy.interface.environment
    assert environment is not None
    plant = find_plant(policy, environment, origin)
    return plant, response_of(policy, environment, plant, found(policy, plant)[0])


def test_the_pendulum_goes_upright_as_predicted() -> None:
    plant, finding = answer(program(HOLD))
    assert finding.what.startswith("released where Side is 0.0")
    assert set(finding.predicted) == {"Side", "Speed", "Torque"}
    assert min(finding.fit.values()) > 99.0
    assert max(finding.error.values()) < 0.01
    assert finding.evidence.kind is Kind.TESTED
    # The law, and the plant, at the first two steps.
    side, torque = finding.predicted["Side"], finding.predicted["Torque"]
    assert torque[0] == pytest.approx(-16.0 * side[0])
    assert side[1] == pytest.approx(plant.a[0][0] * side[0] + plant.b[0][0] * torque[0])
    assert finding.times[:2] == (0.0, 0.05)
    # The torque stays within half of its range.
    assert max(map(abs, torque)) <= 1.0 + 1e-12


@pytest.mark.parametrize("change", ["latency 1\nwindow 3", "fill zero\nwindow 3"])
def test_latency_and_warm_up_are_predicted_too(change: str) -> None:
    text = HOLD.replace("window 3", change).replace("-16", "-9").replace("- 4", "- 2")
    _, finding = answer(program(text))
    assert min(finding.fit.values()) > 97.0


def test_a_step_of_the_setpoint() -> None:
    _, finding = answer(program(TARGET))
    assert finding.what.startswith("a step of the setpoint of Side by 0.0")
    step = float(finding.what.rpartition(" ")[2])
    # kp + 3 ki, at once: the setpoint is a constant of the program.
    assert finding.predicted["Torque"][0] == pytest.approx(17.0 * step, rel=0.01)
    assert finding.simulated["Torque"][0] == pytest.approx(17.0 * step, rel=0.01)
    assert min(finding.fit.values()) > 95.0


def test_the_setpoint_steps_in_the_simulator_and_nowhere_else() -> None:
    # Gravity is 5 per Side, the torque 1: at rest 5 Side = 17 (Side - step), by hand.
    _, finding = answer(program(TARGET))
    step = float(finding.what.rpartition(" ")[2])
    assert finding.simulated["Side"][-1] == pytest.approx(17.0 * step / (17.0 - 5.0), rel=0.03)


def test_an_identified_plant_predicts_a_step_of_the_action() -> None:
    register_spring()
    _, finding = answer(program(SPRING), Origin.IDENTIFIED)
    assert min(finding.fit.values()) > 98.0


def test_a_simulator_without_equations_is_released_too() -> None:
    register_spring()
    text = SPRING.replace(
        "sensor Place : [-2, 2] = 1", "sensor Speed : [-4, 4] = 0\nsensor Place : [-2, 2] = 1"
    ).replace("* peek(Place, -1)", "* peek(Place, -1) - 0.1 * peek(Speed, -1)")
    _, finding = answer(program(text))
    assert finding.what == "released where Speed is 0.4 off"
    assert min(finding.fit.values()) > 99.9


def test_disagreement_is_shown() -> None:
    policy, environment = program(HOLD), Environment("Pendulum-v1")
    plant = find_plant(policy, environment)
    wrong = replace(plant, b=tuple((0.4 * row[0],) for row in plant.b))
    finding = response_of(policy, environment, wrong, found(policy, wrong)[0])
    assert finding.fit["Side"] < 50.0
    assert finding.error["Side"] > 0.1
    assert finding.notes[-1].startswith("prediction and simulator disagree in Side")


def test_unstable_loops_predict_nothing() -> None:
    policy, environment = program(HOLD.replace("-16", "16")), Environment("Pendulum-v1")
    plant = find_plant(policy, environment)
    finding = response_of(policy, environment, plant, found(policy, plant)[0])
    assert finding.evidence.kind is Kind.UNKNOWN
    assert finding.evidence.reason.startswith("the linear loop is unstable (spectral radius 1.")
    assert not finding.predicted


def test_the_car_steers_as_predicted(torcs_installation: Installation) -> None:
    text = """policy driver
environment "pirlc/Torcs-v0" { track = "michigan", laps = 0, termination = "ndps" }
sensor trackPos : [-1, 1] = 2
sensor rpm : [0, 1] = 5
window 5
action steer : [-1, 1] = let e = 0 - trackPos in
                         0.97 * peek(e, -1) + 0.05 * fold(+, e)
                         + 49.98 * (peek(trackPos, -2) - peek(trackPos, -1))
action accel : [0, 1] = 0.3 + 4 * (0.4 - peek(rpm, -1))
"""
    policy = program(text)
    environment = policy.interface.environment
    assert environment is not None
    plant = find_plant(policy, environment, rollouts=Rollouts(episodes=8, most_steps=1000))
    leaves = found(policy, plant)
    finding = response_of(policy, environment, plant, leaves[0], leaves[1:])
    assert finding.what == "a step of the setpoint of trackPos by 0.1"
    assert finding.fit["trackPos"] > 85.0
    assert finding.predicted["steer"][0] == pytest.approx(0.1 * (0.97 + 5 * 0.05))
    assert np.ptp(finding.simulated["trackPos"]) > 0.05
