"""Emitted Python on its own: as a module, and in Stable-Baselines3's hands."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest

from pirlc.backend.emit import emit_to
from pirlc.backend.policies import python_controller, python_policy
from pirlc.ir.policy import Choice, FreeParameter, ProgramTemplate
from tests.backend.helpers import load_program, program_of


def controller_of(program, **params):
    return python_controller(program).with_params(params).controller


def test_a_module_that_needs_the_standard_library_alone(tmp_path):
    emit_to(load_program("cartpole"), tmp_path, ["python"])
    code = (
        "import sys; from cartpole import Controller, PARAMS, SAFE_USED\n"
        "c = Controller({'c': 100.0}); d = Controller()\n"
        "print(c.step((0.0, 0.0, 0.1, 0.0)), d.step([0, 0, 1, 0]), d.status, PARAMS)\n"
        "print(d.predict([0.0, 0.0, 0.1, 0.0])[0], d.predict([[0.0] * 4, [1.0] * 4])[0])\n"
        "print([m for m in sys.modules if m.split('.')[0] in ('pirlc', 'numpy')])\n"
    )
    found = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout.splitlines() == [
        "0 1 2 {'k1': 3.0, 'k2': 1.0, 'c': 0.0}",
        "1 [0, 1]",
        "[]",
    ]


def test_every_kind_of_observation_vector():
    program = load_program("cartpole")
    for make in (list, tuple, np.array, lambda v: np.array(v, np.float32), np.longdouble):
        controller = controller_of(program)
        assert controller.step(make([0.0, 0.0, 0.25, -0.5])) == 1
        assert controller.status == 0
    assert type(controller.step([np.float32(0.0)] * 4)) is int


SUMMING = """
policy summing
sensor x : [0, 100] = 0
window 3
action u : [0, 1000] = fold(+, x)
"""


def test_predict_keeps_a_state_for_each_environment():
    controller = controller_of(program_of(SUMMING))
    observe = lambda *rows: np.array([[row] for row in rows], dtype=np.float32)  # noqa: E731
    starts = np.ones(2, dtype=bool)
    actions, states = controller.predict(observe(1, 10), None, starts)
    assert actions.tolist() == [[3.0], [30.0]] and actions.dtype == np.float32
    after, later = controller.predict(observe(2, 20), states, np.array([False, True]))
    assert after.tolist() == [[4.0], [60.0]]
    # The states handed in are not changed: the same call again gives the same answer.
    again, _ = controller.predict(observe(2, 20), states, np.array([False, True]))
    assert again.tolist() == after.tolist()
    third, _ = controller.predict(observe(3, 30), later, np.array([False, False]))
    assert third.tolist() == [[6.0], [70.0]]


def test_predict_without_states_keeps_them_itself():
    controller = controller_of(program_of(SUMMING))
    predict = lambda x, **options: controller.predict(np.array([x]), **options)[0].tolist()  # noqa: E731
    assert [predict(x) for x in (1.0, 2.0, 3.0)] == [[3.0], [4.0], [6.0]]
    assert predict(5.0, episode_start=True) == [15.0]
    assert predict(6.0, episode_start=np.array([False])) == [16.0]
    controller.step([7.0])
    assert predict(7.0) == [18.0]


def test_predict_and_step_do_not_disturb_each_other():
    controller = controller_of(program_of(SUMMING))
    assert controller.step([1.0]) == (3.0,)
    controller.predict(np.array([[math.nan]]), None, np.ones(1))
    assert controller.status == 0
    assert controller.step([2.0]) == (4.0,)


@pytest.mark.parametrize("environments", [1, 3])
def test_stable_baselines3_evaluates_it(environments):
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.evaluation import evaluate_policy

    controller = controller_of(load_program("cartpole"))
    vector = make_vec_env("CartPole-v1", n_envs=environments, seed=1)
    mean, spread = evaluate_policy(controller, vector, n_eval_episodes=3)
    assert (mean, spread) == (500.0, 0.0)


def test_stable_baselines3_evaluates_continuous_actions():
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.evaluation import evaluate_policy

    program = program_of(
        """
        policy damped
        sensor cosine : [-1, 1] = 0
        sensor sine : [-1, 1] = 1
        sensor speed : [-8, 8] = 2
        action torque : [-2, 2] = -10 * peek(sine, -1) - 2 * peek(speed, -1)
        """
    )
    vector = make_vec_env("Pendulum-v1", n_envs=2, seed=1)
    mean, _ = evaluate_policy(controller_of(program), vector, n_eval_episodes=2)
    assert -2000.0 < mean < 0.0


def test_one_text_serves_all_values_of_a_template():
    program = load_program("cartpole")
    free = tuple(FreeParameter(p.name, -5.0, 5.0) for p in program.parameters)
    template = ProgramTemplate(program.interface, free, program.bodies)
    made = python_controller(template)
    observation = [0.0, 0.0, 0.2, -0.5]
    for values in ({"k1": 3.0, "k2": 1.0, "c": 0.0}, {"k1": 1.0, "k2": 1.0, "c": 0.0}):
        fixed = python_policy(template.close(values))
        assert made.with_params(values).act(observation) == fixed.act(observation)
    assert made.with_params({"k1": 3.0, "k2": 1.0}).act(observation) == (1,)


def test_a_discrete_action_among_several_is_an_int():
    program = load_program("two_actions")
    assert isinstance(program.interface.actions[1].domain, Choice)
    gear, steer = controller_of(program).step([50.0] * 8)
    assert type(gear) is int and type(steer) is float


def test_a_reset_forgets_the_status():
    controller = controller_of(program_of(SUMMING))
    assert (controller.status, controller.sensor_status()) == (0, {"x": 0})
    controller.step([math.nan])
    assert (controller.status, controller.sensor_status()) == (1, {"x": 1})
    controller.reset()
    assert (controller.status, controller.sensor_status()) == (0, {"x": 0})


def test_predict_before_any_step_and_without_sensors():
    still = controller_of(program_of("policy still\naction u : [-1, 1] = 0.5"))
    actions, states = still.predict(np.array([]))
    assert actions.tolist() == [0.5] and len(states) == 1
    pole = controller_of(load_program("cartpole"))
    action, _ = pole.predict(np.zeros(4))
    assert action.dtype == np.int64 and action.shape == ()
    actions, _ = pole.predict(np.zeros((3, 4)))
    assert actions.dtype == np.int64 and actions.shape == (3,)


def test_predict_starts_afresh_for_another_number_of_environments():
    controller = controller_of(program_of(SUMMING))
    assert controller.predict(np.array([[1.0]]))[0].tolist() == [[3.0]]
    assert controller.predict(np.array([[2.0], [5.0]]))[0].tolist() == [[6.0], [15.0]]
    assert controller.predict(np.array([[2.0], [5.0]]))[0].tolist() == [[6.0], [15.0]]
    assert controller.predict(np.array([[3.0], [6.0]]))[0].tolist() == [[7.0], [16.0]]


def test_parameters_of_a_binary32_controller_are_rounded():
    program = program_of(
        "policy scaled\nsensor x : [0, 1] = 0\nparam k = 1\naction u : [0, 9] = k * peek(x, -1)"
    )
    controller = python_controller(program, "float").with_params({"k": 0.1}).controller
    assert controller.params == {"k": 0.10000000149011612}
    assert controller.step([1.0]) == (0.10000000149011612,)
    assert controller_of(program, k=0.1).step([1.0]) == (0.1,)


def test_the_state_holds_what_a_step_needs_and_no_more():
    assert controller_of(program_of(SUMMING))._state == ((50.0,) * 3, False)
    still = controller_of(program_of("policy still\naction u : [-1, 1] = 0.5"))
    still.step([])
    assert not hasattr(still, "_state") or still._state == ()
    counting = SUMMING.replace("= 0\n", "= 0 missing hold 3 then fail\n").replace(
        "0, 1000]", "0, 1000] safe 0"
    )
    controller = controller_of(program_of(counting))
    assert controller._state == ((50.0,) * 3, False, 0)
    controller.step([math.nan])
    assert controller._state == ((50.0,) * 3, False, 1)
    controller.step([2.0])
    assert controller._state == ((2.0,) * 3, True, 0)
