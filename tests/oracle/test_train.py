from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

from pirlc.diagnostics import PirlcError, render
from pirlc.ir.policy import Environment
from pirlc.oracle.manifest import Json
from pirlc.oracle.settings import ALGORITHMS, default_algorithm
from pirlc.oracle.train import (
    RUN_OFF_SEEDS,
    SCORE_SEEDS,
    SELECTION_SEEDS,
    attempt_seed,
    cache_folder,
    cached,
    plan,
    train,
    train_or_load,
)
from pirlc.oracle.training import Progress, Training
from pirlc.simulation.environments import facts

CARTPOLE, PENDULUM = Environment("CartPole-v1"), Environment("Pendulum-v1")


class Bandit(gym.Env[Any, Any]):
    """Episodes of one step; action k is worth k times the only reading. Actions are -1, 0, 1."""

    def __init__(self) -> None:
        self.observation_space = spaces.Box(-1.0, 1.0, (1,), np.float64)
        self.action_space = spaces.Discrete(3, start=-1)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        self.reading = float(self.np_random.choice([-1.0, 1.0]))
        return np.array([self.reading]), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        assert action in (-1, 0, 1)
        return np.array([self.reading]), float(action * self.reading), True, False, {}


gym.register("Bandit-v0", entry_point=Bandit)
BANDIT = Environment("Bandit-v0")


def planned(
    environment: Environment, algorithm: str | None = None, seed: int = 0, **overrides: Json
) -> Training:
    given: Mapping[str, Json] = overrides
    return plan(environment, facts(environment), algorithm=algorithm, seed=seed, overrides=given)


SMALL: dict[str, dict[str, Json]] = {
    "ppo": {"steps": 512, "copies": 2, "n_steps": 64, "batch_size": 64},
    "dqn": {"steps": 300, "learning_starts": 100},
    "duel-ddqn": {"steps": 300, "learning_starts": 100},
    "td3": {"steps": 150, "learning_starts": 100, "max_episode_steps": 50},
    "sac": {"steps": 150, "learning_starts": 100},
    "ddpg": {"steps": 150, "learning_starts": 100},
}


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_networks_act_as_the_policies_that_they_were_made_from(algorithm: str) -> None:
    import torch
    from stable_baselines3.common.vec_env import DummyVecEnv

    from pirlc.oracle.adapted import Adapted, scaling_of
    from pirlc.oracle.attempt import _learner
    from pirlc.oracle.export import export
    from pirlc.simulation.environments import make

    for environment in (CARTPOLE, PENDULUM):
        try:
            training = planned(environment, algorithm)
        except PirlcError as error:
            assert error.diagnostics[0].code == "E0612"
            continue
        scaling = scaling_of(training)
        simulator = Adapted(make(environment), scaling, training)
        learner = _learner(training, DummyVecEnv([lambda: simulator]), 5)  # noqa: B023
        for parameter in learner.policy.parameters():
            # Larger than at the start, so that actions differ and saturate.
            parameter.data *= 1.5
        oracle = export(learner.policy, training.facts.actions, scaling)
        space = facts(environment).observation_size
        x = np.random.default_rng(3).normal(size=(400, space)).astype(np.float32)
        seen = (x - scaling.offset) / scaling.scale
        expected = learner.predict(seen, deterministic=True)[0].reshape(400, 1)
        got = oracle.actions(x.astype(np.float64))
        np.testing.assert_allclose(got, expected, atol=1e-5)
        assert len(np.unique(got)) > 1
        values = oracle.values(x.astype(np.float64))
        assert (values is not None) == (algorithm in ("dqn", "duel-ddqn"))
        if values is not None:
            with torch.no_grad():
                rated = learner.q_net(torch.from_numpy(seen)).numpy()
            np.testing.assert_allclose(values, rated, atol=1e-5, rtol=1e-5)


def test_dueling_double_dqn_learns_the_values_of_actions() -> None:
    training = planned(
        BANDIT, "duel-ddqn", steps=2_500, learning_starts=200, n_steps=1, evaluate_every=2_500
    )
    oracle, manifest = train(training)
    x = np.array([[-1.0], [1.0]])
    assert oracle.actions(x).tolist() == [[-1.0], [1.0]]
    values = oracle.values(x)
    assert values is not None
    np.testing.assert_allclose(values, [[1.0, 0.0, -1.0], [-1.0, 0.0, 1.0]], atol=0.1)
    assert manifest.score.mean == 1.0


def test_the_double_target_is_rated_by_the_target_network() -> None:
    import torch
    from stable_baselines3.common.vec_env import DummyVecEnv

    from pirlc.oracle.adapted import Adapted, scaling_of
    from pirlc.oracle.attempt import _learner
    from pirlc.simulation.environments import make

    training = planned(
        CARTPOLE, "duel-ddqn", n_steps=1, batch_size=32, learning_starts=64, gamma=0.5
    )
    environment = Adapted(make(CARTPOLE), scaling_of(training), training)
    learner = _learner(training, DummyVecEnv([lambda: environment]), 0)
    learner.learn(64)
    torch.manual_seed(1)
    for parameter in learner.q_net_target.parameters():
        parameter.data += 0.3 * torch.randn_like(parameter)
    batches = []
    sample = learner.replay_buffer.sample

    def watched(*arguments: Any, **named: Any) -> Any:
        batches.append(sample(*arguments, **named))
        return batches[-1]

    learner.replay_buffer.sample = watched
    before = [parameter.detach().clone() for parameter in learner.q_net.parameters()]
    learner.policy.optimizer = torch.optim.SGD(learner.policy.parameters(), lr=1e-3)
    learner.lr_schedule = lambda _: 1e-3
    learner.max_grad_norm = 1e9
    learner.train(1, 32)
    after = [parameter.detach().clone() for parameter in learner.q_net.parameters()]
    for parameter, old in zip(learner.q_net.parameters(), before, strict=True):
        parameter.data.copy_(old)
    (batch,) = batches
    rows = torch.arange(32)
    with torch.no_grad():
        online = learner.q_net(batch.next_observations)
        rated = learner.q_net_target(batch.next_observations)
        assert (online.argmax(1) != rated.argmax(1)).any()
        alive = 1 - batch.dones[:, 0]
        target = batch.rewards[:, 0] + alive * 0.5 * rated[rows, online.argmax(1)]
    learner.policy.optimizer.zero_grad()
    estimate = learner.q_net(batch.observations)[rows, batch.actions[:, 0]]
    torch.nn.functional.smooth_l1_loss(estimate, target).backward()
    for parameter, old, new in zip(learner.q_net.parameters(), before, after, strict=True):
        assert parameter.grad is not None
        torch.testing.assert_close(new, old - 1e-3 * parameter.grad)


def test_exploration_holds_its_actions() -> None:
    from stable_baselines3.common.vec_env import DummyVecEnv

    from pirlc.oracle.attempt import _learner

    lengths = {}
    for hold in (None, 1.5):
        training = planned(Environment("MountainCar-v0"), "duel-ddqn", hold=hold)
        learner = _learner(training, DummyVecEnv([lambda: gym.make("MountainCar-v0")]), 0)
        learner._setup_learn(10)
        drawn = [int(learner._sample_action(10**9, None, 1)[0][0]) for _ in range(3_000)]
        assert set(drawn) == {0, 1, 2}
        lengths[hold] = 3_000 / (1 + np.count_nonzero(np.diff(drawn)))
    assert 1.3 < lengths[None] < 1.7
    assert lengths[1.5] > 4


def test_a_second_training_is_loaded_at_once(tmp_path: Path) -> None:
    training = planned(CARTPOLE, "ppo", **SMALL["ppo"], attempts=1)
    told: list[Progress] = []
    first = train_or_load(training, tmp_path, told.append)
    assert first.folder == cache_folder(training, tmp_path)
    assert first.manifest.steps == 512
    assert first.manifest.score.episodes == 100
    assert first.manifest.environment == CARTPOLE
    assert first.manifest.versions["torch"]
    assert told[-1].fraction == 1.0
    told.clear()
    second = train_or_load(training, tmp_path, told.append)
    assert told == []
    assert second.manifest == first.manifest
    x = np.random.default_rng(0).normal(size=(20, 4))
    assert np.array_equal(second.oracle.actions(x), first.oracle.actions(x))
    again, manifest = train(training)
    assert np.array_equal(again.network.weights[0], first.oracle.network.weights[0])
    assert manifest.score == first.manifest.score


def test_the_cache_key_covers_all_that_matters(tmp_path: Path) -> None:
    base = planned(CARTPOLE, "ppo")
    others = [
        planned(CARTPOLE, "ppo", seed=1),
        planned(CARTPOLE, "dqn"),
        planned(CARTPOLE, "ppo", steps=70_000),
        planned(CARTPOLE, "ppo", gamma=0.97),
        planned(replace(CARTPOLE, arguments=(("max_episode_steps", 200),)), "ppo"),
    ]
    folders = {cache_folder(training, tmp_path) for training in (base, *others)}
    assert len(folders) == 6
    assert cache_folder(planned(CARTPOLE), tmp_path) == cache_folder(base, tmp_path)


def test_a_damaged_cache_is_trained_again(tmp_path: Path) -> None:
    training = planned(CARTPOLE, "ppo", **SMALL["ppo"], attempts=1)
    folder = train_or_load(training, tmp_path).folder
    (folder / "weights.safetensors").write_bytes(b"lost")
    assert cached(training, tmp_path) is None
    assert train_or_load(training, tmp_path).manifest.steps == 512
    assert cached(training, tmp_path) is not None


def test_an_interrupt_leaves_nothing(tmp_path: Path) -> None:
    def interrupt(progress: Progress) -> None:
        if progress.steps >= 500:
            raise KeyboardInterrupt

    training = planned(CARTPOLE, "ppo", copies=2, n_steps=64, batch_size=64)
    with pytest.raises(KeyboardInterrupt):
        train_or_load(training, tmp_path, interrupt)
    assert list(tmp_path.iterdir()) == []


def test_a_poor_attempt_is_followed_by_another() -> None:
    told: list[Progress] = []
    training = planned(
        BANDIT, "ppo", **{**SMALL["ppo"], "steps": 1_024}, attempts=2, acceptable=1.1
    )
    _, manifest = train(training, told.append)
    assert (manifest.attempts, manifest.steps) == (2, 2_048)
    assert [progress.attempt for progress in told] == [1] * 4 + [2] * 5
    assert [progress.steps for progress in told[::4]] == [250, 1_274, 2_048]
    fractions = [progress.fraction for progress in told]
    assert fractions == pytest.approx([0.25, 0.5, 0.75, 1.0] * 2 + [1.0], abs=0.03)
    easy = planned(BANDIT, "ppo", **SMALL["ppo"], attempts=2, acceptable=-1.0)
    assert train(easy)[1].attempts == 1


def test_training_stops_when_enough_is_reached() -> None:
    training = planned(
        BANDIT, "dqn", steps=20_000, learning_starts=200, enough=1.0, evaluate_every=500
    )
    assert train(training)[1].steps < 10_000


def test_seeds_stay_apart() -> None:
    seeds = {attempt_seed(seed, attempt) for seed in range(200) for attempt in range(3)}
    assert len(seeds) > 590
    assert all(400_000 <= seed < 499_000 for seed in seeds)
    judged = [*SELECTION_SEEDS, *SCORE_SEEDS, *RUN_OFF_SEEDS]
    assert len(set(judged)) == len(judged)
    assert 500_000 <= min(judged) <= max(judged) < 1_000_000


def test_default_algorithms() -> None:
    assert default_algorithm(facts(CARTPOLE)) == "ppo"
    assert default_algorithm(facts(Environment("MountainCar-v0"))) == "duel-ddqn"
    assert default_algorithm(facts(PENDULUM)) == "sac"
    assert default_algorithm(facts(Environment("MountainCarContinuous-v0"))) == "sac"
    assert default_algorithm(facts(BANDIT)) == "ppo"


def message(environment: Environment, algorithm: str, **overrides: Json) -> str:
    with pytest.raises(PirlcError) as caught:
        train(planned(environment, algorithm, **overrides))
    return render(caught.value.diagnostics[0])


def test_messages() -> None:
    assert message(CARTPOLE, "dueling-ddqn") == (
        "error[E0611]: no training algorithm is called `dueling-ddqn`\n"
        "  = note: there are ppo, dqn, duel-ddqn, td3, sac, ddpg\n"
        "  = help: did you mean `duel-ddqn`?"
    )
    assert message(PENDULUM, "dqn") == (
        "error[E0612]: `dqn` cannot learn the continuous actions of `Pendulum-v1`\n"
        "  = help: use `ppo` or `td3` or `sac` or `ddpg`"
    )
    assert message(CARTPOLE, "dqn", learning_rte=0.1) == (
        "error[E0613]: `dqn` does not accept the hyperparameter `learning_rte`\n"
        "  = note: Stable-Baselines3 has no argument of that name for it\n"
        "  = help: did you mean `learning_rate`?"
    )
    assert message(CARTPOLE, "dqn", steps=-5) == (
        "error[E0613]: `dqn` does not accept the hyperparameter `steps`\n"
        "  = note: it must be a count above 0, not -5"
    )
    assert message(CARTPOLE, "ppo", learning_rate="lin_fast") == (
        "error[E0613]: `ppo` does not accept the hyperparameter `learning_rate`\n"
        "  = note: 'lin_fast' is not of the form 'lin_0.001'"
    )
    assert message(CARTPOLE, "ppo", policy_kwargs={}).startswith("error[E0613]")


def test_numbers_that_run_away_are_told() -> None:
    text = message(BANDIT, "dqn", steps=2_000, learning_starts=100, learning_rate=1e30)
    assert text == (
        "error[E0614]: training an oracle for `Bandit-v0` with `dqn` failed\n"
        "  = note: ArithmeticError: the network's weights are no longer finite"
    )


@pytest.mark.slow
def test_cartpole_is_mastered(tmp_path: Path) -> None:
    stored = train_or_load(planned(CARTPOLE), tmp_path)
    assert stored.manifest.score.mean >= 495.0
