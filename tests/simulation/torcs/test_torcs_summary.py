"""The figures of races: checked by hand on made-up frames, and by races."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pirlc.backend.policies import c_controller
from pirlc.cli.files import program_in
from pirlc.frontend import parse_sketch
from pirlc.simulation.torcs.protocol import COLUMN, FRAME, Conditions, Status, Trace
from pirlc.simulation.torcs.simulator import Course, TorcsProcess
from pirlc.simulation.torcs.summary import outcome, positions, summary
from pirlc.source import SourceText

PRINTED = Path(__file__).parents[3] / "examples" / "torcs" / "printed" / "aalborg.pirl"


def trace(**columns: list[float]) -> Trace:
    """A trace of zeros but for the columns that are given."""
    length = len(next(iter(columns.values())))
    frames = np.zeros((length, len(FRAME)))
    frames[:, COLUMN["width"]] = 10.0
    for name, values in columns.items():
        frames[:, COLUMN[name]] = values
    return Trace(frames)


def test_figures_by_hand():
    figures = summary(
        trace(
            status=[0, 0, 0, 1],
            reward=[0, 1, 2, 6],
            time=[-0.02, 0, 30, 70.5],
            laps=[0, 0, 1, 2],
            lap_time=[0, 0, 30, 40.5],
            distance=[0, 1, 2, 5000],
            damage=[0, 0, 3, 7],
            to_middle=[0, -6, 2, 1],
            trackPos=[0, math.nan, 0.4, 0.2],
            speed=[0, 50, 20, 10],
            command_steer=[-1, 0, 1, math.nan],
        )
    )
    assert figures.status is Status.FINISHED
    assert figures.laps == (30, 40.5) and figures.mean_lap == 35.25
    assert (figures.time, figures.steps, figures.distance, figures.damage) == (70.5, 3, 5000, 7)
    assert figures.mean_reward == 3
    assert figures.largest_position == 1.2  # where the sensor is blocked
    assert figures.steering_deviation == math.sqrt(2 / 3)  # of the population
    assert figures.top_speed == 180
    assert outcome(figures) == "finished 2 laps"


def test_a_race_that_ends_at_once():
    figures = summary(trace(status=[8], to_middle=[1]))
    assert figures.laps == () and math.isnan(figures.mean_lap)
    assert figures.steps == 0 and math.isnan(figures.mean_reward)
    assert math.isnan(figures.steering_deviation)
    assert outcome(figures) == "broke off after 0 m"


@pytest.mark.parametrize(
    ("status", "words"),
    [
        (Status.FINISHED, "finished 0 laps"),
        (Status.OFF_TRACK, "left the road after 1,234 m"),
        (Status.TOO_SLOW, "too slow after 1,234 m"),
        (Status.BACKWARDS, "turned backwards after 1,234 m"),
        (Status.OUT, "taken out by TORCS after 1,234 m"),
        (Status.TIME_LIMIT, "cut off after 1,234 m"),
        (Status.BAD_ACTION, "ended by a command that is no number, after 1,234 m"),
    ],
)
def test_outcomes_in_words(status, words):
    assert outcome(summary(trace(status=[0, status], distance=[0, 1234.2]))) == words


def test_the_papers_program_on_aalborg(tmp_path, torcs_installation):
    """Its table says 158.87 s a lap and a steering deviation of 0.2483."""
    source = SourceText("aalborg.pirl", PRINTED.read_text(encoding="utf-8"))
    program = program_in(source, parse_sketch(source))
    process = TorcsProcess(torcs_installation, Course("aalborg", laps=3))
    try:
        library = c_controller(program, tmp_path).library
        race = process.race(Conditions(), library, None, 2, beams=False)
    finally:
        process.close()
    figures = summary(race)
    assert outcome(figures) == "finished 3 laps" and figures.damage == 0
    assert figures.mean_lap == pytest.approx(158.87, rel=0.01)
    # 1.4 % above: the closed loop magnifies the rounding of the printed constants (see its file).
    assert figures.steering_deviation == pytest.approx(0.2483, rel=0.02)
    assert figures.largest_position == np.abs(race["trackPos"]).max()
    assert positions(race) == pytest.approx(race["trackPos"], abs=1e-12)
    # From one second before the start signal on, 50 commands a second.
    assert race["time"][0] == pytest.approx(-0.98, abs=0.03)
    assert figures.time == pytest.approx(sum(figures.laps), abs=0.03)
