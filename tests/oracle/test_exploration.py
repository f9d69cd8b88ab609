"""What learners of continuous actions see, do at first, and try."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

from pirlc.diagnostics import PirlcError, render
from pirlc.ir.policy import Environment
from pirlc.oracle.adapted import Adapted, reach_of, scaling_of
from pirlc.oracle.exploration import Wandering
from pirlc.oracle.manifest import Json, from_json, to_json
from pirlc.oracle.network import Bounded
from pirlc.oracle.settings import default_settings, settings_as_json
from pirlc.oracle.store import load_stored, save_oracle
from pirlc.oracle.train import plan, train
from pirlc.oracle.training import Training
from pirlc.simulation.environments import BoxActions, EnvironmentFacts, facts, make

PENDULUM, CARTPOLE = Environment("Pendulum-v1"), Environment("CartPole-v1")


class Counter(gym.Env[Any, Any]):
    """Step n of seven is worth n; the readings are the last action and n."""

    def __init__(self) -> None:
        self.observation_space = spaces.Box(-np.inf, np.inf, (2,), np.float64)
        self.action_space = spaces.Box(0.0, 1.0, (1,), np.float64)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        self.n = 0
        return np.zeros(2), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        assert 0.0 <= action[0] <= 1.0
        self.n += 1
        return np.array([action[0], self.n]), float(self.n), self.n == 7, False, {}


gym.register("Counter-v0", entry_point=Counter)
COUNTER = Environment("Counter-v0")


def planned(environment: Environment, algorithm: str, **overrides: Json) -> Training:
    return plan(environment, facts(environment), algorithm=algorithm, overrides=overrides)


def refused(environment: Environment, **overrides: Json) -> str:
    with pytest.raises(PirlcError) as caught:
        train(planned(environment, "sac", steps=60, **overrides))
    return render(caught.value.diagnostics[0])


def test_actions_are_repeated_and_rewards_scaled_up_to_the_end() -> None:
    training = planned(
        COUNTER, "sac", repeat=3, reward_scale=0.5, centre=[0.25, 1.0], spread=[0.5, 2.0],
        least=[-1.0], most=[3.0],
    )  # fmt: skip
    seen = Adapted(make(COUNTER), scaling_of(training), training)
    assert seen.action_space == spaces.Box(-1.0, 3.0, (1,), np.float32)
    observation, _ = seen.reset(seed=0)
    np.testing.assert_array_equal(observation, np.array([-0.5, -0.5], np.float32))
    observation, reward, ended, _, _ = seen.step(np.array([2.0], np.float32))
    # The action is clipped to 1.
    np.testing.assert_array_equal(observation, np.array([1.5, 1.0], np.float32))
    assert (reward, ended) == (0.5 * (1 + 2 + 3), False)
    assert seen.step(np.array([-1.0]))[1:3] == (0.5 * (4 + 5 + 6), False)
    assert seen.step(np.array([0.5]))[1:3] == (0.5 * 7, True)


def test_by_default_nothing_is_repeated_scaled_or_widened() -> None:
    training = planned(PENDULUM, "sac")
    assert reach_of(training) is None
    data = settings_as_json(training.settings)
    assert not {"episodes", "repeat", "reward_scale", "centre", "least"} & data.keys()


def test_the_noise_wanders_with_the_standard_deviation_that_was_asked_for() -> None:
    noise = Wandering(np.array([0.5, 0.1]), 0.15, 0, np.random.default_rng(0))
    drawn = np.array([noise() for _ in range(40_000)])
    np.testing.assert_allclose(drawn.std(axis=0), [0.5, 0.1], rtol=0.1)
    following = np.corrcoef(drawn[1:, 0], drawn[:-1, 0])[0, 1]
    assert following == pytest.approx(0.85, abs=0.02)
    white = Wandering(np.array([1.0]), 1.0, 0, np.random.default_rng(0))
    drawn = np.array([white() for _ in range(20_000)])
    assert abs(np.corrcoef(drawn[1:, 0], drawn[:-1, 0])[0, 1]) < 0.03


def test_noise_fades_to_a_tenth() -> None:
    noise = Wandering(np.array([1.0]), 1.0, 1_000, np.random.default_rng(0))
    drawn = np.array([noise()[0] for _ in range(6_000)])
    assert drawn[:100].std() == pytest.approx(0.95, rel=0.2)
    assert drawn[1_000:].std() == pytest.approx(0.1, rel=0.05)


def test_copies_of_the_noise_are_independent() -> None:
    noise = Wandering(np.array([1.0]), 1.0, 0, np.random.default_rng(0))
    one, other = copy.deepcopy(noise), copy.deepcopy(noise)
    assert one() != other()


@pytest.mark.parametrize("algorithm", ["sac", "td3", "ddpg"])
def test_an_untrained_network_acts_around_its_bias(algorithm: str) -> None:
    from stable_baselines3.common.vec_env import DummyVecEnv

    from pirlc.oracle.attempt import _learner
    from pirlc.oracle.export import export

    training = planned(PENDULUM, algorithm, bias=[2.0], least=[-4.0], most=[2.0], noise=0.1)
    simulator = Adapted(make(PENDULUM), scaling_of(training), training)
    learner = _learner(training, DummyVecEnv([lambda: simulator]), 5)
    learner.policy.set_training_mode(False)
    x = np.random.default_rng(3).normal(size=(50, 3)).astype(np.float32)
    oracle = export(learner.policy, training.facts.actions, scaling_of(training))
    assert oracle.head == Bounded((-2.0,), (2.0,), True, ((-4.0,), (2.0,)))
    expected = np.clip(learner.predict(scaled(training, x), deterministic=True)[0], -2.0, 2.0)
    got = oracle.actions(x.astype(np.float64))
    np.testing.assert_allclose(got, expected, atol=1e-5)
    # -4 + (tanh(2) + 1) / 2 * 6, and a little of the network's own.
    assert np.abs(got - 1.892).max() < 0.3


def scaled(training: Training, x: Any) -> Any:
    scaling = scaling_of(training)
    return (x - scaling.offset) / scaling.scale


def test_with_a_bias_the_network_acts_from_the_first_step() -> None:
    from pirlc.oracle.exploration import acting_from_the_start

    class Learner:
        def _sample_action(self, learning_starts: int, noise: Any, copies: int) -> Any:
            return learning_starts, noise, copies

    assert acting_from_the_start(Learner)()._sample_action(500, "noise", 2) == (0, "noise", 2)


def test_wider_actions_are_kept_in_the_manifest(tmp_path: Path) -> None:
    training = planned(
        PENDULUM, "sac", steps=60, learning_starts=30, episodes=1, least=[-3.0], bias=1.0
    )
    oracle, manifest = train(training)
    assert manifest.score.episodes == 1
    assert oracle.head == Bounded((-2.0,), (2.0,), True, ((-3.0,), (2.0,)))
    assert from_json(json.loads(json.dumps(to_json(manifest)))).head == oracle.head
    loaded = load_stored(save_oracle(oracle, manifest, tmp_path / "o").folder).oracle
    x = np.random.default_rng(0).normal(size=(20, 3))
    np.testing.assert_array_equal(loaded.actions(x), oracle.actions(x))
    assert (np.abs(loaded.actions(x)) <= 2.0).all()


def test_messages() -> None:
    assert refused(PENDULUM, centre=[1.0, 2.0]) == (
        "error[E0613]: `sac` does not accept the hyperparameter `centre`\n"
        "  = note: it has 2 numbers, and Pendulum-v1 3 readings"
    )
    assert refused(PENDULUM, spread=[1.0, 0.0, 1.0]) == (
        "error[E0613]: `sac` does not accept the hyperparameter `spread`\n"
        "  = note: its numbers must be above 0"
    )
    assert refused(PENDULUM, centre="middle") == (
        "error[E0613]: `sac` does not accept the hyperparameter `centre`\n"
        "  = note: it must be a list of numbers, not 'middle'"
    )
    assert refused(PENDULUM, least=[-1.0]) == (
        "error[E0613]: `sac` does not accept the hyperparameter `least`\n"
        "  = note: the range must hold the environment's"
    )
    assert refused(PENDULUM, most=[3.0, 3.0]) == (
        "error[E0613]: `sac` does not accept the hyperparameter `most`\n"
        "  = note: it has 2 numbers, and an action 1 components"
    )
    assert refused(PENDULUM, bias=[1.0, 1.0]) == (
        "error[E0613]: `sac` does not accept the hyperparameter `bias`\n"
        "  = note: it has 2 numbers, and an action 1 components"
    )
    assert refused(PENDULUM, noise="much") == (
        "error[E0613]: `sac` does not accept the hyperparameter `noise`\n"
        "  = note: it must be a number or a list of them, not 'much'"
    )
    assert refused(PENDULUM, noise=0.1, drift=0) == (
        "error[E0613]: `sac` does not accept the hyperparameter `drift`\n"
        "  = note: it must be above 0 and at most 1, not 0"
    )
    assert refused(PENDULUM, reward_scale="much") == (
        "error[E0613]: `sac` does not accept the hyperparameter `reward_scale`\n"
        "  = note: it must be a number, not 'much'"
    )
    with pytest.raises(PirlcError) as caught:
        train(planned(CARTPOLE, "dqn", steps=60, least=[0.0]))
    assert render(caught.value.diagnostics[0]) == (
        "error[E0613]: `dqn` does not accept the hyperparameter `least`\n"
        "  = note: the environment's actions are discrete"
    )


@pytest.mark.parametrize("k", [2, 3])
@pytest.mark.parametrize("algorithm", ["sac", "ddpg"])
def test_rows_for_torcs_fit_with_and_without_the_brake(algorithm: str, k: int) -> None:
    lower, upper = (-1.0, 0.0, 0.0)[:k], (1.0,) * k
    infinite = (np.inf,) * 29
    torcs = EnvironmentFacts(
        "pirlc/Torcs-v0", tuple(-x for x in infinite), infinite, "float64",
        BoxActions(lower, upper, "float64"), 3_000, 0.02, None,
    )  # fmt: skip
    settings = default_settings(algorithm, torcs, {"reward": "progress"})
    # Speeds in km/h are larger than the metres of a step.
    speeds = default_settings(algorithm, torcs, {})
    assert speeds.reward_scale == settings.reward_scale / 200
    training = Training(Environment("pirlc/Torcs-v0"), torcs, algorithm, settings, 0)
    assert scaling_of(training).scale.shape == (29,)
    reach = reach_of(training)
    assert reach is None or reach.shape == (k,)
    bias = settings.learner["bias"]
    assert isinstance(bias, list)
    assert len(bias) == k
