"""Finding a compiler, building and keeping libraries, and what is said where that fails."""

from __future__ import annotations

import os
import pickle
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from pirlc.backend.emit import emit, write
from pirlc.backend.policies import c_controller, c_policy, python_controller
from pirlc.backend.toolchain import FLAGS, Compiler, build, compile_controller, find_compiler, load
from pirlc.diagnostics import Diagnostic, PirlcError
from pirlc.lower import lower
from tests.backend.helpers import COMPILERS, load_program

pytestmark = pytest.mark.skipif(not COMPILERS, reason="no gcc and no clang on this machine")


def diagnostic(caught: pytest.ExceptionInfo[PirlcError]) -> Diagnostic:
    (only,) = caught.value.diagnostics
    return only


def script(place: Path, text: str) -> Path:
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text("#!/bin/sh\n" + text)
    place.chmod(place.stat().st_mode | stat.S_IXUSR)
    return place


def test_the_compiler_that_cc_names(monkeypatch, tmp_path):
    named = script(tmp_path / "my-cc", f'exec {COMPILERS[0]} "$@"\n')
    monkeypatch.setenv("CC", f"{named} -g")
    assert find_compiler().command == (str(named), "-g")
    made = compile_controller(lower(load_program("cartpole")), tmp_path / "cache")
    assert made.step([0.0, 0.0, 0.1, 0.0]) == ((1,), 0)


def test_cc_names_nothing(monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(PirlcError) as caught:
        find_compiler()
    assert (diagnostic(caught).code, diagnostic(caught).message) == (
        "E0804",
        "the C compiler that CC names cannot be run: no-such-compiler",
    )


def test_no_compiler_at_all(monkeypatch, tmp_path):
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    if subprocess.run([sys.executable, "-c", "import ziglang"], capture_output=True).returncode:
        with pytest.raises(PirlcError) as caught:
            find_compiler()
        assert (diagnostic(caught).code, diagnostic(caught).message) == (
            "E0803",
            "no C compiler was found",
        )
        assert "pip install 'pirlc[cc]'" in diagnostic(caught).help
    else:
        assert find_compiler().command[1:] == ("-m", "ziglang", "cc")


def test_the_first_that_there_is(monkeypatch, tmp_path):
    monkeypatch.delenv("CC", raising=False)
    clang = script(tmp_path / "clang", "echo some clang\n")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert find_compiler() == Compiler((str(clang),), "some clang\n")


def test_a_compiler_that_refuses(monkeypatch, tmp_path):
    monkeypatch.setenv("CC", f"{COMPILERS[0]} -ffast-math")
    with pytest.raises(PirlcError) as caught:
        c_policy(load_program("cartpole"), tmp_path)
    found = diagnostic(caught)
    assert (found.code, found.message) == (
        "E0805",
        f"the C compiler {COMPILERS[0]} -ffast-math refused the emitted code",
    )
    assert any("#error" in note for note in found.notes)
    assert str(tmp_path) not in "\n".join(found.notes)


def test_a_compiler_for_another_machine(tmp_path):
    other = script(tmp_path / "cc", 'while [ "$1" != -o ]; do shift; done; echo no > "$2"\n')
    with pytest.raises(PirlcError) as caught:
        compile_controller(
            lower(load_program("cartpole")),
            tmp_path / "cache",
            "double",
            Compiler((str(other),), ""),
        )
    assert (diagnostic(caught).code, diagnostic(caught).message) == (
        "E0806",
        "the compiled controller cannot be loaded",
    )


def test_a_library_is_built_once(tmp_path):
    count = tmp_path / "count"
    counting = script(tmp_path / "cc", f'echo once >> {count}; exec {COMPILERS[0]} "$@"\n')
    compiler = Compiler((str(counting),), "1")
    controller = lower(load_program("cartpole"))
    first = build(controller, tmp_path / "cache", "double", compiler)
    assert build(controller, tmp_path / "cache", "double", compiler) == first
    assert count.read_text() == "once\n"
    others = {
        build(controller, tmp_path / "cache", "float", compiler),
        build(controller, tmp_path / "cache", "double", compiler, (*FLAGS, "-g")),
        build(lower(load_program("two_actions")), tmp_path / "cache", "double", compiler),
    }
    assert len(others | {first}) == 4
    left = [path.name for path in (tmp_path / "cache").rglob("*") if path.name.startswith(".")]
    assert left == []


def test_libraries_of_one_name_stay_apart(tmp_path):
    controller = lower(load_program("cartpole"))
    compiler = find_compiler()
    paths = [build(controller, tmp_path, real, compiler) for real in ("double", "float")]
    sizes = [load(path).bridge_state_size() for path in paths]
    assert sizes == [24, 12]


@pytest.mark.parametrize(
    ("folder", "code", "message"),
    [
        ("file/inside", "E0712", "the output folder {0} is a file"),
        ("file", "E0712", "the output folder {0} is a file"),
        ("/proc/pirlc", "E0711", "cannot write {0}: no such file or directory"),
    ],
)
def test_folders_that_cannot_be_written(folder, code, message, tmp_path):
    (tmp_path / "file").write_text("")
    place = tmp_path / folder
    with pytest.raises(PirlcError) as caught:
        write(emit(load_program("cartpole")), place)
    assert diagnostic(caught).code == code
    assert diagnostic(caught).message == message.format(place)
    with pytest.raises(PirlcError) as caught:
        build(lower(load_program("cartpole")), place, "double", find_compiler())
    assert diagnostic(caught).code == code


FULL = """
import resource, sys
from pathlib import Path
from pirlc.diagnostics import PirlcError
from pirlc.backend.emit import emit, write
from pirlc.backend.policies import c_policy
from tests.backend.helpers import load_program
program = load_program("long_window")
folder = Path(sys.argv[1])
for limit in (2000, 9000):
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    try:
        write(emit(program), folder) if limit == 2000 else c_policy(program, folder / "cache")
    except PirlcError as e:
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
        print(e)
"""


def test_a_disk_that_is_full(tmp_path):
    """A limit on the size of files stands in for it: writing fails halfway in the same manner."""
    pytest.importorskip("resource")
    old = tmp_path / "long_window.h"
    old.write_text("as it was")
    found = subprocess.run(
        [sys.executable, "-c", FULL, tmp_path], capture_output=True, text=True, check=True
    )
    first, second = found.stdout.splitlines()
    assert first == f"E0711: cannot write {old}: file too large"
    assert second.split(":")[0] in ("E0711", "E0805")
    assert old.read_text() == "as it was"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cache", "long_window.h"]
    left = [
        path.name for path in tmp_path.rglob("*") if path.suffix == ".so" or "pirlc-" in path.name
    ]
    assert left == []


def test_files_are_replaced_whole_and_readable(tmp_path):
    os.umask(0o022)
    folder = tmp_path / "a" / "b"
    for _ in range(2):
        paths = write(emit(load_program("cartpole")), folder)
    assert [path.name for path in paths] == ["cartpole.h", "cartpole.c", "cartpole.py"]
    assert sorted(path.name for path in folder.iterdir()) == sorted(path.name for path in paths)
    assert {stat.S_IMODE(path.stat().st_mode) for path in paths} == {0o644}


@pytest.mark.parametrize("name", ["cartpole", "two_actions"])
def test_factories_travel_to_worker_processes(name, tmp_path):
    program = load_program(name)
    code = (
        "import pickle, sys\n"
        "for factory in pickle.load(sys.stdin.buffer):\n"
        "    policy = factory()\n"
        "    policy.reset()\n"
        "    print([policy.act([0.1 * k] * 8) for k in range(5)], policy.status)\n"
    )
    factories = [python_controller(program), c_controller(program, tmp_path)]
    travelling = pickle.dumps([*factories, factories[1]])
    for there in ("the same machine", "another, without the library"):
        found = subprocess.run(
            [sys.executable, "-c", code], input=travelling, capture_output=True, check=True
        )
        first, second, third = found.stdout.decode().splitlines()
        assert first == second == third and first.count("(") == 5, there
        shutil.rmtree(tmp_path, ignore_errors=True)
