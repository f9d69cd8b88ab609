"""`pirlc torcs race`: figures, plots, mistakes, interruption."""

from __future__ import annotations

import json
import os
import signal
import time
from pathlib import Path

import pytest

from tests.support.command_line import ROOT
from tests.support.processes import started

DRIVER = """policy driver
environment "pirlc/Torcs-v0" { track = "g-track-1", laps = 9, noise = 0.001 }
sensor Angle : [-1, 1] = 1
sensor Place : [-1, 1] = 2
sensor Speed : [-1, 1] = 0
action Steer : [-1, 1] = 4 * peek(Angle, -1) - 0.3 * peek(Place, -1)
action Accel : [0, 1] = 3 * (0.25 - peek(Speed, -1))
"""


@pytest.fixture
def driver(here) -> Path:
    path = here / "driver.pirl"
    path.write_text(DRIVER)
    return path


def test_a_race_is_told_and_drawn(pirlc, driver, torcs_installation):
    first = pirlc("torcs", "race", driver, "--laps", "1", "-o", "out", "--json")
    assert first.code == 0 and first.err == ""
    data = first.data
    assert (data["driver"], data["track"], data["car"]) == ("driver", "g-track-1", "car1-trb1")
    assert (data["status"], data["outcome"]) == ("finished", "finished 1 lap")
    assert len(data["laps"]) == 1 and data["mean_lap"] == data["laps"][0]
    # Round 2,058 m from a standstill 100 m before the line.
    assert 100 < data["mean_lap"] < 150 and 60 < data["top_speed"] < 80
    assert 2140 < data["distance"] < 2170
    assert data["damage"] == 0 and data["largest_position"] < 1
    assert data["times_real_time"] > 20
    assert data["files"] == ["out/race.json", "out/line.png", "out/actions.png"]
    for image in data["files"][1:]:
        assert Path(image).read_bytes().startswith(b"\x89PNG") and Path(image).stat().st_size > 9999
    kept = json.loads(Path("out/race.json").read_text())
    assert kept == {key: data[key] for key in kept} and "laps" in kept
    again = pirlc("torcs", "race", driver, "--laps", "1", "--no-plots", "--json").data
    same = ("laps", "steps", "steering_deviation", "mean_reward", "distance")
    assert [again[key] for key in same] == [data[key] for key in same]
    assert again["files"] == []
    other = pirlc("torcs", "race", driver, "--laps", "1", "--no-plots", "--seed", "1", "--json")
    assert other.data["steering_deviation"] != data["steering_deviation"]


def test_the_reward_is_the_papers(pirlc, driver, torcs_installation):
    def told() -> dict[str, object]:
        return pirlc("torcs", "race", driver, "--laps", "1", "--no-plots", "--json").data

    own = told()
    driver.write_text(DRIVER.replace("noise", 'reward = "progress", noise'))
    other = told()
    assert own["mean_reward"] == other["mean_reward"]
    # km/h; metres of progress would be half of one a step.
    assert 40 < own["mean_reward"] < 3.6 * own["distance"] / own["time"]


def test_in_words(pirlc, driver, torcs_installation):
    outcome = pirlc("torcs", "race", driver, "--laps", "2", "--no-plots", "--track", "aalborg")
    assert outcome.code == 0
    lines = outcome.out.splitlines()
    assert lines[0] == "driver on aalborg, car1-trb1"
    assert [line.split("  ")[1] for line in lines[1:4]] == ["outcome", "laps", "mean lap"]
    assert not Path("race-driver-aalborg").exists()


def test_blocked_sensors_go_by_either_name(pirlc, driver, torcs_installation):
    def deviation(*more: str) -> float:
        base = ("torcs", "race", driver, "--laps", "1", "--no-plots", "--json")
        return pirlc(*base, *more).data["steering_deviation"]

    by_sensor = deviation("--blocked", "Place, Angle", "--block-probability", "0.9")
    assert by_sensor == deviation("--blocked", "trackpos,ANGLE", "--block-probability", "0.9")
    assert by_sensor != deviation("--blocked", "Place,Angle") != deviation()


def test_a_robot_of_torcs(pirlc, here, torcs_installation):
    data = pirlc("torcs", "race", "robot:berniw", "--laps", "1", "--no-plots", "--json").data
    assert data["driver"] == "robot:berniw" and data["outcome"] == "finished 1 lap"
    assert 70 < data["mean_lap"] < 95


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["robot:bernie"], "E0731", "no robot 'bernie' comes with TORCS"),
        (
            ["driver.pirl", "--blocked", "Place,rmp"],
            "E0732",
            "'rmp' is neither a sensor of the program nor a reading of TORCS",
        ),
        (["driver.pirl", "--track", "nowhere"], "E0527", "TORCS has no track called `nowhere`"),
        (["driver.pirl", "--car", "tractor"], "E0528", "TORCS has no car called `tractor`"),
        (["pole.pirl"], "E0538", "action Push has listed values, but is the car's steer, a real"),
        (["sketch.pirl"], "E0704", "this is a sketch: a program is needed"),
        (["missing.pirl"], "E0701", "cannot read missing.pirl"),
    ],
)
def test_mistakes(pirlc, driver, torcs_installation, words, code, message):
    outcome = pirlc("torcs", "race", *words, "--json")
    assert outcome.code == 1
    diagnostic = outcome.data["diagnostics"][0]
    assert diagnostic["code"] == code and diagnostic["message"].startswith(message)


@pytest.mark.parametrize("code", ["E0731", "E0732", "E0733"])
def test_every_code_has_a_page(code):
    page = (ROOT / "pirlc" / "explanations" / f"{code}.md").read_text(encoding="utf-8")
    assert page.startswith(f"# {code}: ") and "## What to do" in page


def of_group(group: int) -> list[str]:
    """The processes of a process's session that still run, those of simulators among them."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                text = (entry / "environ").read_bytes()
            except OSError:
                continue
            if f"RACE_TEST={group}".encode() in text:
                found.append(entry.name)
    return found


@pytest.mark.parametrize("killer", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupted_race_leaves_no_process(driver, torcs_installation, killer):
    mark = os.getpid() * 100 + killer
    command = ["-m", "pirlc", "torcs", "race", driver, "--laps", "1000", "--no-plots"]
    environment = {"RACE_TEST": str(mark), "TMPDIR": str(driver.parent)}
    with started(*command, env=environment) as process:
        for _ in range(300):
            time.sleep(0.1)
            # The command, TORCS on the grid, and the race.
            if len(of_group(mark)) >= 3:
                break
        else:
            pytest.fail("no race began")
        process.send_signal(killer)
        _, told = process.communicate(timeout=20)
    if killer == signal.SIGINT:
        assert (process.returncode, told.strip()) == (130, "interrupted")
    for _ in range(50):
        if not of_group(mark):
            return
        time.sleep(0.1)
    pytest.fail(f"still there: {of_group(mark)}")
