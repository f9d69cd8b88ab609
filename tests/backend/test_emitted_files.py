"""The header's figures, what the source refuses, and that files are the same every time."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import pytest

from pirlc.backend.costs import checking_operations, program_operations
from pirlc.backend.emit import emit, emit_to
from pirlc.diagnostics import PirlcError
from pirlc.ir.printer import program_text
from pirlc.lower import lower
from tests.backend.helpers import COMPILERS, NAMES, compiled, load_program, program_of

needs_c = pytest.mark.skipif(not COMPILERS, reason="no gcc and no clang on this machine")
needs_gcc = pytest.mark.skipif("gcc" not in COMPILERS, reason="no gcc on this machine")


def header_of(name: str, real="double") -> str:
    return emit(load_program(name), ["c"], real)[0].text


@needs_c
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("real", ["double", "float"])
def test_the_headers_state_size_is_the_compilers(name, real, tmp_path):
    size = compiled(load_program(name), tmp_path, real, level="-O0").state_size
    assert f"State: {size} bytes an instance" in header_of(name, real)


def test_the_header_tells_what_it_was_made_from():
    header = header_of("cartpole")
    text = program_text(load_program("cartpole"))
    assert sha256(text.encode()).hexdigest() in header
    for line in text.splitlines():
        assert f" *     {line}".rstrip() in header
    assert "written by pirlc 0." in header
    assert "voids it" in header
    assert "cc -std=c99 -O2 -ffp-contract=off -c cartpole.c\n" in header
    assert "-lm" in header_of("functions")


def test_operations_of_the_worst_path():
    program = program_of(
        """
        policy counted
        sensor x : [0, 1] = 0
        sensor y : [0, 1] = 1
        window 3
        action u : [0, 1] =
            if peek(x, -1) > 0.5 and peek(y, -1) > 0.5   # 3, and 1 for the branch
            then fold(+, 0.5 - x)                        # 3 differences, 2 sums
            else if peek(y, -1) > 0 then peek(x, -1) else 2 * peek(x, -2)
        """
    )
    controller = lower(program)
    assert program_operations(controller) == 9
    # Two comparisons, a subtraction and one more comparison a sensor; two to clip.
    assert checking_operations(controller) == 10
    header = emit(program, ["c"])[0].text
    assert "9 operations of the program itself, and 10 that judge" in header


def test_loops_count_each_of_their_steps():
    program = program_of(
        """
        policy counted
        sensor x : [0, 1] = 0
        window 30
        action u : [0, 1] = fold(+, x)
        """
    )
    assert program_operations(lower(program)) == 29 * 2


def test_math_is_included_only_where_it_is_needed():
    for name, needs in (("cartpole", False), ("switched_pid", False), ("functions", True)):
        assert ("#include <math.h>" in emit(load_program(name), ["c"])[1].text) is needs


def test_files_are_the_same_in_every_process(tmp_path):
    code = (
        "import sys; from pathlib import Path; from tests.backend.helpers import load_program\n"
        "from pirlc.backend.emit import emit_to\n"
        "emit_to(load_program('long_window'), Path(sys.argv[1]), ['c', 'python'])"
    )
    texts = []
    for number in ("1", "2"):
        place = tmp_path / number
        environment = {**os.environ, "PYTHONHASHSEED": number}
        subprocess.run([sys.executable, "-c", code, place], check=True, env=environment)
        texts.append({path.name: path.read_bytes() for path in sorted(place.iterdir())})
    assert texts[0] == texts[1]
    assert sorted(texts[0]) == ["long_window.c", "long_window.h", "long_window.py"]
    joined = b"".join(texts[0].values()).decode()
    assert str(tmp_path) not in joined and str(Path.cwd()) not in joined
    assert not re.search(r"20\d\d-\d\d", joined)


@needs_gcc
@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["-ffast-math"], "without -ffast-math"),
        (["-Ofast"], "without -ffast-math"),
        (["-ffinite-math-only"], "without -ffinite-math-only"),
        (["-m32", "-mfpmath=387"], "FLT_EVAL_METHOD"),
        (["-D__FLT_EVAL_METHOD__=-1", "-w"], "FLT_EVAL_METHOD"),
        (["-D__DBL_MANT_DIG__=24", "-w"], "double must be IEEE binary64"),
    ],
)
def test_the_source_refuses_what_changes_results(flags, words, tmp_path):
    emit_to(load_program("cartpole"), tmp_path, ["c"])
    found = subprocess.run(
        ["gcc", "-std=c99", *flags, "-fsyntax-only", "cartpole.c"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert found.returncode != 0
    assert "#error" in found.stderr and words in found.stderr


@needs_c
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("standard", ["c99", "gnu99", "gnu17"])
def test_no_multiply_add_is_fused(compiler, standard, tmp_path):
    machine = subprocess.run([compiler, "-dumpmachine"], capture_output=True, text=True).stdout
    if not machine.startswith("x86_64"):
        pytest.skip("-mfma is an option for x86 machines")
    emit_to(load_program("switched_pid"), tmp_path, ["c"])
    found = subprocess.run(
        [compiler, f"-std={standard}", "-O2", "-mfma", "-S", "-o", "-", "switched_pid.c"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert "mulsd" in found.stdout and "vfm" not in found.stdout


@needs_gcc
def test_the_header_serves_cpp(tmp_path):
    emit_to(load_program("two_actions"), tmp_path, ["c"])
    command = ["g++", "-std=c++11", "-Wall", "-Wextra", "-pedantic", "-Werror", "-fsyntax-only"]
    code = '#include "two_actions.h"\nint main() { two_actions_state s; two_actions_reset(&s); }'
    (tmp_path / "use.cpp").write_text(code)
    if subprocess.run(["g++", "--version"], capture_output=True).returncode:
        pytest.skip("no g++ on this machine")
    subprocess.run([*command, "use.cpp"], cwd=tmp_path, check=True)


def test_a_program_without_sensors_or_parameters(tmp_path):
    program = program_of("policy still\naction u : [-1, 1] = 0.5")
    assert [str(file.path) for file in emit(program)] == ["still.h", "still.c", "still.py"]
    if COMPILERS:
        assert compiled(program, tmp_path).step([]) == ((0.5,), 0)


def test_an_unknown_target():
    with pytest.raises(PirlcError) as caught:
        emit(load_program("cartpole"), ["c", "fortran"])
    diagnostic = caught.value.diagnostics[0]
    assert (diagnostic.code, diagnostic.message, diagnostic.help) == (
        "E0802",
        "there is no target 'fortran'",
        "the targets are c, python, torcs",
    )


def test_emitting_is_quick_and_loads_no_heavy_library():
    code = (
        "import sys, time; start = time.perf_counter()\n"
        "import pirlc.backend.emit, pirlc.backend.toolchain, pirlc.backend.policies\n"
        "from pirlc.ir.policy import *\n"
        "from pirlc.ir.terms import Peek, SensorRef\n"
        "program = Program(Interface('p', None, (Sensor('x', -1.0, 1.0, 0),),\n"
        "    (ActionSpec('u', Continuous(-1.0, 1.0), 0),)), (), (Peek(SensorRef('x', 1), -1),))\n"
        "pirlc.backend.emit.emit(program)\n"
        "heavy = {'numpy', 'torch', 'casadi', 'z3', 'gymnasium', 'lark'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
