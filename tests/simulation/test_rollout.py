from __future__ import annotations

import math
import os
import signal
import time
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray

from pirlc.diagnostics import PirlcError, render
from pirlc.ir.policy import Environment
from pirlc.simulation.environments import make
from pirlc.simulation.policy import Ready
from pirlc.simulation.rollout import (
    ReturnEstimate,
    episode_return,
    estimate,
    run_episode,
    run_returns,
)
from pirlc.simulation.workers import (
    ALONE,
    Workers,
    collect_episodes,
    collect_returns,
    collect_returns_of_each,
    parallel_map,
)
from tests.support.processes import started

HERE = Path(__file__).parent


@pytest.fixture(autouse=True)
def _here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(HERE))
    import broken_environments  # noqa: F401


class Law:
    """Acts by a function of the observation and the number of steps taken."""

    def __init__(self, law: Any) -> None:
        self.law, self.step = law, 0

    def reset(self) -> None:
        self.step = 0

    def act(self, observation: NDArray[np.float64]) -> tuple[float, ...]:
        assert observation.dtype == np.float64
        self.step += 1
        return tuple(self.law(observation, self.step))


LAWS: dict[str, Any] = {
    "CartPole-v1": lambda o, t: (float(o[2] + 0.3 * o[3] > 0.02 * (t % 3)),),
    "MountainCar-v0": lambda o, _t: (2.0 if o[1] > 0 else 0.0,),
    "Acrobot-v1": lambda o, _t: (2.0 if o[4] > 0 else 0.0,),
    "Pendulum-v1": lambda o, t: (-1.5 * o[2] + 0.1 * (t % 5),),
    "WrappedCartPole-v0": lambda o, _t: (float(o[2] + 0.3 * o[3] > 0),),
}


@pytest.mark.parametrize("name", LAWS)
def test_episodes_equal_those_of_the_wrapped_environment(name: str) -> None:
    reference, policy = gym.make(name), Law(LAWS[name])
    for seed in (3, 11):
        observations, actions, rewards = [], [], []
        observation, _ = reference.reset(seed=seed)
        policy.reset()
        done = False
        while not done:
            action = policy.act(np.asarray(observation, dtype=np.float64))
            observations.append(np.asarray(observation, dtype=np.float64))
            actions.append(action)
            discrete = isinstance(reference.action_space, gym.spaces.Discrete)
            applied = int(action[0]) if discrete else np.array(action, np.float32)
            observation, reward, terminated, truncated, _ = reference.step(applied)
            rewards.append(float(reward))
            done = terminated or truncated
        episode = run_episode(make(Environment(name)), policy, seed)
        assert np.array_equal(episode.observations, observations)
        assert np.array_equal(episode.actions, actions)
        assert np.array_equal(episode.rewards, rewards)
        assert episode_return(episode) == math.fsum(rewards)


def test_wrappers_other_than_the_standard_ones_stay() -> None:
    simulator = make(Environment("WrappedCartPole-v0"))
    episode = run_episode(simulator, Law(LAWS["WrappedCartPole-v0"]), 0)
    assert episode.rewards.tolist() == [-2.0] * 30


def test_returns_do_not_depend_on_the_number_of_workers() -> None:
    seeds, environment = range(40, 53), Environment("Pendulum-v1", (("g", 9.0),))
    factory = Ready(Law(LAWS["Pendulum-v1"]))
    alone = collect_returns(factory, environment, seeds)
    assert alone.shape == (13,)
    assert np.array_equal(alone, collect_returns(factory, environment, seeds, workers=Workers(2)))
    assert np.array_equal(alone, run_returns(make(environment), factory(), seeds))
    several = collect_returns_of_each(
        [factory, Ready(Law(lambda _o, _t: (0.0,)))], environment, seeds, Workers(2)
    )
    assert np.array_equal(several[0], alone)
    assert several.shape == (2, 13)
    assert not np.array_equal(several[1], alone)
    episodes = collect_episodes(factory, environment, seeds, workers=Workers(2))
    assert [episode_return(episode) for episode in episodes] == alone.tolist()
    assert len(collect_returns(factory, environment, [])) == 0


def test_arguments_that_compare_equal_are_told_apart() -> None:
    # 1 == True in Python; the environments must not be taken for each other.
    factory = Ready(Law(LAWS["CartPole-v1"]))
    plain = collect_returns(factory, Environment("CartPole-v1"), [0])
    rewarded = Environment("CartPole-v1", (("sutton_barto_reward", True),))
    assert collect_returns(factory, rewarded, [0])[0] != plain[0]


def test_interval() -> None:
    # Student's t with 3 degrees of freedom: 3.182446.
    given = np.array([1.0, 2.0, 3.0, 4.0])
    got = estimate(given)
    half = 3.1824463052842 * np.std(given, ddof=1) / 2
    assert (got.mean, got.episodes) == (2.5, 4)
    assert got.low == pytest.approx(2.5 - half, rel=1e-9)
    assert got.high == pytest.approx(2.5 + half, rel=1e-9)
    assert estimate(np.array([5.0])) == ReturnEstimate(5.0, -math.inf, math.inf, 0.0, 1)


def broken(fault: str, length: int = 5) -> Environment:
    return Environment("broken_environments:Broken-v0", (("fault", fault), ("length", length)))


def failure_of(
    environment: Environment, law: Any = lambda _o, _t: (0.0,), workers: Workers = ALONE
) -> str:
    with pytest.raises(PirlcError) as caught:
        collect_returns(Ready(Law(law)), environment, [7, 8], workers, trust=True)
    return render(caught.value.diagnostics[0])


FAULTS = [
    (
        "raises",
        "error[E0514]: the environment `Broken-v0` failed in the episode of seed 7, at step 2\n"
        "  = note: its `step` raised ValueError: the belt slipped",
    ),
    (
        "reset raises",
        "error[E0514]: the environment `Broken-v0` failed in the episode of seed 7, at step 0\n"
        "  = note: its `reset` raised RuntimeError: the motor is off",
    ),
    (
        "nan reward",
        "error[E0515]: the environment `Broken-v0` gave a reward that is not a finite number in "
        "the episode of seed 7, at step 2\n  = note: the reward was nan",
    ),
    (
        "no reward",
        "error[E0515]: the environment `Broken-v0` gave a reward that is not a finite number in "
        "the episode of seed 7, at step 2\n  = note: the reward was None",
    ),
    (
        "wrong shape",
        "error[E0516]: the environment `Broken-v0` gave an observation of the wrong shape in the "
        "episode of seed 7, at step 3\n"
        "  = note: 2 components expected, got an array of shape (1,)",
    ),
    (
        "no observation",
        "error[E0516]: the environment `Broken-v0` gave an observation of the wrong shape in the "
        "episode of seed 7, at step 3\n"
        "  = note: 2 components expected, got a value of type NoneType",
    ),
]


@pytest.mark.parametrize(("fault", "expected"), FAULTS)
def test_failing_simulators(fault: str, expected: str) -> None:
    assert failure_of(broken(fault)) == expected


def test_failures_in_workers_are_told_as_well() -> None:
    assert failure_of(broken("raises"), workers=Workers(2)) == FAULTS[0][1]
    assert failure_of(broken("dies"), workers=Workers(2)).startswith(
        "error[E0519]: a worker process of the simulation died\n  = note: "
    )


def test_actions_that_do_not_exist() -> None:
    where = "in the episode of seed 7, at step 0"
    space = "the action space is Discrete(3, start=-1)"
    for action, shown in [
        ((2.0,), "2"),
        ((0.5,), "0.5"),
        ((math.nan,), "nan"),
        ((0.0, 1.0), "0, 1"),
    ]:
        assert failure_of(broken("none"), lambda _o, _t, a=action: a) == (
            f"error[E0517]: the policy chose an action that `Broken-v0` does not have {where}\n"
            f"  = note: the action was ({shown}); {space}"
        )
    assert "E0517" in failure_of(Environment("Pendulum-v1"), lambda _o, _t: (math.nan,))


def test_missing_readings_are_counted_and_reach_the_policy() -> None:
    episode = run_episode(make(broken("nan observation"), True), Law(lambda _o, _t: (-1.0,)), 1)
    assert episode.missing_readings == 4
    assert np.isnan(episode.observations[3, 0])
    assert np.isinf(episode.observations[4, 1])
    assert len(episode.rewards) == 5


def test_episodes_without_an_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pirlc.simulation.rollout.LONGEST_EPISODE", 2_000)
    assert failure_of(Environment("Pendulum-v1", (("max_episode_steps", -1),))) == (
        "error[E0518]: the episode of seed 7 in `Pendulum-v1` did not end within 2,000 steps\n"
        "  = help: give the environment a time limit, such as `{ max_episode_steps = 1000 }`"
    )


def test_parallel_map_keeps_order() -> None:
    assert parallel_map(lambda x: x * x, range(20), Workers(2)) == [x * x for x in range(20)]


def test_an_interrupt_is_silent_in_the_workers(tmp_path: Path) -> None:
    script = tmp_path / "long.py"
    script.write_text(
        "import sys, time\n"
        "from pirlc.simulation.workers import Workers, parallel_map\n"
        "def work(x):\n"
        "    print('started', flush=True)\n"
        "    time.sleep(30)\n"
        "try:\n"
        "    parallel_map(work, [1, 2], Workers(2))\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted', flush=True)\n"
        "    sys.exit(130)\n"
    )
    with started(script, env={"PYTHONUNBUFFERED": "1"}, start_new_session=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "started\n"
        time.sleep(0.2)
        os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=20)
    assert process.returncode == 130
    assert "interrupted" in out
    assert "Traceback" not in err
