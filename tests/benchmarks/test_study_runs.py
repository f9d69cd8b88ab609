"""The study runs `pirlc` as a user would: real runs, small ones."""

from __future__ import annotations

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from benchmarks.study import classic
from benchmarks.study.__main__ import jobs_of, main, parser
from benchmarks.study.classic import constants, sketch_file
from benchmarks.study.driver import missing
from benchmarks.study.pages import DOCUMENT
from benchmarks.study.records import ROOT, Record, held, read
from benchmarks.study.rows import CLASSIC, CLASSIC_PLACES, PLACES, ROWS, TORCS, place
from benchmarks.study.running import Children, Failed, Run, finished_manifest, synthesise
from pirlc.ir.printer import program_text

PLACE = "MountainCar-v0"


def words(folder: Path, *more: str, rows: tuple[str, ...] = ("Naive",)) -> list[str]:
    where = ["--folder", str(folder / "runs"), "--results", str(folder / "results")]
    small = ["--seed", "0", "--episodes", "3", "--environment", PLACE]
    return ["--row", *rows, *small, *where, "--", *more]


def study(folder: Path, *more: str) -> subprocess.Popen[str]:
    """In a process of its own, as a shell starts it in the background: SIGINT is ignored."""
    command = [sys.executable, "-m", "benchmarks.study", *words(folder, *more)]
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        return subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True)
    finally:
        signal.signal(signal.SIGINT, before)


def journal(folder: Path) -> Path:
    return folder / "runs" / CLASSIC / f"Naive-{PLACE}-0" / "journal.jsonl"


def wait_for(found: object, seconds: float = 120.0) -> None:
    assert callable(found)
    end = time.monotonic() + seconds
    while not found():
        assert time.monotonic() < end
        time.sleep(0.05)


def lines(path: Path) -> int:
    return path.read_bytes().count(b"\n") if path.exists() else 0


def child_of(pid: int) -> int | None:
    """The one process that another has started."""
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rpartition(") ")[2].split()
            except OSError:
                continue
            if int(fields[1]) == pid:
                return int(entry.name)
    return None


def test_rows_are_run_once_and_one_that_fails_stops_no_other(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    small = ("--pool", "1", "--budget", "4")
    assert main(words(tmp_path, *small, rows=("Naive", "minimum"))) == 0
    told = capfd.readouterr().err
    assert f"minimum-{PLACE}-0: -200.00, 1 nodes\n" in told
    assert re.search(rf"Naive-{PLACE}-0: timeout, \d+ core s\n", told)
    assert "classic: 2 rows run, 0 known, 0 failed\n" in told
    lowest, naive = sorted(
        read(tmp_path / "results", CLASSIC).records, key=lambda r: r.method, reverse=True
    )
    assert (naive.ending, naive.returns, naive.program) == ("timeout", None, None)
    assert naive.core_seconds is not None
    assert 0 < naive.core_seconds < 60
    assert naive.command == (
        *("pirlc", "synth", "examples/mountain_car/mountain_car.pirl"),
        *("-o", str(tmp_path / "runs" / CLASSIC / f"Naive-{PLACE}-0"), "--no-oracle"),
        *(
            "--pool",
            "24",
            "--no-refine",
            *small,
            "--seed",
            "0",
            "--workers",
            "1",
            "--episodes",
            "3",
        ),
    )
    assert lowest.returns is not None
    assert (lowest.returns.mean, lowest.returns.episodes) == (-200.0, 3)

    # Again, with the same options: nothing is run.
    log = tmp_path / "runs" / CLASSIC / f"Naive-{PLACE}-0.log"
    before = log.stat().st_mtime_ns
    assert main(words(tmp_path, *small, rows=("Naive", "minimum"))) == 0
    assert "classic: 0 rows run, 2 known, 0 failed\n" in capfd.readouterr().err
    assert log.stat().st_mtime_ns == before

    # With other options into the same folder: pirlc refuses, in its own words.
    assert main(words(tmp_path, "--max-size", "2", rows=("Naive", "minimum"))) == 1
    told = capfd.readouterr().err
    assert f"Naive-{PLACE}-0: failed\npirlc synth examples/mountain_car" in told
    assert "ended with 1:\n  error[E0726]: the sketch allows no program of at most 2 nodes" in told
    assert "classic: 0 rows run, 1 known, 1 failed\n" in told
    assert told.endswith(
        f"failed, for the reasons above; the same command tries again:\n  Naive-{PLACE}-0\n"
    )
    # The record of before stands.
    assert len(read(tmp_path / "results", CLASSIC).records) == 2
    assert main(words(tmp_path, "--pool", "2", "--budget", "4")) == 1
    told = capfd.readouterr().err
    assert "error[E0723]: the output folder" in told
    assert "differs in: settings" in told


def test_a_folder_that_another_study_holds_is_refused(tmp_path: Path) -> None:
    with held(tmp_path / "runs" / CLASSIC), pytest.raises(SystemExit) as refused:
        main(words(tmp_path))
    assert re.fullmatch(
        rf"{tmp_path}/runs/classic: process {os.getpid()} \(.*\) is writing into this folder; "
        "wait for it to end, or write into another folder",
        str(refused.value.code),
    )


def test_names_that_are_not_known() -> None:
    known = "DRL, Naive, NoAug, NoSketch, NoIF, NDPS"
    for given, message in (
        (["--row", "Magic"], "there is no row `Magic` in suite torcs: " + known),
        (
            ["--environment", "Pong"],
            "there is no environment `Pong` in suite torcs: g-track-1, aalborg",
        ),
    ):
        with pytest.raises(SystemExit) as refused:
            main(["--suite", "torcs", *given, "--list"])
        assert refused.value.code == message
    with pytest.raises(SystemExit):
        main(["--suite", "chess"])
    with pytest.raises(SystemExit, match="--episodes: at least 2"):
        main(["--episodes", "1"])


def test_what_would_be_run(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list", "--suite", "torcs", "--seed", "0", "1", "--row", "DRL", "NoAug"]) == 0
    assert capsys.readouterr().out == (
        "torcs  DRL-g-track-1-0  -\n"
        "torcs  DRL-aalborg-0  -\n"
        "torcs  NoAug-g-track-1-0  --optimizer casadi --no-augment --budget 4000\n"
        "torcs  NoAug-aalborg-0  --optimizer casadi --no-augment --budget 4000\n"
        "torcs  NoAug-g-track-1-1  --optimizer casadi --no-augment --budget 4000\n"
        "torcs  NoAug-aalborg-1  --optimizer casadi --no-augment --budget 4000\n"
    )
    assert main(["--list", "--row", "DRL", "minimum", "--environment", "Pendulum-v1"]) == 0
    assert capsys.readouterr().out.split() == [
        *("classic", "DRL-Pendulum-v1-0", "-", "classic", "DRL-Pendulum-v1-1", "-"),
        *("classic", "DRL-Pendulum-v1-2", "-", "classic", "minimum-Pendulum-v1-0", "-"),
    ]


def test_commands_of_the_document_are_understood(capsys: pytest.CaptureFixture[str]) -> None:
    commands = re.findall(r"python -m benchmarks\.study([^#`\n]*)", DOCUMENT.read_text("utf-8"))
    assert len(commands) >= 4
    for command in commands:
        assert main([*shlex.split(command), "--list"]) == 0
        assert capsys.readouterr().out


def test_the_documented_options_are_those_of_the_rows() -> None:
    document = DOCUMENT.read_text("utf-8")
    for row in ROWS[CLASSIC]:
        if isinstance(row, classic.Synthesis) and row.usual and row.options:
            assert f"| {row.method} | `{' '.join(row.options)}` |" in document


def test_the_sketch_of_another_environment(tmp_path: Path) -> None:
    source = ROOT / "examples" / "cartpole" / "cartpole.pirl"
    assert sketch_file(place("CartPole-v1"), tmp_path) == source
    made = sketch_file(place("CartPole-v0"), tmp_path)
    assert made == tmp_path / "sketches" / "CartPole-v0.pirl"
    text = made.read_text("utf-8")
    assert text == source.read_text("utf-8").replace('"CartPole-v1"', '"CartPole-v0"')
    assert 'environment "CartPole-v0"' in text


def test_constant_actions(tmp_path: Path) -> None:
    last = {
        each.name: [program_text(p).splitlines()[-1] for p in constants(each, tmp_path)]
        for each in CLASSIC_PLACES
    }
    assert last["Acrobot-v1"] == ["action Torque : {0, 2} = 0", "action Torque : {0, 2} = 2"]
    assert last["Pendulum-v1"] == [
        f"action Torque : [-2, 2] safe 0 = {value}" for value in ("-2", "0", "2")
    ]


def test_a_record_made_otherwise_is_made_again(tmp_path: Path) -> None:
    chosen = parser().parse_args(words(tmp_path, "--pool", "3"))
    (job,) = jobs_of(CLASSIC, chosen)
    made = Record(CLASSIC, "Naive", PLACE, 0, ("pirlc",), figures={"asked": job.asked})
    assert missing([job], [made]) == []
    assert missing([job], []) == [job]
    (other,) = jobs_of(CLASSIC, parser().parse_args(words(tmp_path, "--pool", "4")))
    assert missing([other], [made]) == [other]
    assert job.asked["options"] == ["--no-oracle", "--pool", "24", "--no-refine", "--pool", "3"]


def test_rows_have_names_of_their_own() -> None:
    for suite in (CLASSIC, TORCS):
        assert len({row.method for row in ROWS[suite]}) == len(ROWS[suite])
        assert all((ROOT / each.sketch).is_file() for each in PLACES[suite])


def test_a_run_folder_of_another_version(tmp_path: Path) -> None:
    run = Run(ROOT / "examples" / "cartpole.pirl", tmp_path / "run", ())
    run.folder.mkdir()
    manifest = {"state": "finished", "versions": {"pirlc": "0.0.1"}}
    (run.folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    assert finished_manifest(run.folder) == manifest
    notes = {"asked": run.asked, "sessions": [{"core": 1.0, "wall": 2.0, "code": 0}]}
    (tmp_path / "run.took.json").write_text(json.dumps(notes), encoding="utf-8")
    with pytest.raises(Failed, match=r"was made by pirlc 0\.0\.1; this is pirlc .*Remove that"):
        synthesise(run, Children())


def test_damaged_notes_are_no_notes(tmp_path: Path) -> None:
    run = Run(ROOT / "examples" / "cartpole.pirl", tmp_path / "run", ("--max-size", "2"))
    for text in ("{", "[]", '{"asked": 1, "sessions": []}', '{"sessions": [{"core": 1}]}'):
        (tmp_path / "run.took.json").write_text(text, encoding="utf-8")
    with pytest.raises(Failed, match="E0726"):
        synthesise(run, Children())


@pytest.mark.slow
def test_a_worker_that_dies_is_told_and_its_run_goes_on(tmp_path: Path) -> None:
    limit = ("--budget", "60")
    running = study(tmp_path, *limit)
    wait_for(lambda: lines(journal(tmp_path)) > 10)
    child = child_of(running.pid)
    assert child is not None
    os.kill(child, signal.SIGKILL)
    _, told = running.communicate(timeout=60)
    assert running.returncode == 1
    assert f"Naive-{PLACE}-0: failed\n" in told
    assert "was ended by SIGKILL:\n  (it said nothing)\n" in told
    assert read(tmp_path / "results", CLASSIC).records == ()
    before = lines(journal(tmp_path))
    assert main(words(tmp_path, *limit)) == 0
    (made,) = read(tmp_path / "results", CLASSIC).records
    assert made.figures["resumed"]
    assert made.returns is not None
    assert lines(journal(tmp_path)) > before


@pytest.mark.slow
def test_an_interrupted_study_goes_on(tmp_path: Path) -> None:
    limit = ("--budget", "60")
    running = study(tmp_path, *limit)
    wait_for(lambda: lines(journal(tmp_path)) > 10)
    with pytest.raises(SystemExit) as refused:
        main(words(tmp_path, *limit))
    assert f"process {running.pid} " in str(refused.value.code)
    running.send_signal(signal.SIGINT)
    _, told = running.communicate(timeout=120)
    assert running.returncode == 130
    assert "interrupted; the same command goes on from here\n" in told
    assert "Traceback" not in told
    notes = json.loads((tmp_path / "runs" / CLASSIC / f"Naive-{PLACE}-0.took.json").read_text())
    assert [session["code"] for session in notes["sessions"]] == [130]
    known = lines(journal(tmp_path))
    assert main(words(tmp_path, *limit)) == 0
    (made,) = read(tmp_path / "results", CLASSIC).records
    assert made.figures["resumed"]
    assert lines(journal(tmp_path)) > known


@pytest.mark.slow
def test_what_a_killed_study_has_started_still_holds_the_folder(tmp_path: Path) -> None:
    running = study(tmp_path)
    wait_for(lambda: lines(journal(tmp_path)) > 2)
    child = child_of(running.pid)
    assert child is not None
    running.kill()
    running.communicate()
    try:
        with pytest.raises(SystemExit, match="is writing into this folder"):
            main(words(tmp_path))
    finally:
        os.kill(child, signal.SIGKILL)
    place_of_runs = tmp_path / "runs" / CLASSIC

    def free() -> bool:
        try:
            with held(place_of_runs):
                return True
        except SystemExit:
            return False

    wait_for(free, 20)
