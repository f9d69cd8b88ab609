"""Races that TORCS runs by itself are those of the environment, bit for bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pirlc.backend.policies import c_controller
from pirlc.semantics.policies import InterpretedPolicy
from pirlc.simulation.torcs.installation import Installation
from pirlc.simulation.torcs.presets import TERMINATIONS
from pirlc.simulation.torcs.protocol import FRAME, PART, Conditions, Status
from pirlc.simulation.torcs.simulator import ROBOTS, Course, TorcsProcess
from tests.simulation.torcs.racing import program, torcs

pytestmark = pytest.mark.usefixtures("torcs_installation")


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return c_controller(program(), tmp_path_factory.mktemp("built")).library


def step_by_step(seed: int, **arguments: Any) -> NDArray[np.float64]:
    """All frames of a race with the reference interpreter at the wheel."""
    env, driver = torcs(**arguments), InterpretedPolicy(program())
    readings, _ = env.reset(seed=seed)
    assert env._process is not None
    frames = [env._process._frame.copy()]
    ended = False
    while not ended:
        action = driver.act(readings)
        frames[-1][FRAME.index("command_steer") :][:3] = [*action, 0.0]
        readings, _, ended, _, _ = env.step(np.array(action))
        frames.append(env._process._frame.copy())
    env.close()
    return np.array(frames)


def natively(library: Path, seed: int, **arguments: Any) -> NDArray[np.float64]:
    env = torcs(**arguments)
    trace = env.race(str(library), None, seed, None)
    env.close()
    return trace.frames


def test_three_laps_of_aalborg_are_the_same_natively(library: Path) -> None:
    ours, theirs = step_by_step(0), natively(library, 0)
    assert Status(int(theirs[-1, 0])) is Status.FINISHED
    assert ours.shape == theirs.shape and len(ours) > 2 * PART
    assert ours.tobytes() == theirs.tobytes()


@pytest.mark.parametrize("seed", [0, 1])
def test_disturbed_races_are_the_same_natively(library: Path, seed: int) -> None:
    disturbed = {
        "track": "g-track-1", "laps": 1, "noise": 0.02, "grip_variation": 0.2,
        "blocked": "angle,speedX,track9", "block_probability": 0.4,
    }  # fmt: skip
    ours, theirs = step_by_step(seed, **disturbed), natively(library, seed, **disturbed)
    assert np.isnan(theirs[:, -28]).mean() > 0.3
    assert ours.tobytes() == theirs.tobytes()


def test_a_native_race_is_cut_off_where_it_is_asked(library: Path) -> None:
    env = torcs(laps=0)
    for most in (1, PART - 1, PART, PART + 1):
        trace = env.race(str(library), None, 0, most)
        assert trace.status is Status.TIME_LIMIT
        assert len(trace.rewards) == len(trace.observations) == len(trace.actions) == most
        assert np.isfinite(trace.actions).all() and np.isnan(trace.frames[-1, 17:20]).all()
    env.close()


def test_without_beams_only_they_are_missing(library: Path) -> None:
    env = torcs()
    with_beams = env.race(str(library), None, 0, 50)
    without = env.race(str(library), None, 0, 50, beams=False)
    assert not without.observations[:, 10:].any()
    assert np.array_equal(with_beams.observations[0, :10], without.observations[0, :10])
    env.close()


def test_parameters_replace_the_programs_own(tmp_path: Path) -> None:
    text = (
        'policy kept\nenvironment "pirlc/Torcs-v0"\nsensor angle : [-1, 1] = 1\nparam go = 0.25\n'
        "param kp = 4\naction steer : [-1, 1] = kp * peek(angle, -1)\naction accel : [0, 1] = go\n"
    )
    built = str(c_controller(program(text), tmp_path).library)
    env = torcs()
    assert (env.race(built, None, 0, 9).actions[:, 1] == 0.25).all()
    assert (env.race(built, (0.75, 1.0), 0, 9).actions[:, 1] == 0.75).all()
    with pytest.raises(ValueError, match="257 parameters; a request has room for 256"):
        env.race(built, (0.0,) * 257, 0, 9)
    with pytest.raises(ValueError, match="a path of 2000 bytes"):
        env.race("x" * 2000, None, 0, 9)
    assert (env.race(built, None, 0, 9).actions[:, 1] == 0.25).all()
    env.close()


def test_a_controller_that_gives_nan_ends_the_race_before_it_reaches_the_car(
    tmp_path: Path,
) -> None:
    import subprocess

    source = tmp_path / "wrong.c"
    source.write_text(
        "#include <math.h>\n"
        "unsigned long bridge_state_size(void) { return sizeof(int); }\n"
        "void bridge_reset(int *s) { *s = 0; }\n"
        "void bridge_default_params(double *p) { (void)p; }\n"
        "unsigned bridge_step(const double *p, int *s, const double *in, double *out)\n"
        "{ (void)p; (void)in; out[0] = 0; out[1] = *s == 120 ? NAN : 1; ++*s; return 0; }\n"
    )
    built = tmp_path / "wrong.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-o", str(built), str(source)], check=True)
    env = torcs()
    trace = env.race(str(built), None, 0, 1000)
    assert trace.status is Status.BAD_ACTION
    assert len(trace.rewards) == 120
    assert (trace.actions[:, 1] == 1).all() and np.isfinite(trace.frames[:, :17]).all()
    env.close()


def test_a_library_that_is_none(tmp_path: Path) -> None:
    env = torcs()
    no_library = tmp_path / "text.so"
    no_library.write_text("no library")
    for name in (tmp_path / "missing.so", no_library):
        assert env.race(str(name), None, 0, 9).status is Status.NO_CONTROLLER
    env.close()


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=list(ROBOTS))
def test_robots_of_torcs_race_as_passengers(torcs_installation: Installation, robot: Any) -> None:
    process = TorcsProcess(torcs_installation, Course("g-track-1", laps=2, robot=robot))
    first, second = process.race_robot(Conditions()), process.race_robot(Conditions())
    process.close()
    assert first.frames.tobytes() == second.frames.tobytes()
    assert first.status is Status.FINISHED
    assert len(first.laps) == 2 and all(35 < lap < 65 for lap in first.laps)
    assert first["laps"][-1] == 2 and first["lap_time"][-1] == first.laps[-1]
    assert first["distance"][-1] > 2 * 2057
    assert np.ptp(first["command_brake"][:-1]) > 0


def test_a_robot_stays_on_the_road_by_its_own_standards(torcs_installation: Installation) -> None:
    course = Course("aalborg", laps=1, robot=ROBOTS["berniw"])
    process = TorcsProcess(torcs_installation, course)
    trace = process.race_robot(Conditions(termination=TERMINATIONS["none"]))
    process.close()
    assert trace.status is Status.FINISHED and trace["damage"][-1] == 0
    assert np.abs(trace["trackPos"]).max() < 1.1
