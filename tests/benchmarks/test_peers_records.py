"""Records of peers: made once, refused in words, told in tables."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.peers import dagger, linear
from benchmarks.peers.methods import SUITE, Effort, Job, jobs
from benchmarks.peers.running import perform, wanted
from benchmarks.peers.table import best_within, comparison, tables, verdict
from benchmarks.peers.tasks import EXAMPLES
from benchmarks.study.records import Record, Return, read

QUICK = Effort(
    dagger=dagger.Settings(iterations=1, episodes=2, samples=200, finalists=1),
    linear=linear.Settings(restarts=1, generations=2, population=4, episodes=2, finalists=1),
)


def test_a_row_is_run_once(tmp_path: Path) -> None:
    job = Job("cma-linear", "MountainCar-v0", 0)
    made, refused = perform([job], tmp_path, QUICK)
    assert [r.method for r in made] == ["cma-linear"]
    assert refused == []
    kept = read(tmp_path, SUITE)
    assert kept.records == tuple(made)
    assert not kept.left_out
    record = made[0]
    assert record.returns is not None
    assert (record.returns.episodes, record.returns.first_seed) == (1_000, 1_000_000)
    assert record.returns.low <= record.returns.mean <= record.returns.high
    assert record.size == 16
    assert record.core_seconds is not None
    assert record.core_seconds > 0
    assert record.provable is not None
    assert "goes_along" in record.provable
    assert record.provable.endswith("emitted C equal to it: proved")
    assert record.program is not None
    assert record.program.startswith("policy mountain_car\n")
    again, _ = perform([job], tmp_path, QUICK)
    assert again == []
    place = tmp_path / SUITE / record.name
    data = json.loads(place.read_text(encoding="utf-8"))
    place.write_text(json.dumps({**data, "schema": 0}), encoding="utf-8")
    remade, _ = perform([job], tmp_path, QUICK)
    assert [r.name for r in remade] == [record.name]


def test_the_command_of_a_row_asks_for_it_alone() -> None:
    for environment in EXAMPLES:
        for job in jobs(environment, 1):
            assert wanted([environment], [1], [job.name]) == [job]
            words = job.command
            assert words[:3] == ("python", "-m", "benchmarks.peers")
            assert words[3:] == (
                *("--method", job.name, "--environment", environment, "--seed", "1"),
            )


def test_methods_are_named_with_or_without_their_size() -> None:
    every = wanted(["MountainCar-v0"], [0], ["viper"])
    assert [job.name for job in every][:3] == ["viper-2", "viper-3", "viper-4"]
    assert len({job.name for job in jobs("MountainCar-v0", 0)}) == len(jobs("MountainCar-v0", 0))
    with pytest.raises(SystemExit) as refusal:
        wanted(["MountainCar-v0"], [0], ["vipre"])
    assert str(refusal.value) == "there is no method vipre; see docs/peers.md"


def test_methods_that_an_environment_does_not_have_are_refused(tmp_path: Path) -> None:
    asked = wanted(["CartPole-v1"], [0], ["cma-argmax"])
    made, refused = perform(asked, tmp_path, QUICK)
    assert made == []
    assert refused == ["cma-argmax is for three actions; CartPole-v1 has others"]
    assert [job.name for job in wanted(["Pendulum-v1"], [0], ["viper-8"])] == ["viper-8"]


@pytest.mark.slow
def test_two_at_a_time_write_what_one_does(tmp_path: Path) -> None:
    chosen = [Job("cma-linear", "MountainCar-v0", seed) for seed in (0, 1)]
    # Two processes that are started anew.
    perform(chosen, tmp_path / "two", QUICK, workers=2)
    perform(chosen, tmp_path / "one", QUICK)
    programs = [
        [record.program for record in read(tmp_path / name, SUITE).records]
        for name in ("one", "two")
    ]
    assert programs[0] == programs[1]
    assert len(programs[0]) == 2


def test_the_documented_refusal(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "docs" / "peers.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"```console\n\$ (.*--method viper-8 --env.*Pendulum.*)\n(.*)\n```", text)
    command, told = shown
    words = command.split()
    assert words[0] == "python"
    outcome = subprocess.run(
        [sys.executable, *words[1:], "--folder", str(tmp_path), "--seed", "7"],
        capture_output=True,
        text=True,
    )
    assert outcome.returncode == 1
    assert outcome.stderr.splitlines() == ["0 recorded, 1 to run", told]


def _record(method: str, seed: int, mean: float, size: int | None) -> Record:
    returns = Return(mean, mean - 0.5, mean + 0.5, 1_000, 1_000_000)
    return Record(
        *(SUITE, method, "MountainCar-v0", seed, ("python",)),
        returns=returns,
        size=size,
        core_seconds=2.0 + seed,
        provable="something",
    )


def test_tables_order_sizes_by_number_and_join_seeds() -> None:
    records = [_record("viper-16", 0, -99.0, 106), _record("viper-2", 1, -120.0, 8)]
    records += [_record("viper-2", 0, -119.0, 8), _record("onnx", 0, -98.0, None)]
    rows = tables(records).splitlines()[4:]
    assert [row.split(" | ")[0] for row in rows] == ["| onnx", "| viper-2", "| viper-16"]
    assert rows[1] == "| viper-2 | -119.00±0.50 -120.00±0.50 | 8 8 | 2.5 | - | - | something |"


def test_trees_are_compared_at_the_size_of_pirlcs_programs() -> None:
    records = [_record("viper-16", 0, -99.0, 106), _record("viper-2", 0, -120.0, 8)]
    records += [_record("dagger-tree-3", 0, -119.9, 15), _record("symbolic-12", 0, -90.0, 9)]
    assert best_within(records, "MountainCar-v0", 0, 50) == records[2]
    assert best_within(records, "MountainCar-v0", 0, 106) == records[0]
    assert best_within(records, "MountainCar-v0", 1, 50) is None
    ours = [_record("synth", 1, -98.0, 44), _record("synth", 0, -98.2, 44)]
    assert comparison(records, ours).splitlines()[2:] == [
        "| MountainCar-v0 | 0 | -98.20±0.50 | 44 | dagger-tree-3 | -119.90±0.50 | 15 "
        "| pirlc higher, intervals apart |",
        "| MountainCar-v0 | 1 | -98.00±0.50 | 44 | none so small | - | - | - |",
    ]
    assert comparison(records, []) == ""
    top, low = Return(500.0, 500.0, 500.0, 1_000, 0), Return(499.0, 498.5, 499.5, 1_000, 0)
    near = Return(499.4, 499.0, 499.8, 1_000, 0)
    assert [verdict(*pair) for pair in ((top, top), (low, top), (low, near), (top, low))] == [
        "both at the ceiling",
        "tree higher, intervals apart",
        "intervals overlap",
        "pirlc higher, intervals apart",
    ]


def test_the_command_prints_the_records(tmp_path: Path) -> None:
    perform([Job("cma-linear", "MountainCar-v0", 0)], tmp_path, QUICK)
    shown = subprocess.run(
        [*(sys.executable, "-m", "benchmarks.peers"), "--table", "--folder", str(tmp_path)],
        capture_output=True,
        text=True,
        check=True,
    )
    assert shown.stdout.startswith("### MountainCar-v0\n\n| method | return, seeds 0, 1, 2 |")
    assert "| cma-linear | -" in shown.stdout
