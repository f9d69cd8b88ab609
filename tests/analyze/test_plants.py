from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.classic_control import PendulumEnv

from pirlc.analyze.findings import Origin
from pirlc.analyze.plants import problems
from pirlc.analyze.plants.differences import differences
from pirlc.analyze.plants.equations import OperatingPoint, known_equations
from pirlc.analyze.plants.find import find_plant
from pirlc.analyze.plants.linear import jacobians
from pirlc.analyze.plants.states import resettable
from pirlc.ir.evidence import Kind
from pirlc.ir.policy import Environment
from pirlc.resources import explanations
from pirlc.simulation.environments import make
from tests.support.plants import PENDULUM, SPRING, Spring, program, register_spring
from tests.support.refusals import refused

pytestmark = pytest.mark.filterwarnings("ignore:.*already returned terminated.*")

SINGLE = 1e-7
"""What binary32 states and observations of order 1 are good for."""

KNOWN = [
    (Environment("CartPole-v1"), 1.0, 1e-12),
    (Environment("Pendulum-v1"), 3.0, 1e-12),
    (Environment("Pendulum-v1", (("g", 3.7),)), 3.0, 1e-12),
    (Environment("Acrobot-v1"), 1.5, 1e-9),
    (Environment("MountainCar-v0"), 1.0, 1e-12),
    (Environment("MountainCarContinuous-v0"), 1.0, SINGLE),
]


@pytest.fixture(autouse=True)
def _spring() -> None:
    register_spring()


def drawn_state(name: str, spread: float, generator: np.random.Generator) -> np.ndarray:
    if name.startswith("MountainCar"):
        return np.array([generator.uniform(-1.25, 0.6), generator.uniform(-0.07, 0.07)])
    return generator.uniform(-spread, spread, 2 if name.startswith("Pendulum") else 4)


@pytest.mark.parametrize(("environment", "spread", "tolerance"), KNOWN)
def test_equations_step_as_gymnasium_does(
    environment: Environment, spread: float, tolerance: float
) -> None:
    equations = known_equations(environment)
    assert equations is not None
    system = resettable(make(environment), environment.id)
    space: Any = system.simulator.action_space
    generator = np.random.default_rng(7)
    for _ in range(200):
        state = drawn_state(environment.id, spread, generator)
        if isinstance(space, gym.spaces.Discrete):
            action = np.array([float(generator.integers(space.n))])
        else:
            # A torque whose multiples binary32 holds exactly, also outside the range.
            action = np.array([generator.integers(-160, 160) / 64.0])
        if environment.id == "MountainCarContinuous-v0":
            state = state.astype(np.float32).astype(np.float64)
        after, observation = system.advance(state, action)
        predicted = np.array(equations.step(state, action)[0]).reshape(-1)
        turns = [name in equations.angles for name in equations.states]
        gap = after - predicted
        gap[turns] = np.remainder(gap[turns] + np.pi, 2 * np.pi) - np.pi
        assert np.max(np.abs(gap)) < tolerance, (state, action)
        readings = np.array(equations.step(after, action)[1]).reshape(-1)
        assert np.allclose(observation, readings.astype(np.float32), rtol=2e-7, atol=SINGLE)


@pytest.mark.parametrize(("environment", "spread", "tolerance"), KNOWN)
def test_operating_points_are_equilibria(
    environment: Environment, spread: float, tolerance: float
) -> None:
    equations = known_equations(environment)
    assert equations is not None
    for point in equations.points:
        after = np.array(equations.step(point.state, point.action)[0]).reshape(-1)
        assert np.allclose(after, point.state, rtol=0.0, atol=1e-14), point


@pytest.mark.parametrize(("environment", "spread", "tolerance"), KNOWN)
def test_derivatives_agree_with_differences_of_the_simulator(
    environment: Environment, spread: float, tolerance: float
) -> None:
    equations = known_equations(environment)
    assert equations is not None
    system = resettable(make(environment), environment.id)
    single = environment.id == "MountainCarContinuous-v0"
    # The line through discrete actions is not quite the tangent.
    secant = 1e-4 if environment.id == "Acrobot-v1" else 1e-7
    for point in equations.points:
        exact, measured = jacobians(equations, point), differences(system, point)
        # Observations are binary32 everywhere, one environment's state is so too.
        assert np.allclose(exact.a, measured.a, rtol=0.0, atol=2e-5 if single else 1e-7)
        assert np.allclose(exact.b, measured.b, rtol=0.0, atol=2e-5 if single else secant)
        assert np.allclose(exact.c, measured.c, rtol=0.0, atol=5e-5)


def test_arguments_that_change_the_equations_are_not_ignored() -> None:
    assert known_equations(Environment("CartPole-v1", (("sutton_barto_reward", True),)))
    assert known_equations(Environment("CartPole-v1", (("gravity", 3),))) is None
    assert known_equations(Environment("Pendulum-v1", (("g", math.inf),))) is None
    assert known_equations(Environment("LunarLander-v3")) is None


def test_the_pendulum_is_linearised_upright() -> None:
    policy = program(PENDULUM)
    plant = find_plant(policy, Environment("Pendulum-v1"))
    # By hand: 3 g / (2 l) = 15, 3 / (m l^2) = 3, 0.05 s a step, the angle by the new speed.
    assert plant.origin is Origin.EQUATIONS
    assert np.allclose(plant.a, [[1.0 + 0.05 * 0.75, 0.05], [0.75, 1.0]], rtol=0, atol=1e-15)
    assert np.allclose(plant.b, [[0.0075], [0.15]], rtol=0, atol=1e-15)
    # Height is read by a guard alone.
    assert (plant.inputs, plant.outputs) == (("Torque",), ("Side", "Speed"))
    assert plant.c == ((1.0, 0.0), (0.0, 1.0))
    assert plant.d == ((0.0,), (0.0,))
    assert plant.sample_time == 0.05
    assert plant.operating["Side"] == plant.operating["Torque"] == 0.0
    assert plant.evidence.kind is Kind.TESTED
    assert "linearised at upright (also known: hanging)" in plant.notes[0]


def test_the_hanging_pendulum_turns_the_other_way() -> None:
    plant = find_plant(program(PENDULUM), Environment("Pendulum-v1"), operating_point="hanging")
    assert np.allclose(plant.a[1], [-0.75, 1.0])
    assert np.allclose(plant.c, [[-1.0, 0.0], [0.0, 1.0]])
    assert np.max(np.abs(np.linalg.eigvals(np.array(plant.a)))) == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["Spring-v0", "Slide-v0"])
def test_a_simulator_that_can_be_put_into_a_state_needs_no_equations(name: str) -> None:
    plant = find_plant(program(SPRING), Environment(name))
    assert plant.origin is Origin.SIMULATOR
    assert np.allclose(plant.a, Spring.A, rtol=0, atol=1e-10)
    assert np.allclose(plant.b, Spring.B, rtol=0, atol=1e-10)
    assert np.allclose(plant.c, [[1.0, 0.0]], rtol=0, atol=1e-9)
    assert (plant.outputs, plant.sample_time) == (("Place",), 0.1)
    assert plant.notes[-1].startswith(f"no equations are known for the environment `{name}`")


def test_differences_are_taken_where_the_program_leads() -> None:
    plant = find_plant(program(PENDULUM), Environment("Pendulum-v1"), Origin.SIMULATOR)
    assert math.cos(plant.operating["state 0"]) == pytest.approx(1.0)
    exact = find_plant(program(PENDULUM), Environment("Pendulum-v1"))
    assert np.allclose(plant.a, exact.a, rtol=0, atol=1e-8)
    assert np.allclose(plant.c, exact.c, rtol=0, atol=1e-5)


def test_a_state_of_the_users_own() -> None:
    point = OperatingPoint("tilted", (math.pi / 2, 0.0), (0.0,))
    plant = find_plant(program(PENDULUM), Environment("Pendulum-v1"), operating_point=point)
    # At a right angle the sine has no slope: gravity neither helps nor hinders.
    assert np.allclose(plant.a, [[1.0, 0.05], [0.0, 1.0]])
    assert plant.notes[1] == (
        "tilted is no equilibrium: a step changes the state by up to 0.75, so the linear model is "
        "of the changes about a trajectory, and of its first step only"
    )


class Heavy(PendulumEnv):
    """Not the pendulum of that name."""

    def __init__(self, render_mode: str | None = None, g: float = 10.0) -> None:
        super().__init__(render_mode, g)
        self.m = 0.8


def test_equations_are_not_believed_of_an_environment_that_steps_otherwise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    spec = gym.envs.registration.EnvSpec("Pendulum-v1", Heavy, max_episode_steps=200)
    monkeypatch.setitem(gym.registry, "Pendulum-v1", spec)
    policy = program(PENDULUM)
    message = refused(lambda: find_plant(policy, Environment("Pendulum-v1"), Origin.EQUATIONS))
    assert message == (
        "error[E0931]: no equations are known for the environment `Pendulum-v1` with its "
        "arguments\n"
        "  = help: find the plant by differences in the simulator, or identify it from rollouts"
    )
    plant = find_plant(policy, Environment("Pendulum-v1"))
    assert plant.origin is Origin.SIMULATOR
    assert np.allclose(plant.b, [[0.009375], [0.1875]], rtol=0, atol=1e-8)


def test_unknown_operating_points() -> None:
    message = refused(
        lambda: find_plant(program(PENDULUM), Environment("Pendulum-v1"), operating_point="top")
    )
    assert message == (
        "error[E0930]: `Pendulum-v1` has no operating point called `top`\n"
        "  = help: it has `upright`, `hanging`"
    )
    message = refused(
        lambda: find_plant(
            program(SPRING), Environment("Spring-v0"), Origin.SIMULATOR, operating_point="top"
        )
    )
    assert message == (
        "error[E0930]: `Spring-v0` has no operating point called `top`\n"
        "  = help: only environments with known equations have named operating points; others are "
        "taken where the program leads them"
    )


@pytest.mark.parametrize(
    ("memory", "reason"),
    [
        ("hidden", "it has neither a vector `state` nor MuJoCo's `set_state`"),
        ("sealed", "stepping from a state that was set raised RuntimeError: the case is sealed"),
        ("action", "the same step from the same state does not always end alike"),
    ],
)
def test_environments_that_cannot_be_put_into_a_state(memory: str, reason: str) -> None:
    environment = Environment("Spring-v0", (("memory", memory),))
    message = refused(lambda: find_plant(program(SPRING), environment, Origin.SIMULATOR))
    assert message == (
        "error[E0932]: the environment `Spring-v0` cannot be put into a chosen state\n"
        f"  = note: {reason}\n"
        "  = help: identify the plant from rollouts"
    )
    plant = find_plant(program(SPRING), environment)
    assert plant.origin is Origin.IDENTIFIED
    assert reason in plant.notes[-1]


def test_a_simulator_that_never_rests() -> None:
    environment = Environment("Spring-v0", (("downhill", True),))
    message = refused(lambda: find_plant(program(SPRING), environment, Origin.SIMULATOR))
    assert re.fullmatch(
        r"error\[E0933\]: no equilibrium of `Spring-v0` was found where the program leads it\n"
        r"  = note: nearest to rest, a step still changes the state by [0-9.]+\n"
        r"  = help: identify the plant from rollouts",
        message,
    )


def test_rollouts_that_are_too_short() -> None:
    environment = Environment("Pendulum-v1", (("max_episode_steps", 40),))
    message = refused(lambda: find_plant(program(PENDULUM), environment, Origin.IDENTIFIED))
    assert message == (
        "error[E0934]: the rollouts in `Pendulum-v1` have 0 usable steps, too few to identify a "
        "plant\n"
        "  = note: at least 200 are needed\n"
        "  = help: roll out more or longer episodes; does the program survive its first steps?"
    )


def test_what_does_not_move_cannot_be_identified() -> None:
    still = program(SPRING.replace("= 1\n", "= 2\n"))
    message = refused(lambda: find_plant(still, Environment("Spring-v0"), Origin.IDENTIFIED))
    assert message == (
        "error[E0935]: sensor `Place` did not change in the rollouts in `Spring-v0`\n"
        "  = note: nothing can be identified from what stands still\n"
        "  = help: a larger dither, or an operating point at which the action is not saturated"
    )


def test_a_program_without_feedback() -> None:
    blind = program(SPRING.replace("-0.4 * peek(Place, -1)", "0.25"))
    message = refused(lambda: find_plant(blind, Environment("Spring-v0")))
    assert message == (
        "error[E0936]: the actions of policy `spring` read no sensor\n"
        "  = note: without feedback there is no loop to analyse"
    )


def test_environments_that_run_code_of_their_own_need_trust() -> None:
    message = refused(lambda: find_plant(program(SPRING), Environment("somewhere:Spring-v0")))
    assert message.startswith("error[E0502]")


def test_programs_that_do_not_fit_their_environment() -> None:
    misfit = program(SPRING.replace("= 1", "= 7"))
    message = refused(lambda: find_plant(misfit, Environment("Spring-v0")))
    assert message.startswith("error[E0507]")


def test_discrete_actions_have_a_plant_too() -> None:
    text = """policy cart
environment "CartPole-v1"
sensor Angle : [-0.2, 0.2] = 2
sensor Turning : [-3, 3] = 3
action Push : {0, 1} = if 3 * peek(Angle, -1) + peek(Turning, -1) > 0 then 1 else 0
"""
    plant = find_plant(program(text), Environment("CartPole-v1"))
    assert (plant.inputs, plant.outputs) == (("Push",), ("Angle", "Turning"))
    # 20 newtons between the two pushes; half of them at the operating point.
    assert plant.operating["Push"] == 0.5
    assert plant.b[1][0] == pytest.approx(20 * 0.02 * (1 + 0.05 / 1.1 * 1.5 / 1.1) / 1.1, rel=0.05)


def test_every_code_has_a_page() -> None:
    codes = re.findall(r'"(E093\d)"', Path(problems.__file__).read_text(encoding="utf-8"))
    assert sorted(codes) == [f"E093{i}" for i in range(7)]
    for code in codes:
        page = (explanations() / f"{code}.md").read_text(encoding="utf-8")
        assert page.startswith(f"# {code}: ")
        assert "## What to do" in page
