from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pirlc.analyze.findings import Origin
from pirlc.analyze.identification import (
    Arx,
    Record,
    choose,
    fit_arx,
    fit_by_instruments,
    fit_percent,
    free_run,
    loss,
    one_step,
)
from pirlc.analyze.plants.dithered import Rollouts
from pirlc.analyze.plants.find import find_plant
from pirlc.analyze.plants.identified import horizon_of
from pirlc.ir.evidence import Kind
from pirlc.ir.policy import Environment
from pirlc.simulation.torcs.installation import Installation
from tests.support.plants import PENDULUM, SPRING, Spring, program, register_spring

TRUE = Arx(
    a=np.array([[[1.2, 0.1], [0.0, 0.5]], [[-0.5, 0.0], [0.2, 0.1]]]),
    b=np.array([[[1.0], [0.0]], [[0.3], [0.7]]]),
    y_mean=np.array([3.0, -1.0]),
    u_mean=np.array([0.5]),
    constant=np.array([0.2, -0.1]),
)
"""Two readings, one action, order 2, stable."""


def records(model: Arx, count: int, steps: int, noise: float, seed: int = 1) -> list[Record]:
    generator = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        u = generator.standard_normal((steps, 1))
        y = np.zeros((steps, 2))
        for k in range(steps):
            for i in range(min(model.order, k)):
                y[k] += model.a[i] @ y[k - 1 - i] + model.b[i] @ u[k - 1 - i]
            y[k] += model.constant + noise * generator.standard_normal(2)
        found.append(Record(y + model.y_mean, u + model.u_mean))
    return found


def test_arx_recovers_what_made_the_data() -> None:
    model = fit_arx(records(TRUE, 4, 200, 0.0), 2)
    assert np.allclose(model.a, TRUE.a, rtol=0, atol=1e-10)
    assert np.allclose(model.b, TRUE.b, rtol=0, atol=1e-10)
    # The constant belongs to the means from which it is measured.
    rest = np.eye(2) - TRUE.a.sum(axis=0)
    shift, gain = model.y_mean - TRUE.y_mean, TRUE.b.sum(axis=0)
    moved = TRUE.constant - rest @ shift + gain @ (model.u_mean - TRUE.u_mean)
    assert np.allclose(model.constant, moved, rtol=0, atol=1e-9)


def test_its_state_space_answers_as_it_does() -> None:
    a, b, c = TRUE.state_space()
    record = records(TRUE, 1, 40, 0.0)[0]
    still = replace(TRUE, constant=np.zeros(2))
    start = Record(np.tile(TRUE.y_mean, (40, 1)), record.u)
    start.y[1] += TRUE.b[0] @ (record.u[0] - TRUE.u_mean)
    run, _ = free_run(still, start)
    x, answers = np.zeros(4), []
    for u in record.u - TRUE.u_mean:
        answers.append(c @ x)
        x = a @ x + b @ u
    assert np.allclose(run, np.array(answers)[2:], rtol=0, atol=1e-12)


def test_a_free_run_of_one_step_is_the_prediction_of_one_step() -> None:
    record = records(TRUE, 1, 60, 0.3)[0]
    assert np.allclose(free_run(TRUE, record, 1)[0], one_step(TRUE, record)[0])
    # In between: the first of every five is predicted from readings alone.
    free, ahead = free_run(TRUE, record, 5)[0], one_step(TRUE, record)[0]
    same = np.all(np.isclose(free, ahead), axis=1)
    assert list(np.flatnonzero(same)) == list(range(0, 58, 5))


def test_the_order_is_found_on_data_held_out() -> None:
    data = records(TRUE, 9, 300, 0.1)
    chosen = choose(data[:6], data[6:])
    assert chosen.model.order == 2
    assert [order for order, _ in chosen.losses] == list(range(1, 9))
    assert chosen.losses[0][1] > 1.5 * chosen.losses[1][1]
    assert loss(chosen.model, data[6:]) == pytest.approx(chosen.losses[1][1], rel=0.1)


def test_disturbances_in_a_closed_loop_mislead_least_squares_but_not_instruments() -> None:
    # y(k) = 0.9 y(k-1) + 0.5 u(k-1) + a slow disturbance, u = -0.8 y + dither.
    generator = np.random.default_rng(3)
    data = []
    for _ in range(12):
        y, slow, rows = 0.0, 0.0, []
        dither = np.repeat(generator.uniform(-0.5, 0.5, 100), 8)[:, None]
        for level in dither[:, 0]:
            u = -0.8 * y + level
            rows.append((y, u))
            slow = 0.97 * slow + 0.02 * generator.standard_normal()
            y = 0.9 * y + 0.5 * u + slow
        taken = np.array(rows)
        data.append(Record(taken[:, :1], taken[:, 1:], dither))
    biased, found = fit_arx(data, 1), fit_by_instruments(data, 1)
    assert found is not None
    assert abs(biased.a[0, 0, 0] - 0.9) > 0.05
    assert found.a[0, 0, 0] == pytest.approx(0.9, abs=0.02)
    assert found.b[0, 0, 0] == pytest.approx(0.5, abs=0.02)
    assert choose(data[:8], data[8:], most=1).instruments
    still = [Record(record.y, record.u) for record in data]
    assert fit_by_instruments(still, 1) is None
    assert not choose(still[:8], still[8:], most=1).instruments


def test_fit_is_of_the_variation_about_the_mean() -> None:
    measured = np.array([[1.0], [2.0], [3.0], [4.0]])
    assert fit_percent(measured, measured)[0] == 100.0
    assert fit_percent(np.full((4, 1), 2.5), measured)[0] == 0.0
    off = measured + np.array([[0.5], [-0.5], [0.5], [-0.5]])
    assert fit_percent(off, measured)[0] == pytest.approx(100 * (1 - 1 / np.sqrt(5)))
    assert fit_percent(np.full((4, 1), np.inf), measured)[0] == -np.inf


def test_free_runs_of_unstable_models_are_short() -> None:
    def scalar(pole: float) -> Arx:
        one = np.ones((1, 1, 1))
        return Arx(pole * one, one, np.zeros(1), np.zeros(1), np.zeros(1))

    assert horizon_of(scalar(0.9)) == horizon_of(scalar(1.0)) == 50
    assert horizon_of(scalar(1.2)) == 6
    assert horizon_of(scalar(30.0)) == 3


def test_the_spring_is_identified_from_the_program_that_moves_it() -> None:
    register_spring()
    plant = find_plant(program(SPRING), Environment("Spring-v0"), Origin.IDENTIFIED)
    assert plant.fit["Place"] > 99.0
    poles = np.linalg.eigvals(np.array(plant.a))
    for pole in np.linalg.eigvals(Spring.A):
        assert np.min(np.abs(poles - pole)) < 1e-3
    # From the push to the place: the same first steps.
    a, b, c = (np.array(matrix) for matrix in (plant.a, plant.b, plant.c))
    for k in range(10):
        expected = (np.linalg.matrix_power(Spring.A, k) @ Spring.B)[0, 0]
        assert (c @ np.linalg.matrix_power(a, k) @ b)[0, 0] == pytest.approx(expected, abs=1e-4)


def test_the_pendulum_is_identified_where_it_is_held() -> None:
    policy, environment = program(PENDULUM), Environment("Pendulum-v1")
    text = PENDULUM.replace("0.7", "0.7 or peek(Height, -1) + 0.27 * abs(peek(Speed, -1)) > 1.1")
    plant = find_plant(program(text), environment, Origin.IDENTIFIED)
    assert plant.evidence.kind is Kind.TESTED
    assert plant.evidence.cases > 200
    assert (plant.inputs, plant.outputs) == (("Torque",), ("Side", "Speed"))
    assert min(plant.fit.values()) > 90.0
    fastest = np.max(np.abs(np.linalg.eigvals(np.array(plant.a))))
    exact = np.linalg.eigvals(np.array(find_plant(policy, environment).a))
    assert fastest == pytest.approx(np.max(np.abs(exact)), abs=0.005)
    assert plant.notes[0].startswith("Torque: ARX of order ")
    assert "fit on held-out rollouts: Side " in plant.notes[0]


def test_the_same_rollouts_give_the_same_plant() -> None:
    register_spring()
    policy, environment = program(SPRING), Environment("Spring-v0")
    rollouts = Rollouts(episodes=4, seed=3)
    one = find_plant(policy, environment, Origin.IDENTIFIED, rollouts=rollouts)
    assert one == find_plant(policy, environment, Origin.IDENTIFIED, rollouts=rollouts)
    other = find_plant(policy, environment, Origin.IDENTIFIED, rollouts=Rollouts(4, seed=4))
    assert one.a != other.a


def test_actions_with_sensors_of_their_own_are_identified_apart(
    torcs_installation: Installation,
) -> None:
    text = """policy driver
environment "pirlc/Torcs-v0" { track = "michigan", laps = 0, termination = "ndps" }
sensor trackPos : [-1, 1] = 2
sensor rpm : [0, 1] = 5
window 5
action steer : [-1, 1] = 0 - peek(trackPos, -1) + 50 * (peek(trackPos, -2) - peek(trackPos, -1))
action accel : [0, 1] = 0.3 + 4 * (0.4 - peek(rpm, -1))
"""
    policy = program(text)
    assert policy.interface.environment is not None
    plant = find_plant(
        policy, policy.interface.environment, rollouts=Rollouts(episodes=8, most_steps=900)
    )
    assert plant.origin is Origin.IDENTIFIED
    assert plant.sample_time == pytest.approx(0.02)
    assert (plant.inputs, plant.outputs) == (("steer", "accel"), ("trackPos", "rpm"))
    a, b, c = (np.array(matrix) for matrix in (plant.a, plant.b, plant.c))
    # Steering does not move the engine, nor the engine the car across the road.
    gains = [c @ np.linalg.matrix_power(a, k) @ b for k in range(30)]
    assert all(gain[0, 1] == gain[1, 0] == 0.0 for gain in gains)
    # Steering to the left moves the car to the left, ever faster: two poles near 1.
    across = np.cumsum([gain[0, 0] for gain in gains])
    assert across[-1] > 3 * across[14] > 0.0
    near = [z for z in np.linalg.eigvals(a) if abs(z - 1.0) < 0.06]
    assert len(near) >= 2
    assert plant.fit["trackPos"] > 40.0
    assert any("cannot be put into a chosen state" in note for note in plant.notes)
