"""The examples of docs/embedding.md compile and run."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from pirlc.backend.emit import emit_to
from pirlc.backend.toolchain import FLAGS, WARNINGS
from tests.backend.helpers import COMPILERS, load_program, program_of

PAGE = (Path(__file__).parents[2] / "docs" / "embedding.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)


@pytest.fixture
def folder(tmp_path):
    (program,) = blocks("pirl")
    emit_to(program_of(program), tmp_path, ["c", "python"])
    return tmp_path


C_OUTPUTS = ["0.400 0\n0.376 0\n0.324 0\n0.240 0\n", "0.5 1 1\n0.5 1 1\n0.5 1 1\n0 5 1\n"]


@pytest.mark.skipif(not COMPILERS, reason="no gcc and no clang on this machine")
@pytest.mark.parametrize("number", range(len(C_OUTPUTS)))
@pytest.mark.parametrize("compiler", COMPILERS)
def test_c(number, compiler, folder):
    (folder / "main.c").write_text(blocks("c")[number])
    command = [compiler, *FLAGS, *WARNINGS, "main.c", "heater.c", "-o", "main", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    found = subprocess.run([folder / "main"], capture_output=True, text=True, check=True)
    assert found.stdout == C_OUTPUTS[number]
    assert len(blocks("c")) == len(C_OUTPUTS)


def test_the_build_line_is_the_headers(folder):
    (line,) = blocks("sh")
    words = line.split()
    assert words[1:4] == list(FLAGS)
    (folder / "main.c").write_text(blocks("c")[0])
    if COMPILERS:
        subprocess.run([COMPILERS[0], *words[1:]], cwd=folder, check=True)


def run_python(code: str, folder: Path) -> str:
    found = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=True
    )
    return found.stdout


def test_python(folder):
    assert run_python(blocks("python")[0], folder).splitlines() == [
        "[0.4, 0.376, 0.324, 0.24]",
        "True {'temperature': 1}",
        "0.01",
    ]


def test_stable_baselines3(tmp_path):
    emit_to(load_program("cartpole"), tmp_path, ["python"])
    assert run_python(blocks("python")[1] + "\nprint(mean, spread)", tmp_path) == "500.0 0.0\n"
