"""Simulators that die or hang, and that nothing is left behind."""

from __future__ import annotations

import gc
import os
import signal
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from benchmarks.torcs.processes import children, descriptors, resident
from pirlc.backend.policies import c_controller
from pirlc.diagnostics import PirlcError, render
from pirlc.ir.policy import Environment
from pirlc.simulation.environments import make
from pirlc.simulation.policy import Ready
from pirlc.simulation.rollout import run_return
from pirlc.simulation.torcs.environment import Torcs
from pirlc.simulation.torcs.installation import Installation
from pirlc.simulation.torcs.protocol import Conditions
from pirlc.simulation.torcs.simulator import Course, TorcsDied, TorcsHangs, TorcsProcess
from tests.simulation.torcs.racing import (
    alive,
    drive,
    folders,
    program,
    torcs,
)
from tests.support.processes import started

pytestmark = pytest.mark.usefixtures("torcs_installation")

GO = np.array([0.0, 1.0])

RACE_KILLED = "TORCS ended by itself: exit status 1; it said: a race was ended by signal 9"


@pytest.fixture(autouse=True)
def _nothing_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Every test here leaves no folder behind; each has a place of its own for them."""
    place = tmp_path / "temporary"
    place.mkdir()
    monkeypatch.setenv("TMPDIR", str(place))
    monkeypatch.setattr(tempfile, "tempdir", None)
    yield
    gc.collect()
    assert folders() == set()


def on_the_grid(env: Torcs) -> int:
    assert env._process is not None
    return env._process.pid


def racing(env: Torcs) -> int:
    (race,) = children(on_the_grid(env))
    return race


def gone(pid: int, patience: float = 5.0) -> bool:
    """Whether a process ends in time."""
    deadline = time.monotonic() + patience
    while alive(pid):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.01)
    return True


def after_failure(env: Torcs, expected: np.ndarray) -> None:
    with pytest.raises(gym.error.ResetNeeded):
        env.step(GO)
    assert drive(env, 0, 20).tobytes() == expected.tobytes()
    env.close()


@pytest.mark.parametrize(
    ("victim", "words"),
    [
        (on_the_grid, "TORCS ended by itself: signal 9 (Killed)"),
        (racing, RACE_KILLED),
    ],
)
def test_a_killed_simulator(victim: Callable[[Torcs], int], words: str) -> None:
    env = torcs()
    expected = drive(env, 0, 20)
    env.reset()
    env.step(GO)
    grid, race = on_the_grid(env), racing(env)
    os.kill(victim(env), signal.SIGKILL)
    with pytest.raises(TorcsDied) as caught:
        for _ in range(100):
            env.step(GO)
    assert str(caught.value) == words
    assert gone(grid) and gone(race)
    after_failure(env, expected)


@pytest.mark.parametrize("victim", [on_the_grid, racing])
def test_a_simulator_killed_between_races_is_replaced(victim: Callable[[Torcs], int]) -> None:
    env = torcs()
    expected = drive(env, 0, 20)
    os.kill(victim(env), signal.SIGKILL)
    time.sleep(0.1)
    assert drive(env, 0, 20).tobytes() == expected.tobytes()
    env.close()


@pytest.mark.parametrize("victim", [on_the_grid, racing])
def test_a_simulator_that_hangs(victim: Callable[[Torcs], int]) -> None:
    env = torcs()
    env.patience = 0.4
    expected = drive(env, 0, 20)
    env.reset()
    grid, race = on_the_grid(env), racing(env)
    os.kill(victim(env), signal.SIGSTOP)
    with pytest.raises(TorcsHangs) as caught:
        if victim is racing:
            env.step(GO)
        else:
            env.reset()
    assert str(caught.value) == "TORCS gave no answer within 0.4 s"
    assert gone(grid) and gone(race)
    after_failure(env, expected)


def endless(folder: Path) -> str:
    """A controller that drives for ever."""
    return str(c_controller(program(), folder).library)


def in_a_while(do: Callable[[], None], seconds: float = 0.3) -> threading.Timer:
    timer = threading.Timer(seconds, do)
    timer.start()
    return timer


@pytest.mark.parametrize(
    ("sent", "words"),
    [
        (signal.SIGKILL, RACE_KILLED),
        (signal.SIGSTOP, "TORCS gave no answer within 0.5 s"),
    ],
)
def test_a_native_race_that_is_killed_or_hangs(
    sent: signal.Signals, words: str, tmp_path: Path
) -> None:
    env = torcs(laps=0, termination="none")
    env.patience = 0.5
    library = endless(tmp_path)
    before = env.race(library, None, 0, 500)
    timer = in_a_while(lambda: os.kill(racing(env), sent))
    with pytest.raises((TorcsDied, TorcsHangs)) as caught:
        env.race(library, None, 0, None)
    timer.join()
    assert str(caught.value) == words
    again = env.race(library, None, 0, 500)
    assert again.frames.tobytes() == before.frames.tobytes()
    env.close()


def test_rollouts_tell_of_a_simulator_that_died() -> None:
    simulator = make(Environment("pirlc/Torcs-v0"))
    env: Any = simulator.unwrapped

    class Killer:
        steps = 0

        def reset(self) -> None:
            self.steps = 0

        def act(self, _: Any) -> tuple[float, ...]:
            self.steps += 1
            if self.steps == 5:
                race = racing(env)
                os.kill(on_the_grid(env), signal.SIGKILL)
                assert gone(race)
            return 0.0, 1.0

    with pytest.raises(PirlcError) as caught:
        run_return(simulator, Ready(Killer())(), 7)
    assert render(caught.value.diagnostics[0]) == (
        "error[E0514]: the environment `pirlc/Torcs-v0` failed in the episode of seed 7, at step 4"
        "\n  = note: its `step` raised TorcsDied: TORCS ended by itself: signal 9 (Killed)"
    )
    simulator.close()


def test_torcs_that_cannot_start_is_told_of(torcs_installation: Installation) -> None:
    process = TorcsProcess(torcs_installation, Course("no-such-track", "road"))
    with pytest.raises(TorcsDied, match=r"^TORCS ended by itself: "):
        process.begin(Conditions())
    process.close()


def test_interrupted_in_the_middle_of_a_race(tmp_path: Path) -> None:
    env = torcs(laps=0, termination="none")
    expected = drive(env, 0, 20)
    library = endless(tmp_path)
    grid = on_the_grid(env)
    timer = in_a_while(lambda: os.kill(os.getpid(), signal.SIGINT))
    with pytest.raises(KeyboardInterrupt):
        env.race(library, None, 0, None)
    timer.join()
    assert gone(grid)
    after_failure(env, expected)


SCRIPT = """
import sys, time
import numpy as np
from pirlc.simulation.torcs.environment import Torcs
env, other = Torcs(laps=0, termination="none"), Torcs(laps=0, termination="none")
env.reset(); other.reset()
print(env._process.pid, other._process.pid, flush=True)
{then}
"""
STEPPING = "while True: env.step(np.array([0.0, 0.0])) if env._running else env.reset()"
NATIVE = "while True: env.race({library!r}, None, 0, None)"


@pytest.mark.parametrize(
    ("doing", "sent"),
    [
        ("stepping", signal.SIGINT),
        ("stepping", signal.SIGKILL),
        ("native", signal.SIGINT),
        ("native", signal.SIGKILL),
        ("idle", signal.SIGTERM),
    ],
)
def test_whatever_ends_the_process_ends_torcs(
    doing: str, sent: signal.Signals, tmp_path: Path
) -> None:
    then = {
        "stepping": STEPPING,
        "native": NATIVE.format(library=endless(tmp_path)),
        "idle": "time.sleep(60)",
    }[doing]
    with started("-c", SCRIPT.format(then=then), start_new_session=True) as process:
        assert process.stdout is not None
        grids = [int(word) for word in process.stdout.readline().split()]
        races = [race for grid in grids for race in children(grid)]
        assert len(grids) == 2 and races
        time.sleep(0.2)
        os.killpg(process.pid, sent)
        process.wait(timeout=20)
    assert all(gone(pid) for pid in (*grids, *races))


def test_an_environment_that_nobody_has_any_more() -> None:
    env = torcs()
    env.reset()
    grid, race, before = on_the_grid(env), racing(env), descriptors(os.getpid())
    del env
    gc.collect()
    assert gone(grid) and gone(race)
    assert descriptors(os.getpid()) < before


def test_a_fork_of_the_process_starts_its_own() -> None:
    env = torcs()
    expected = drive(env, 0, 20)
    env.reset()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            code = 0 if drive(env, 0, 20).tobytes() == expected.tobytes() else 2
            env.close()
        finally:
            os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    env.step(GO)  # its own race goes on
    assert drive(env, 0, 20).tobytes() == expected.tobytes()
    env.close()


def test_a_thousand_resets_leave_no_trace() -> None:
    env = torcs()
    for _ in range(50):
        drive(env, 0, 3)
    grid = on_the_grid(env)
    before = resident(grid), resident(os.getpid()), descriptors(os.getpid())
    start = time.perf_counter()
    for seed in range(1000):
        env.reset(seed=seed)
        env.step(GO)
    taken = time.perf_counter() - start
    after = resident(grid), resident(os.getpid()), descriptors(os.getpid())
    assert on_the_grid(env) == grid and len(children(grid)) == 1
    assert after[0] - before[0] < 200_000
    assert after[1] - before[1] < 2_000_000
    assert after[2] == before[2]
    assert taken / 1000 < 0.1
    env.close()
    assert gone(grid)
