"""The TORCS environment as Gymnasium asks of it, and its determinism."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from pirlc.ir.policy import Environment
from pirlc.simulation.environments import BoxActions, facts, make, register_own
from pirlc.simulation.torcs.readings import READINGS
from pirlc.simulation.workers import Workers, parallel_map
from tests.simulation.torcs.racing import drive, torcs

pytestmark = pytest.mark.usefixtures("torcs_installation")


def test_gymnasiums_own_checks_pass() -> None:
    register_own()
    env = gym.make("pirlc/Torcs-v0", laps=1, brake=True)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        check_env(env.unwrapped)
    env.close()
    # Bounds would be wrong, as the class says; the reading's kind is not the checker's business.
    rest = [str(w.message) for w in told if "infinity" not in str(w.message)]
    assert not [text for text in rest if "action space" not in text and "seed" not in text], rest


def test_what_the_compiler_learns_of_it() -> None:
    found = facts(Environment("pirlc/Torcs-v0"))
    assert found.observation_size == 29
    assert found.observation_dtype == "float64"
    assert found.actions == BoxActions((-1.0, 0.0), (1.0, 1.0), "float64")
    assert found.sample_time == 0.02
    assert found.max_episode_steps is None
    braked = facts(Environment("pirlc/Torcs-v0", (("brake", True), ("max_episode_steps", 9))))
    assert braked.actions == BoxActions((-1.0, 0.0, 0.0), (1.0, 1.0, 1.0), "float64")
    assert braked.max_episode_steps == 9


def test_a_race_from_the_grid() -> None:
    env = torcs(laps=1)
    readings, info = env.reset(seed=3)
    assert readings.shape == (29,) and readings.dtype == np.float64
    assert info == {
        "status": "running", "laps": 0, "lap_time": 0.0, "distance": 0.0, "damage": 0.0
    }  # fmt: skip
    at_start = dict(zip(READINGS, readings, strict=True))
    assert abs(at_start["speedX"]) < 0.01 and abs(at_start["angle"]) < 0.01
    for _ in range(200):
        readings, reward, terminated, truncated, info = env.step(np.array([0.0, 1.0]))
        assert not terminated and not truncated
    assert readings[0] > 0.1 and reward > 30 and info["distance"] > 10
    env.close()


def test_resets_are_asked_for() -> None:
    env = torcs(track="g-track-1")
    go = np.array([0.0, 1.0])
    with pytest.raises(gym.error.ResetNeeded, match=r"call reset\(\) first"):
        env.step(go)
    env.reset(seed=0)
    aside, ended = np.array([0.1, 1.0]), False
    while not ended:
        _, _, ended, _, info = env.step(aside)
    assert info["status"] == "off_track"
    with pytest.raises(gym.error.ResetNeeded):
        env.step(go)
    env.reset()
    env.close()
    with pytest.raises(gym.error.ResetNeeded):
        env.step(go)
    env.reset()  # also after close
    env.close()


@pytest.mark.parametrize("bad", [[np.nan, 0.5], [0.0, np.inf], [0.0], [0.0, 0.5, 0.5], [[0.0, 1]]])
def test_what_is_no_command_never_reaches_the_simulator(bad: list[float]) -> None:
    env, twin = torcs(), torcs()
    env.reset(seed=0)
    twin.reset(seed=0)
    go = np.array([0.0, 1.0])
    for _ in range(3):
        with pytest.raises(ValueError, match="not 2 finite numbers"):
            env.step(np.array(bad))
        readings = env.step(go)[0]  # the race goes on as if nothing had been said
        assert np.array_equal(readings, twin.step(go)[0])
    env.close()
    twin.close()


def test_actions_are_clipped() -> None:
    env, twin = torcs(brake=True), torcs(brake=True)
    env.reset()
    twin.reset()
    for _ in range(150):
        ours = env.step(np.array([-7.0, 9.0, -2.0]))
        theirs = twin.step(np.array([-1.0, 1.0, 0.0]))
        assert np.array_equal(ours[0], theirs[0]) and ours[1] == theirs[1]
        if ours[2]:
            break
    env.close()
    twin.close()


def test_time_limits_are_gymnasiums() -> None:
    env = make(Environment("pirlc/Torcs-v0", (("max_episode_steps", 20),)))
    env.reset(seed=0)
    steps, truncated = 0, False
    while not truncated:
        _, _, terminated, truncated, _ = env.step(np.array([0.0, 1.0]))
        assert not terminated
        steps += 1
    assert steps == 20
    env.reset(seed=0)
    assert not env.step(np.array([0.0, 1.0]))[3]
    env.close()


def test_a_car_that_stands_is_taken_out_in_the_end() -> None:
    env = torcs(track="g-track-1", termination="none", reward="progress")
    env.reset()
    stay, steps, ended = np.array([0.0, 0.0]), 0, False
    while not ended:
        readings, _, ended, truncated, info = env.step(stay)
        steps += 1
    # TORCS allows 84.5 s and a second for 10 m of the track's 2057.6 m. Now and then it lets a step
    # of its own more go by before a command.
    assert info["status"] == "out" and not truncated
    assert 0.95 < steps * 0.02 / (84.5 + 205.76) < 1.01
    assert np.isfinite(readings).all() and readings[2] != 0
    env.close()


def test_the_same_actions_make_the_same_race() -> None:
    env, other = torcs(), torcs()
    first = drive(env, 0, 700)
    assert len(first) == 701
    for again in (drive(env, 0, 700), drive(env, 99, 700), drive(other, 0, 700)):
        assert first.tobytes() == again.tobytes()
    env.close()
    other.close()


def test_another_process_makes_the_same_race() -> None:
    env = torcs(noise=0.01, blocked="rpm", block_probability=0.3, grip_variation=0.2)
    ours = drive(env, 5, 300)
    env.close()
    script = (
        "import sys; from tests.simulation.torcs.racing import drive, torcs\n"
        "env = torcs(noise=0.01, blocked='rpm', block_probability=0.3, grip_variation=0.2)\n"
        "sys.stdout.buffer.write(drive(env, 5, 300).tobytes())"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=True)
    assert done.stdout == ours.tobytes()


def test_disturbances_come_from_the_seed() -> None:
    env = torcs(noise=0.01, blocked="rpm, trackPos", block_probability=0.5, grip_variation=0.3)
    assert not env.deterministic
    first, again, other = drive(env, 1, 400), drive(env, 1, 400), drive(env, 2, 400)
    assert first.tobytes() == again.tobytes() != other.tobytes()
    blocked = [READINGS.index("rpm"), READINGS.index("trackPos")]
    missing = np.isnan(first[:, :29])
    assert not np.delete(missing, blocked, axis=1).any()
    share = missing[:, blocked].mean()
    assert 0.4 < share < 0.6
    env.close()


def test_noise_is_relative_and_of_the_size_that_is_asked() -> None:
    still, noisy = torcs(), torcs(noise=0.05)
    assert still.deterministic
    quiet = still.reset(seed=0)[0]
    loud = [noisy.reset(seed=seed)[0] for seed in range(200)]
    beams = slice(10, 29)
    ratio = np.array(loud)[:, beams] / quiet[beams]
    assert abs(ratio.mean() - 1) < 0.01
    assert 0.045 < ratio.std() < 0.055
    still.close()
    noisy.close()


def test_grip_changes_the_race_and_stays_out_of_the_next() -> None:
    slippery = torcs(grip_variation=0.8)
    spins = {round(drive(slippery, seed, 250)[-1, 30], 6) for seed in range(3)}
    assert len(spins) == 3
    again = {round(drive(slippery, seed, 250)[-1, 30], 6) for seed in range(3)}
    assert spins == again
    slippery.close()


def test_several_side_by_side() -> None:
    envs = [torcs(track=track) for track in ("aalborg", "g-track-1", "aalborg")]
    seen = [env.reset(seed=0)[0] for env in envs]
    go = np.array([0.0, 1.0])
    for _ in range(150):
        seen = [env.step(go)[0] for env in envs]
    assert np.array_equal(seen[0], seen[2]) and not np.array_equal(seen[0], seen[1])
    for env in envs:
        env.close()


def _driven(seed: int) -> bytes:
    env = torcs(noise=0.01)
    try:
        return drive(env, seed, 200).tobytes()
    finally:
        env.close()


def test_worker_processes_have_their_own() -> None:
    assert parallel_map(_driven, [1, 2, 3], Workers(2)) == [_driven(seed) for seed in (1, 2, 3)]


def test_the_thread_that_drives_keeps_its_processors() -> None:
    before = os.sched_getaffinity(0)
    env = torcs()
    drive(env, 0, 50)
    assert os.sched_getaffinity(0) == before
    env.close()
