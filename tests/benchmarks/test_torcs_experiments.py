"""The experiments in TORCS: who races, how races are measured, what is told."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.torcs import (
    environment,
    paper,
    performance,
    robustness,
    smoothness,
    synthesise,
    transfer,
)
from benchmarks.torcs.drivers import (
    PRINTED,
    CompiledProgram,
    Driver,
    Network,
    compiled,
    oracles,
    printed,
    read_program,
    robots,
    synthesised,
)
from benchmarks.torcs.racing import (
    UNTIL_CRASH,
    WHOLE,
    crashed,
    distance_on_road,
    distance_to_crash,
    race,
)
from pirlc.ir.policy import Environment
from pirlc.oracle.network import Bounded, NetworkOracle, Scaling
from pirlc.oracle.network import Network as Perceptron
from pirlc.simulation.torcs.installation import Installation
from pirlc.simulation.torcs.presets import Termination
from pirlc.simulation.torcs.protocol import Status
from pirlc.simulation.torcs.readings import READINGS
from pirlc.simulation.torcs.summary import summary
from tests.support.oracles import save_by_hand

INTO_THE_WALL = """policy astray
environment "pirlc/Torcs-v0"
sensor trackPos : [-1, 1] = 2
action steer : [-1, 1] = 0 * peek(trackPos, -1)
action accel : [0, 1] = 0.3
"""


def steady() -> NetworkOracle:
    """Steers to the middle of the road at a moderate speed."""
    weight = np.zeros((2, len(READINGS)), np.float32)
    weight[0, READINGS.index("angle")] = 4.0
    weight[0, READINGS.index("trackPos")] = -0.3
    weight[1, READINGS.index("speedX")] = -5.0
    bias = np.array([0.0, 1.3], np.float32)
    count = len(READINGS)
    scaling = Scaling(np.zeros(count, np.float32), np.ones(count, np.float32))
    head = Bounded((-1.0, 0.0), (1.0, 1.0), squashed=False)
    return NetworkOracle(Perceptron(scaling, (weight,), (bias,), "relu"), head)


def one_by_one(observations: NDArray[np.float64]) -> NDArray[np.float64]:
    """All at once they would be rounded otherwise."""
    return np.array([steady().act(observation) for observation in observations])


def save_steady(folder: Path) -> Path:
    place = Environment("pirlc/Torcs-v0", (("track", paper.G_TRACK_1),))
    return save_by_hand(steady(), place, 0.0, folder)


@pytest.fixture(scope="module")
def libraries(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("libraries")


@pytest.fixture(scope="module")
def subjects(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an oracle in it and, as if it were synthesised, a program."""
    folder = tmp_path_factory.mktemp("subjects")
    save_steady(folder / "oracles" / "steady")
    text = (PRINTED / "g-track-1.pirl").read_text(encoding="utf-8")
    (folder / "paper-g-track-1-0.pirl").write_text(text, encoding="utf-8")
    (folder / "racer-aalborg-2.pirl").write_text(text, encoding="utf-8")
    (folder / "racer-of-mine.pirl").write_text("of another kind", encoding="utf-8")
    return folder


def options(subjects: Path, to: Path) -> list[str]:
    places = ["--programs", str(subjects), "--oracles", str(subjects / "oracles")]
    return [*places, "--output", str(to), "--laps", "1"]


def wanderer(libraries: Path, tmp_path: Path) -> Driver:
    file = tmp_path / "astray.pirl"
    file.write_text(INTO_THE_WALL, encoding="utf-8")
    return Driver("astray", compiled(file, libraries))


def test_the_papers_lap_times_are_its_minutes_and_seconds() -> None:
    def seconds(minutes: int, rest: float) -> float:
        return round(60 * minutes + rest, 2)

    assert paper.PERFORMANCE["DRL", "aalborg"].time == seconds(1, 49.66)
    assert paper.PERFORMANCE["Naive", "g-track-1"].time == seconds(2, 7.09)
    assert paper.PERFORMANCE["NoIF", "g-track-1"].time == seconds(1, 1.60)
    assert paper.PERFORMANCE["NoIF", "aalborg"].time == seconds(2, 45.13)
    assert paper.PERFORMANCE["NDPS", "g-track-1"].time == seconds(1, 1.56)
    assert paper.PERFORMANCE["NDPS", "aalborg"].time == seconds(2, 38.87)
    times = {track: found.time for (who, track), found in laps_of_transfer().items()}
    assert times == {
        "g-track-2": seconds(1, 40.57),
        "eroad": seconds(1, 51.59),
        "alpine-2": seconds(3, 16.68),
        "ruudskogen": seconds(3, 19.77),
    }


def laps_of_transfer() -> dict[tuple[str, str], paper.Lap]:
    return {k: v for k, v in paper.TRANSFERRED.items() if isinstance(v, paper.Lap)}


def test_who_races_is_told_by_names_and_manifests(subjects: Path, libraries: Path) -> None:
    found = list(synthesised(subjects, libraries))
    assert [(d.name, d.trained_on, d.rival) for d in found] == [
        ("paper.pirl, g-track-1, seed 0", "g-track-1", "NDPS"),
        ("racer.pirl, aalborg, seed 2", "aalborg", None),
    ]
    (driver,) = oracles(subjects / "oracles")
    assert (driver.name, driver.trained_on) == ("oracle steady (written by hand)", "g-track-1")
    assert driver.rival == "DRL"
    assert driver.fits("g-track-1") and not driver.fits("aalborg")
    assert [d.trained_on for d in printed(libraries)] == ["g-track-1", "aalborg"]
    assert all(d.fits("aalborg") and not d.nodes for d in robots())


def test_a_program_knows_its_nodes_and_readings(libraries: Path) -> None:
    wheel = compiled(PRINTED / "aalborg.pirl", libraries)
    assert sum(wheel.nodes.values()) == read_program(PRINTED / "aalborg.pirl").size
    assert list(wheel.nodes) == ["steer", "accel"]
    assert wheel.reads == ("trackPos", "rpm")
    assert (wheel.components, wheel.beams) == (2, False)


def test_an_oracle_races_in_lock_step(torcs_installation: Installation) -> None:
    driver = Driver("steady", Network(steady()))
    trace = race(driver, "g-track-1", WHOLE, laps=1)
    assert trace.status is Status.FINISHED
    assert len(trace.laps) == 1
    np.testing.assert_array_equal(trace.actions[:, :2], one_by_one(trace.observations))
    assert not trace.actions[:, 2].any()
    assert summary(trace).mean_reward == trace.rewards.mean()


def test_a_holding_oracle_sees_the_last_good_reading(torcs_installation: Installation) -> None:
    blocking = replace(UNTIL_CRASH, blocked=("angle",), block_probability=0.5, most_steps=300)
    seen = {}
    for held in (False, True):
        trace = race(Driver("", Network(steady(), held)), "g-track-1", blocking)
        observations = trace.observations.copy()
        angles = observations[:, READINGS.index("angle")]
        assert 0.3 < np.isnan(angles).mean() < 0.7
        last = 0.0
        for step, angle in enumerate(angles):
            last = last if math.isnan(angle) else angle
            angles[step] = last if held else np.nan_to_num(angle)
        np.testing.assert_array_equal(trace.actions[:, :2], one_by_one(observations))
        seen[held] = trace.actions
    assert not np.array_equal(seen[False], seen[True])


def test_where_a_race_comes_to_harm(
    torcs_installation: Installation, libraries: Path, tmp_path: Path
) -> None:
    driver = wanderer(libraries, tmp_path)
    trace = race(driver, "g-track-1", UNTIL_CRASH)
    assert crashed(trace)
    on_road, to_crash = distance_on_road(trace), distance_to_crash(trace)
    assert 0 < on_road < to_crash <= trace["distance"][-1]
    assert trace["damage"][trace["distance"] < to_crash].max() == 0
    assert trace["damage"][trace["distance"] >= to_crash].min() > 0
    off_road = replace(UNTIL_CRASH, termination=Termination(off_track=1.0))
    short = race(driver, "g-track-1", off_road)
    assert short.status is Status.OFF_TRACK
    assert short["distance"][-1] == on_road


def test_blocked_races_are_the_same_for_any_number_of_workers(
    torcs_installation: Installation, libraries: Path, tmp_path: Path
) -> None:
    driver = next(printed(libraries))
    works = robustness.plan(driver, "g-track-1", "rpm,trackPos", (0.0, 0.9), 25, 1)
    assert [len(work.seeds) for work in works] == [1, 10, 10, 5]
    alone = robustness.points(works, 1, tmp_path / "alone.jsonl")
    assert alone == robustness.points(works, 2, tmp_path / "journal.jsonl")
    # Nothing is raced again: the journal is believed, also in what no race gives.
    lines = (tmp_path / "journal.jsonl").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 4
    lines[0] = json.dumps({**json.loads(lines[0]), "outcomes": [[1.0, 1.0, True]]})
    (tmp_path / "journal.jsonl").write_text("\n".join(lines) + "\n", encoding="utf-8")
    changed = robustness.points(works, 2, tmp_path / "journal.jsonl")[driver.name, "g-track-1"]
    assert changed[0.0].to_crash.mean == 1.0

    each = alone[driver.name, "g-track-1"]
    assert each[0.0].finished == 1.0 and each[0.0].to_crash.exact
    assert robustness.cell(each[0.0]) == "finished"
    blocked = each[0.9]
    assert blocked.to_crash.episodes == 25
    assert blocked.finished == 0.0
    assert 17 < blocked.to_crash.mean < 1_976
    assert blocked.to_crash.low < blocked.to_crash.mean < blocked.to_crash.high
    head, rows = robustness.rows_of_distances("g-track-1", {driver.name: each})
    assert head[1:] == ["0%", "90%"]
    assert rows[-2:] == [["the paper's DRL", "", "17"], ["the paper's NDPS", "", "200"]]


def test_own_sensors_are_blocked_for_programs(libraries: Path) -> None:
    driver = next(printed(libraries))
    assert robustness.blocked_for(driver, "own") == ("trackPos", "rpm")
    assert robustness.blocked_for(driver, "angle") == ("angle",)


@pytest.mark.slow
def test_performance_is_told_for_all_who_race(
    torcs_installation: Installation,
    subjects: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    performance.main(options(subjects, tmp_path))
    text = (tmp_path / "performance.md").read_text(encoding="utf-8")
    assert capsys.readouterr().out.strip() == text.strip()
    lines = text.splitlines()
    (drl,) = [line for line in lines if line.startswith("| oracle steady")]
    assert drl.endswith("| DRL | 54.27 | 118.39 |")
    assert sum(line.startswith("| robot ") for line in lines) == 8
    entries = json.loads((tmp_path / "performance.json").read_text(encoding="utf-8"))
    (program,) = [e for e in entries if e["driver"] == "paper.pirl, g-track-1, seed 0"]
    assert program["outcome"] == "finished 1 lap"
    assert program["nodes"] == {"steer": 25, "accel": 66}
    assert program["laps"] == [pytest.approx(62.094)]


def test_smoothness_is_told_and_drawn(
    torcs_installation: Installation, subjects: Path, tmp_path: Path
) -> None:
    smoothness.main(options(subjects, tmp_path))
    text = (tmp_path / "smoothness.md").read_text(encoding="utf-8")
    assert "| NDPS | 0.1312 |" in text and "| DRL | 0.5981 |" in text
    assert (tmp_path / "smoothness.png").read_bytes().startswith(b"\x89PNG")


def test_robustness_is_told_and_drawn(
    torcs_installation: Installation, subjects: Path, tmp_path: Path
) -> None:
    asked = ["--races", "2", "--probabilities", "0", "0.9", "--workers", "1", "--holding"]
    asked += ["--journal", str(tmp_path / "journal.jsonl")]
    robustness.main([*options(subjects, tmp_path), *asked, "--tracks", "g-track-1"])
    entries = json.loads((tmp_path / "robustness.json").read_text(encoding="utf-8"))
    assert {(e["probability"], e["races"]) for e in entries} == {(0.0, 1), (0.9, 2)}
    assert {e["driver"] for e in entries} == {
        "oracle steady (written by hand)",
        "oracle steady (written by hand), holding",
        "paper.pirl, g-track-1, seed 0",
        "printed in the paper: g-track-1",
    }
    assert (tmp_path / "robustness.png").read_bytes().startswith(b"\x89PNG")


def test_transfer_is_to_the_other_tracks(
    torcs_installation: Installation, subjects: Path, tmp_path: Path
) -> None:
    transfer.main(options(subjects, tmp_path))
    entries = json.loads((tmp_path / "transfer.json").read_text(encoding="utf-8"))
    raced = {(e["driver"], e["track"]) for e in entries}
    assert ("oracle steady (written by hand)", "eroad") in raced
    assert ("printed in the paper: aalborg", "ruudskogen") in raced
    assert {track for who, track in raced if who.startswith("racer")} == set(paper.TITLES)
    assert all(e["finished"] == (e["outcome"] == "finished 1 lap") for e in entries)
    text = (tmp_path / "transfer.md").read_text(encoding="utf-8")
    assert "crashed after 1,608 m" in text and "| NDPS | 199.77 | 57.69 |" in text


def test_nothing_grows_and_both_paths_are_the_same_race(
    torcs_installation: Installation, libraries: Path
) -> None:
    made = environment.torcs(laps=1)
    try:
        made.reset(seed=0)
        before, after = environment.grown(made, 30)
        assert after.descriptors == before.descriptors
        assert after.torcs_descriptors == before.torcs_descriptors
        assert after.processes == before.processes
        assert after.torcs - before.torcs < 1_000_000
        wheel = compiled(PRINTED / "aalborg.pirl", libraries)
        assert isinstance(wheel, CompiledProgram)
        same, steps = environment.same_race(made, PRINTED / "aalborg.pirl", wheel)
        assert same and steps > 5_000
        other = compiled(PRINTED / "g-track-1.pirl", libraries)
        same, steps = environment.same_race(made, PRINTED / "aalborg.pirl", other)
        assert not same and steps < 1_000
    finally:
        made.close()


def test_repeats_are_told_by_their_median() -> None:
    values = iter([100.0, 3.0, 1.0, 2.0])
    assert environment.repeated(lambda: next(values), 3) == environment.Measured(2.0, 1.0, 3.0)


SMALL = """policy small
environment "pirlc/Torcs-v0" { track = "aalborg", max_episode_steps = 200 }
sensor trackPos : [-1, 1] = 2
action steer : [-1, 1] = ?(k in [-1, 0]) * peek(trackPos, -1)
action accel : [0, 1] = 0.4
"""


def test_a_synthesis_is_run_once_and_recorded(
    torcs_installation: Installation, tmp_path: Path
) -> None:
    (tmp_path / "paper.pirl").write_text(SMALL, encoding="utf-8")
    places = [f"--{name}={tmp_path / name}" for name in ("runs", "output")]
    chosen = ["--sketch", "paper", "--track", "g-track-1", "--seed", "1", *places]
    options = ["--", "--no-oracle", "--budget", "40", "--episodes", "1", "--workers", "1"]
    synthesise.main([*chosen, "--sketches", str(tmp_path), *options])
    file = tmp_path / "output" / "paper-g-track-1-1.pirl"
    program = read_program(file)
    assert program.interface.environment is not None
    assert dict(program.interface.environment.arguments)["track"] == "g-track-1"
    (line,) = (tmp_path / "output" / "runs.jsonl").read_text(encoding="utf-8").splitlines()
    entry = json.loads(line)
    assert entry["name"] == "paper-g-track-1-1"
    assert entry["nodes"] == {"steer": 5, "accel": 1}
    assert entry["oracle"] is None
    assert entry["core_seconds"] > 0 and not entry["resumed"]

    stamp = (tmp_path / "runs" / "paper-g-track-1-1" / "manifest.json").stat().st_mtime_ns
    synthesise.main([*chosen, "--sketches", str(tmp_path), *options])
    again = (tmp_path / "runs" / "paper-g-track-1-1" / "manifest.json").stat().st_mtime_ns
    assert again == stamp
    assert json.loads((tmp_path / "output" / "runs.jsonl").read_text(encoding="utf-8")) == entry
