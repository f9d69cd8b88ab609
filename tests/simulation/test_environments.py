from __future__ import annotations

import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from pirlc.diagnostics import PirlcError, Severity, render
from pirlc.ir.policy import ActionSpec, Choice, Continuous, Environment, Interface, Sensor
from pirlc.simulation.environments import (
    BoxActions,
    DiscreteActions,
    check_interface,
    facts,
    make,
    require_environment,
)
from pirlc.source import SourceText, Span


@pytest.fixture(autouse=True)
def _here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    import broken_environments  # noqa: F401


def message(environment: Environment, trust: bool = False) -> str:
    with pytest.raises(PirlcError) as caught:
        facts(environment, trust)
    return render(caught.value.diagnostics[0])


def test_facts_of_the_classic_environments() -> None:
    cartpole = facts(Environment("CartPole-v1"))
    assert cartpole.observation_size == 4
    assert cartpole.actions == DiscreteActions(2, 0)
    assert (cartpole.max_episode_steps, cartpole.sample_time) == (500, 0.02)
    assert cartpole.observation_upper[0] == float(np.float32(4.8))
    pendulum = facts(Environment("Pendulum-v1"))
    assert pendulum.actions == BoxActions((-2.0,), (2.0,), "float32")
    assert (pendulum.components, pendulum.sample_time) == (1, 0.05)
    assert facts(Environment("Acrobot-v1")).sample_time == 0.2
    assert facts(Environment("MountainCar-v0")).sample_time is None


def test_arguments_reach_the_environment() -> None:
    made = make(Environment("Pendulum-v1", (("g", 3.5), ("max_episode_steps", 7))))
    assert made.unwrapped.g == 3.5  # type: ignore[attr-defined]
    assert made.spec is not None
    assert made.spec.max_episode_steps == 7


def test_module_ids_are_imported_only_with_trust() -> None:
    sys.modules.pop("broken_environments")
    for name in ("Broken-v0", "Images-v0", "ManyChoices-v0", "WrappedCartPole-v0"):
        gym.registry.pop(name)
    assert message(Environment("broken_environments:Broken-v0")) == (
        "error[E0502]: the environment `broken_environments:Broken-v0` runs code from a module of "
        "its own\n  = help: if you trust where it comes from, add `--trust`"
    )
    assert "broken_environments" not in sys.modules
    trusted = facts(Environment("broken_environments:Broken-v0"), trust=True)
    assert trusted.actions == DiscreteActions(3, -1)
    assert message(Environment("no_such_module:X-v0"), trust=True) == (
        "error[E0504]: the environment `no_such_module:X-v0` cannot be made\n"
        "  = note: the environment says: ModuleNotFoundError: No module named 'no_such_module'"
    )
    assert "E0502" in message(Environment("GymV26Environment-v0", (("env_id", "os:X-v0"),)))


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        (
            Environment("Cartpole-v1"),
            "error[E0501]: no environment is called `Cartpole-v1`\n"
            "  = help: did you mean `CartPole-v1`?",
        ),
        (
            Environment('x; system("rm")'),
            'error[E0501]: no environment is called `x; system("rm")`\n'
            "  = help: an environment is named by its Gymnasium id, such as `CartPole-v1`",
        ),
        (
            Environment("Pendulum-v1", (("gravity", 9.81),)),
            "error[E0503]: the environment `Pendulum-v1` does not take these arguments: `gravity`\n"
            "  = note: the environment says: TypeError: PendulumEnv.__init__() got an unexpected "
            "keyword argument 'gravity'",
        ),
        (
            Environment("CartPole-v1", (("id", "Pendulum-v1"),)),
            "error[E0503]: the environment `CartPole-v1` does not take these arguments: `id`\n"
            "  = note: the environment says: these names are Gymnasium's own",
        ),
        (
            Environment("Blackjack-v1"),
            "error[E0505]: the observations of `Blackjack-v1` are not a vector of real numbers\n"
            "  = note: its observation space is Tuple(Discrete(32), Discrete(11), Discrete(2))\n"
            "  = help: sensors need a one-dimensional `Box`; wrap the environment to flatten it",
        ),
        (
            Environment("ManyChoices-v0"),
            "error[E0506]: the actions of `ManyChoices-v0` are neither one discrete choice nor a "
            "vector of reals\n  = note: its action space is MultiDiscrete([2 3])\n"
            "  = help: actions need a `Discrete` space or a one-dimensional `Box` of floats",
        ),
    ],
)
def test_messages(environment: Environment, expected: str) -> None:
    assert message(environment) == expected


def test_images_are_not_sensors_and_versions_are_suggested() -> None:
    assert "E0505" in message(Environment("Images-v0"))
    assert "did you mean `CartPole-v" in message(Environment("CartPole-v7"))
    assert "E0504" in message(Environment("GymV21Environment-v0"), trust=True)


SOURCE = SourceText(
    "car.pirl",
    'environment "MountainCar-v0"\n'
    "sensor speed : [-1, 1] = 2\n"
    "action Push : {-1, 0} = 0\n"
    "action More : [0, 1] = 1\n",
)


def span(text: str) -> Span:
    start = SOURCE.text.index(text)
    return Span(start, start + len(text))


def interface(
    environment: str, sensors: tuple[Sensor, ...], *actions: ActionSpec, sample: float | None = None
) -> Interface:
    where = Environment(environment, (), span('"MountainCar-v0"'))
    return Interface("car", where, sensors, actions, sample_time=sample)


def shown(given: Interface, source: SourceText | None = None) -> list[str]:
    assert given.environment is not None
    found = check_interface(given, facts(given.environment), source)
    return [render(diagnostic) for diagnostic in found]


def test_a_fitting_interface_has_no_diagnostics() -> None:
    push = ActionSpec("Push", Choice((0, 2)), 0)
    speed = Sensor("speed", -1.0, 1.0, 1)
    assert shown(interface("MountainCar-v0", (speed,), push)) == []


def test_misfits_point_into_the_source() -> None:
    speed = Sensor("speed", -1.0, 1.0, 2, span=span("sensor speed : [-1, 1] = 2"))
    push = ActionSpec("Push", Choice((-1, 0)), 0, span("action Push : {-1, 0} = 0"))
    more = ActionSpec("More", Continuous(0, 1), 1, span("action More : [0, 1] = 1"))
    assert shown(interface("MountainCar-v0", (speed,), push, more), SOURCE) == [
        "error[E0507]: sensor `speed` reads component 2, but the observations of `MountainCar-v0` "
        "have 2 components\n"
        " --> car.pirl:2:1\n  |\n2 | sensor speed : [-1, 1] = 2\n"
        "  | ^^^^^^^^^^^^^^^^^^^^^^^^^^\n  |\n"
        "  = help: its indices run from 0 to 1",
        "error[E0510]: action `Push` may take the value -1, which `MountainCar-v0` does not have\n"
        " --> car.pirl:3:1\n  |\n3 | action Push : {-1, 0} = 0\n"
        "  | ^^^^^^^^^^^^^^^^^^^^^^^^^\n  |\n"
        "  = help: its values run from 0 to 2",
        "error[E0508]: action `More` drives component 1, but the actions of `MountainCar-v0` have "
        "1 component\n"
        " --> car.pirl:4:1\n  |\n4 | action More : [0, 1] = 1\n  | ^^^^^^^^^^^^^^^^^^^^^^^^\n  |\n"
        "  = help: leave the number out, or give each action a component of its own",
    ]


def test_kinds_components_and_ranges() -> None:
    reading = (Sensor("x", -1.0, 1.0, 0),)
    discrete, wide = ActionSpec("A", Choice((0,)), 0), ActionSpec("A", Continuous(-5, 5), 0)
    assert shown(interface("Pendulum-v1", reading, discrete)) == [
        "error[E0509]: action `A` is discrete, but the actions of `Pendulum-v1` are real numbers\n"
        "  = note: its action space is a box of 1 x float32\n"
        "  = help: write a range in brackets, as in `[-1, 1]`"
    ]
    assert shown(interface("CartPole-v1", reading, wide)) == [
        "error[E0509]: action `A` is continuous, but the actions of `CartPole-v1` are a discrete "
        "choice\n  = note: its action space is the values 0 to 1\n"
        "  = help: write the values in braces, as in `{0, 1}`"
    ]
    assert shown(interface("Pendulum-v1", reading, wide)) == [
        "warning[E0511]: the range [-5, 5] of action `A` is wider than that of `Pendulum-v1`, "
        "[-2, 2]\n  = note: what the environment does with a value outside its range is its own "
        "affair"
    ]
    twice = (ActionSpec("A", Continuous(-2, 2), 0), ActionSpec("B", Continuous(-2, 2), 0))
    assert shown(interface("Pendulum-v1", reading, *twice)) == [
        "error[E0508]: actions `A` and `B` both drive component 0"
    ]
    assert shown(interface("CartPole-v1", reading, ActionSpec("A", Choice((0,)), 1)))[1] == (
        "error[E0508]: no action drives component 0 of `CartPole-v1`\n"
        "  = note: the actions of `CartPole-v1` have 1 component\n  = help: add an action for it"
    )


def test_sample_times_are_compared() -> None:
    reading, push = (Sensor("x", -1.0, 1.0, 0),), ActionSpec("A", Choice((0, 1)), 0)
    assert shown(interface("CartPole-v1", reading, push, sample=0.02)) == []
    assert shown(interface("CartPole-v1", reading, push, sample=0.1)) == [
        "warning[E0512]: the sample time is 0.1 s here, but `CartPole-v1` steps by 0.02 s\n"
        "  = help: leave `sample_time` out to take the environment's"
    ]
    found = check_interface(
        interface("CartPole-v1", reading, push, sample=0.1), facts(Environment("CartPole-v1"))
    )
    assert [one.severity for one in found] == [Severity.WARNING]


def test_a_file_without_an_environment() -> None:
    with pytest.raises(PirlcError) as caught:
        require_environment(Interface("mine", None, (), ()))
    assert render(caught.value.diagnostics[0]) == (
        "error[E0513]: policy `mine` names no environment to simulate it in\n"
        '  = help: add a line such as `environment "CartPole-v1"`'
    )
