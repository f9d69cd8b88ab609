"""`pirlc torcs install` and `doctor`: caches that are made, found, damaged, waited for."""

from __future__ import annotations

import fcntl
import json
import resource
import shutil
import signal
import subprocess
import sys
import time
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from pirlc import resources
from pirlc.diagnostics import render
from pirlc.simulation.torcs import installation_problems as problems
from pirlc.simulation.torcs import trial
from pirlc.simulation.torcs.doctor import examine
from pirlc.simulation.torcs.install import Stage, install
from pirlc.simulation.torcs.installation import (
    RECORD,
    Installation,
    Places,
    Record,
    find_torcs,
    installed,
    places,
    ready,
    tree_of,
)
from tests.support.processes import started
from tests.support.refusals import refused

ROOT = Path(__file__).parents[3]


SAMPLES = [
    (
        problems.PackagesMissing(("torcs", "g++"), ("CXX names `icc`, which cannot be run",)),
        "error[E0520]: TORCS needs packages that are not installed: `torcs`, `g++`\n"
        "  = note: CXX names `icc`, which cannot be run\n"
        "  = help: on Debian and Ubuntu: `sudo apt-get install torcs g++`, then "
        "`pirlc torcs install`",
    ),
    (
        problems.SourceUnavailable("1.3.7", ("apt says: no way",)),
        "error[E0521]: the source package of TORCS 1.3.7, which has its headers, cannot be "
        "fetched\n"
        "  = note: apt says: no way\n"
        "  = help: fetch it where that works (`apt-get source --download-only torcs`), and name "
        "the `.orig.tar` file here: `pirlc torcs install --source FILE`",
    ),
    (
        problems.BadSource("x.tar", "there is no such file or folder"),
        "error[E0522]: x.tar does not hold TORCS's headers: there is no such file or folder\n"
        "  = help: the file is called like `torcs_1.3.7+dfsg.orig.tar.xz`; the folder that it "
        "unpacks to will do as well",
    ),
    (
        problems.HostNotBuilt("g++", ("a.cpp:1:1: error: no",)),
        "error[E0523]: `g++` cannot build the robot that races for pirlc\n"
        "  = note: a.cpp:1:1: error: no\n"
        "  = help: name another C++ compiler in the environment variable CXX",
    ),
    (
        problems.NotPrepared("there is nothing in /c"),
        "error[E0524]: TORCS is not ready for races\n"
        "  = note: there is nothing in /c\n"
        "  = help: run `pirlc torcs install`",
    ),
    (
        problems.Unfit("the start signal does not come"),
        "error[E0525]: this TORCS does not race as it should\n"
        "  = note: the start signal does not come\n"
        "  = help: `pirlc torcs doctor` tells what else is wrong; pirlc is made for Debian's "
        "packages `torcs` and `torcs-data`",
    ),
    (
        problems.CacheUnusable("/c", "no space left on device"),
        "error[E0526]: TORCS cannot be prepared in /c: no space left on device\n"
        "  = help: make room or give the permission, or name another folder for caches in the "
        "environment variable XDG_CACHE_HOME",
    ),
]


@pytest.mark.parametrize(("problem", "text"), SAMPLES, ids=lambda s: type(s).__name__)
def test_messages(problem, text) -> None:
    diagnostic = problems.describe(problem)
    assert render(diagnostic) == text
    page = resources.explanations() / f"{diagnostic.code}.md"
    assert page.read_text(encoding="utf-8").startswith(f"# {diagnostic.code}: ")


def test_every_problem_has_a_sample() -> None:
    assert {type(problem) for problem, _ in SAMPLES} == set(problems.Problem.__args__)


# Packages.


@pytest.fixture
def nowhere(tmp_path: Path) -> Places:
    return Places((tmp_path,), (tmp_path,), (tmp_path,))


def test_missing_packages_are_named_in_one_line(nowhere, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("CXX", str(tmp_path / "cxx -O"))
    message = refused(lambda: install(tmp_path / "cache", where=nowhere))
    assert message.startswith("error[E0520]: ")
    assert f"  = note: CXX names `{tmp_path}/cxx -O`, which cannot be run\n" in message
    assert "`sudo apt-get install torcs libplib-dev g++`" in message
    assert not (tmp_path / "cache").exists()
    assert refused(lambda: installed(tmp_path / "cache", nowhere)).startswith("error[E0520]: ")


def test_the_doctor_of_a_bare_machine(nowhere, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CXX", raising=False)
    checks = {check.name: check for check in examine(tmp_path / "cache", nowhere)}
    assert not any(check.ok for check in checks.values())
    assert checks["TORCS"].advice == "`sudo apt-get install torcs`"
    assert checks["plib"].advice == "`sudo apt-get install libplib-dev`"
    assert checks["compiler"].advice == "`sudo apt-get install g++`"
    assert checks["tracks"].found.startswith("not tried")


# A cache.


@pytest.fixture(scope="module")
def cache(torcs_installation: Installation, tmp_path_factory) -> Path:
    """A cache of its own, prepared from the headers of the user's."""
    folder: Path = tmp_path_factory.mktemp("cache") / "pirlc" / "torcs"
    stages: list[Stage] = []
    prepared = install(folder, torcs_installation.headers, lambda stage, _: stages.append(stage))
    assert prepared.changed
    assert list(dict.fromkeys(stages)) == [Stage.UNPACKING, Stage.BUILDING, Stage.RACING]
    assert prepared.record.control_interval == 0.02
    assert prepared.record.tracks.keys() == set(trial.TRACKS)
    assert round(prepared.record.tracks["aalborg"]) == 2588
    return folder


@pytest.fixture
def copy(cache: Path, tmp_path: Path) -> Path:
    """A copy to damage."""
    folder = tmp_path / "pirlc" / "torcs"
    shutil.copytree(cache, folder, symlinks=True)
    assert isinstance(_state(folder), Record)
    return folder


def _state(folder: Path) -> Record | problems.NotPrepared:
    torcs = find_torcs(places())
    assert torcs is not None
    return ready(torcs, folder)


def test_a_second_call_does_nothing(cache) -> None:
    before = {path: path.lstat().st_mtime_ns for path in cache.rglob("*")}
    begun = time.perf_counter()
    again = install(cache, tell=lambda stage, _: pytest.fail(f"{stage} is not needed"))
    assert time.perf_counter() - begun < 0.5
    assert not again.changed
    assert {path: path.lstat().st_mtime_ns for path in cache.rglob("*")} == before
    assert not list(cache.glob("draft-*"))


def test_it_is_used_where_it_is(cache) -> None:
    found = installed(cache)
    assert found.tree == tree_of(cache)
    assert {"berniw", "bt", "inferno", "olethros", "pirlc"} <= {
        driver.name for driver in (found.tree / "drivers").iterdir()
    }
    assert found.tracks["aalborg"] == "road"
    assert "car1-trb1" in found.cars
    assert trial.control_interval(found) == 0.02
    begun = time.perf_counter()
    for _ in range(10):
        installed(cache)
    assert time.perf_counter() - begun < 0.5


def test_a_half_built_cache_is_recognised(copy) -> None:
    tree = tree_of(copy)
    text = (tree / RECORD).read_text()
    words = f"what is in {tree} is not complete"
    for size in (0, 1, len(text) // 2, len(text) - 3):
        (tree / RECORD).write_text(text[:size])
        assert _state(copy) == problems.NotPrepared(words)
    for content in ("[]", "null", '{"format": 1}', text.replace('"format": 1', '"format": 2')):
        (tree / RECORD).write_text(content)
        assert _state(copy) == problems.NotPrepared(words)
    (tree / RECORD).write_text(text)
    assert isinstance(_state(copy), Record)
    (tree / "drivers" / "pirlc" / "pirlc.so").unlink()
    assert _state(copy) == problems.NotPrepared(words)
    message = refused(lambda: installed(copy))
    assert message.startswith("error[E0524]: TORCS is not ready for races\n")
    assert "run `pirlc torcs install`" in message


def test_other_versions_are_recognised(copy) -> None:
    tree = tree_of(copy)
    content = json.loads((tree / RECORD).read_text())
    changed = {**content, "version": "1.3.6", "torcs": [*content["torcs"][:2], 1]}
    (tree / RECORD).write_text(json.dumps(changed))
    assert _state(copy) == problems.NotPrepared(
        "it was prepared for TORCS 1.3.6; another is installed by now"
    )
    tree.rename(tree.with_name("0123456789abcdef"))
    assert _state(copy) == problems.NotPrepared("it was prepared by another version of pirlc")
    shutil.rmtree(copy)
    assert _state(copy) == problems.NotPrepared(f"there is nothing in {copy}")


def test_a_half_built_cache_is_repaired(copy, torcs_installation) -> None:
    """What is left of it is used, and what attempts that were killed have left goes."""
    (tree_of(copy) / RECORD).unlink()
    (copy / "draft-killed").mkdir()
    (copy / "draft-killed" / "torcs_1.orig.tar.xz").write_bytes(b"half")
    checks = {check.name: check for check in examine(copy)}
    assert [name for name, check in checks.items() if not check.ok] == [
        "host robot", "control interval", "tracks",
    ]  # fmt: skip
    assert checks["host robot"].advice == "run `pirlc torcs install`"
    stages: list[Stage] = []
    prepared = install(copy, tell=lambda stage, _: stages.append(stage))
    assert prepared.changed
    assert set(stages) == {Stage.BUILDING, Stage.RACING}
    assert {path.name for path in copy.iterdir()} == {"headers", "hosts", "lock"}
    checked = examine(copy)
    assert all(check.ok for check in checked), checked
    assert [check.name for check in checked] == [
        *("TORCS", "plib", "compiler", "headers", "host robot", "control interval", "tracks"),
    ]


def _command_line(folder: Path) -> AbstractContextManager[subprocess.Popen[str]]:
    """`pirlc torcs install` with a cache at `folder`."""
    home = folder.parents[1]
    environment = {"XDG_CACHE_HOME": str(home)}
    return started("-m", "pirlc", "torcs", "install", cwd=home, env=environment)


def test_the_second_of_two_at_once_waits(copy) -> None:
    record = tree_of(copy) / RECORD
    text = record.read_text()
    record.unlink()
    with (copy / "lock").open("ab") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with _command_line(copy) as second:
            assert second.stderr is not None
            assert second.stderr.readline() == "waiting for another `pirlc torcs install`\n"
            record.write_text(text)
            assert second.poll() is None
            lock.close()
            out, err = second.communicate(timeout=60)
    assert (second.returncode, err) == (0, "")
    assert out.splitlines()[-1] == f"nothing to do: prepared before, in {copy}"


def test_waiting_can_be_interrupted(copy) -> None:
    (tree_of(copy) / RECORD).unlink()
    with (copy / "lock").open("ab") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with _command_line(copy) as second:
            assert second.stderr is not None
            second.stderr.readline()
            second.send_signal(signal.SIGINT)
            _, err = second.communicate(timeout=60)
    assert (second.returncode, err.strip()) == (130, "interrupted")


def test_a_folder_that_cannot_be_written(torcs_installation, tmp_path) -> None:
    file = tmp_path / "file"
    file.write_text("mine")
    for folder in (file, file / "pirlc" / "torcs"):
        message = refused(lambda folder=folder: install(folder, torcs_installation.headers))
        assert message.startswith("error[E0526]: TORCS cannot be prepared in ")
        assert "XDG_CACHE_HOME" in message
    assert file.read_text() == "mine"


def test_a_full_disk(torcs_installation, tmp_path) -> None:
    """A limit on the size of files stands in for it: writing fails in the middle."""
    code = (
        "import sys; from pathlib import Path; from pirlc.diagnostics import PirlcError\n"
        "from pirlc.simulation.torcs.install import install\n"
        "try:\n    install(Path(sys.argv[1]), Path(sys.argv[2]))\n"
        "except PirlcError as error:\n    print(error)\n"
    )
    limit = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))  # noqa: E731
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "c"), str(torcs_installation.headers)],
        cwd=ROOT,
        preexec_fn=limit,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stderr == ""
    assert done.stdout.startswith("E0526: TORCS cannot be prepared in ")
    assert "file too large" in done.stdout
    assert {path.name for path in (tmp_path / "c").iterdir()} == {"lock"}


def test_a_source_that_is_none(torcs_installation, tmp_path) -> None:
    missing = tmp_path / "torcs.tar.xz"
    message = refused(lambda: install(tmp_path / "c", missing))
    assert message.startswith(f"error[E0522]: {missing} does not hold TORCS's headers: there is no")
    (tmp_path / "empty").mkdir()
    message = refused(lambda: install(tmp_path / "c", tmp_path / "empty"))
    assert "a robot needs more than there is" in message
    assert {path.name for path in (tmp_path / "c").iterdir()} == {"lock"}
