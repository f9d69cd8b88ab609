"""A synthesis in TORCS, in small: programs race natively, and one race tells all."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pirlc.frontend import parse_sketch
from pirlc.ir.expansion import close
from pirlc.pipeline import SynthesisResult, synthesize
from pirlc.report.request import SynthesisRequest
from pirlc.search.settings import Settings, default_settings
from pirlc.simulation.workers import ALONE, Workers
from pirlc.source import SourceText
from pirlc.tune.how import Optimizer

pytestmark = pytest.mark.usefixtures("torcs_installation")

SKETCH = """policy driver
environment "pirlc/Torcs-v0" { track = "g-track-1", laps = 1, reward = "progress" }
sensor angle    : [-1, 1] = 1
sensor trackPos : [-1, 1] = 2
sensor speed    : [-1, 1] = 0
window 2
action steer : [-1, 1] safe 0 = ?(a in [0, 20] = 5) * peek(angle, -1) - Place
action accel : [0, 1] safe 0 = ?(k in [0, 10] = 3) * (?(v in [0, 1] = 0.2) - peek(speed, -1))
rule Place = 0 | ?(p in [0, 2] = 0.3) * peek(trackPos, -1)
"""

SMALL = Settings(
    largest=60,
    create_episodes=1,
    histories=300,
    pool=2,
    neighbours=1,
    iterations=1,
    simulated=2,
    episodes=2,
    refined=1,
    refine_episodes=30,
    climb_episodes=1,
    optimizer=Optimizer.CASADI,
)


@pytest.fixture
def asked(tmp_path: Path) -> SynthesisRequest:
    return SynthesisRequest(
        source=SourceText("driver.pirl", SKETCH),
        folder=tmp_path / "run",
        cache=tmp_path / "cache",
        oracle=None,
        settings=SMALL,
        workers=Workers(2),
        arguments=(("max_episode_steps", 250),),
    )


def run(asked: SynthesisRequest) -> SynthesisResult:
    return synthesize(asked, lambda _: None, lambda _: None)


def test_one_race_tells_all(asked: SynthesisRequest) -> None:
    result = run(asked)
    assert all(found.exact for found in result.returns.values())
    assert result.returns["program"] == result.returns["emitted C"]
    assert result.returns["program"].mean > 20.0
    lines = (asked.folder / "candidates.jsonl").read_text().splitlines()
    met = [json.loads(line) for line in lines]
    assert {entry["episodes"] for entry in met if entry["mean_return"] is not None} == {1}
    # What is simulated twice is not simulated again: every key of the journal is there once.
    journal = [json.loads(s) for s in (asked.folder / "journal.jsonl").read_text().splitlines()]
    returns = [entry for entry in journal if entry["key"].startswith("returns:")]
    assert all(len(entry["result"]) == 1 for entry in returns)
    text = result.program_file.read_text()
    written = close(parse_sketch(SourceText("p", text)))
    assert written == result.program
    assert 'track = "g-track-1"' in text
    assert "max_episode_steps = 250" in text


def test_workers_change_nothing_and_runs_resume(asked: SynthesisRequest) -> None:
    two = run(asked)
    before = (asked.folder / "journal.jsonl").read_bytes()
    assert run(asked).program_file.read_bytes() == two.program_file.read_bytes()
    assert (asked.folder / "journal.jsonl").read_bytes() == before
    alone = run(replace(asked, workers=ALONE, folder=asked.folder.parent / "alone"))
    assert alone.program_file.read_bytes() == two.program_file.read_bytes()


@pytest.mark.slow
def test_where_chance_plays_a_part_episodes_differ(asked: SynthesisRequest) -> None:
    noisy = replace(asked, arguments=(*asked.arguments, ("noise", 0.05)), episodes=3)
    result = run(noisy)
    assert {found.episodes for found in result.returns.values()} == {3}
    assert result.returns["program"] == result.returns["emitted C"]
    assert result.returns["program"].std > 0.0
    assert np.isfinite(result.returns["program"].low)


def test_settings_suit_the_environment() -> None:
    assert default_settings() == Settings()
    assert default_settings(actions=3).largest == 180
    assert default_settings(native=True).refine_episodes < Settings().refine_episodes / 10
