"""Episodes that TORCS runs by itself are those of the step-by-step rollout, bit for bit."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from pirlc.backend.policies import CControllerFactory, c_controller, python_controller
from pirlc.backend.toolchain import QUICK_FLAGS
from pirlc.diagnostics import PirlcError, render
from pirlc.ir.policy import Environment, Program
from pirlc.simulation.environments import Simulator, facts, make
from pirlc.simulation.native import run_native
from pirlc.simulation.rollout import run_episode, run_return
from pirlc.simulation.torcs.presets import REWARDS
from pirlc.simulation.workers import Workers, collect_episodes, collect_returns
from tests.simulation.torcs.racing import CAREFUL, program

pytestmark = pytest.mark.usefixtures("torcs_installation")

RECKLESS = """policy reckless
environment "pirlc/Torcs-v0" { brake = true }
sensor angle : [-1, 1] = 1 missing hold 2 then fail
sensor trackPos : [-1, 1] = 2
sensor rpm : [0, 1] = 5
window 4
param gain = 12
action steer : [-1, 1] safe 0.01 = gain * peek(angle, -1) - 0.1 * fold(+, trackPos) / 4
                                 + 0.2 * previous(steer)
action accel : [0, 1] safe 0.5 = if abs(peek(trackPos, -1)) > 0.3 then 0.2
                                 else 5 * (0.9 - peek(rpm, -1))
action brake : [0, 1] safe 0 = abs(peek(trackPos, -2)) - 0.6
"""

DISTURBED = (
    ("blocked", "trackPos, rpm, angle"),
    ("block_probability", 0.4),
    ("noise", 0.02),
    ("grip_variation", 0.3),
)


def place(*arguments: tuple[str, str | float | int | bool]) -> Environment:
    return Environment("pirlc/Torcs-v0", (("laps", 1), *arguments))


def compiled(written: Program, folder: Path) -> CControllerFactory:
    return c_controller(written, folder, flags=QUICK_FLAGS)


@pytest.mark.parametrize(
    ("text", "arguments"),
    [
        (CAREFUL, (("max_episode_steps", 400),)),
        (CAREFUL, (*DISTURBED, ("max_episode_steps", 400), ("reward", "gym_torcs"))),
        (RECKLESS, (("brake", True), ("reward", "progress"))),
        (RECKLESS, (*DISTURBED, ("brake", True), ("track", "g-track-2"))),
    ],
    ids=["careful", "careful, disturbed", "reckless", "reckless, disturbed"],
)
def test_episodes_and_returns_are_those_of_every_other_form(text, arguments, tmp_path):
    written = program(text)
    native, lock_step = compiled(written, tmp_path), python_controller(written)
    simulator = make(place(*arguments))
    seen = set()
    for seed in (0, 1, 12345):
        one = run_episode(simulator, native(), seed)
        other = run_episode(simulator, lock_step(), seed)
        for field in ("observations", "actions", "rewards"):
            left, right = getattr(one, field), getattr(other, field)
            assert left.shape == right.shape
            assert left.tobytes() == right.tobytes()
        total = run_return(simulator, native(), seed)
        assert total == run_return(simulator, lock_step(), seed) == math.fsum(other.rewards)
        seen.add(total)
    assert len(seen) == (3 if DISTURBED[0] in arguments else 1)
    simulator.close()


def test_parameters_are_passed_on_without_another_compilation(tmp_path):
    written = program(RECKLESS)
    factory, lock_step = compiled(written, tmp_path), python_controller(written)
    built = list(tmp_path.rglob("*.so"))
    simulator = make(place(("brake", True)))
    returns = {}
    for gain in (3.0, 12.0, 20.0):
        returns[gain] = run_return(simulator, factory.with_params({"gain": gain}), 0)
        assert returns[gain] == run_return(simulator, lock_step.with_params({"gain": gain}), 0)
    assert len(set(returns.values())) == 3
    assert list(tmp_path.rglob("*.so")) == built
    with pytest.raises(PirlcError) as caught:
        factory.with_params({"gian": 1.0})
    assert caught.value.diagnostics[0].code == "E0807"
    simulator.close()


def test_a_time_limit_cuts_a_native_race_off(tmp_path):
    factory = compiled(program(), tmp_path)
    simulator = make(place(("max_episode_steps", 33)))
    episode = run_episode(simulator, factory(), 0)
    assert (episode.observations.shape, episode.actions.shape) == ((33, 29), (33, 2))
    simulator.close()


def test_what_is_not_a_standard_wrapper_is_not_gone_around(tmp_path):
    class Halved(gym.RewardWrapper):
        def reward(self, reward):
            return reward / 2

    factory = compiled(program(), tmp_path)
    inside = make(place(("max_episode_steps", 50)))
    assert run_native(inside, factory(), 0, everything=True) is not None
    halved: Simulator = gym.wrappers.TimeLimit(Halved(inside), 50)
    assert run_native(halved, factory(), 0, everything=True) is None
    assert run_native(inside, python_controller(program())(), 0, everything=True) is None
    whole = run_episode(inside, factory(), 0).rewards
    assert np.array_equal(run_episode(halved, factory(), 0).rewards, whole / 2)
    inside.close()


def test_workers_give_the_same_natively(tmp_path):
    environment = place(("max_episode_steps", 100), ("noise", 0.1))
    native, lock_step = compiled(program(), tmp_path), python_controller(program())
    expected = collect_returns(lock_step, environment, range(4))
    shared = collect_returns(native, environment, range(4), workers=Workers(2))
    assert np.array_equal(shared, expected)
    episodes = collect_episodes(native, environment, range(4), workers=Workers(2))
    assert [math.fsum(e.rewards) for e in episodes] == expected.tolist()


def test_a_library_that_is_gone(tmp_path):
    factory = replace(compiled(program(), tmp_path), library=tmp_path / "gone.so")
    simulator = make(place())
    with pytest.raises(PirlcError) as caught:
        run_return(simulator, factory(), 0)
    assert render(caught.value.diagnostics[0]) == (
        "error[E0540]: the simulator of `pirlc/Torcs-v0` could not load the compiled controller\n"
        "  = note: its library is missing, or was built for another machine\n"
        "  = help: the same compiler must serve both: see that `CC` makes programs for this machine"
    )
    assert math.isfinite(run_return(simulator, compiled(program(), tmp_path)(), 0))
    simulator.close()


def test_facts_tell_who_races_by_itself_and_where_chance_plays():
    plain = facts(place())
    assert (plain.native, plain.deterministic) == (True, True)
    for argument in (("noise", 0.01), ("grip_variation", 0.1)):
        assert not facts(place(argument)).deterministic
    assert not facts(place(("blocked", "rpm"), ("block_probability", 0.5))).deterministic
    assert facts(place(("blocked", "rpm"), ("block_probability", 0.0))).deterministic
    pole = facts(Environment("CartPole-v1"))
    assert (pole.native, pole.deterministic) == (False, False)


def test_all_rewards_are_simulated_alike(tmp_path):
    factory, lock_step = compiled(program(), tmp_path), python_controller(program())
    for reward in REWARDS:
        simulator = make(place(("reward", reward), ("max_episode_steps", 150)))
        assert run_return(simulator, factory(), 0) == run_return(simulator, lock_step(), 0)
        simulator.close()
