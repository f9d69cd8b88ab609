"""The wheel and the editable install, in environments of their own; the set-up's pins."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
import venv
import zipfile
from pathlib import Path

import lark
import pytest

from tests.support.command_line import POLE, ROOT

PARTS = ("pyproject.toml", "setup.py", "README.md", "pirlc", "grammars", "templates", "runtime")
RESOURCES = ("grammars", "templates", "runtime")


@pytest.fixture(scope="module")
def checkout(tmp_path_factory) -> Path:
    """A copy of what a build needs: builds leave files where they run."""
    copy = tmp_path_factory.mktemp("checkout")
    for part in PARTS:
        if (ROOT / part).is_dir():
            ignored = shutil.ignore_patterns("__pycache__")
            shutil.copytree(ROOT / part, copy / part, ignore=ignored)
        else:
            shutil.copy(ROOT / part, copy / part)
    return copy


def _pip(*arguments: str | Path) -> None:
    command = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*command, *map(str, arguments)], check=True, capture_output=True)


@pytest.fixture(scope="module")
def wheel(checkout, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    _pip("wheel", "--no-deps", "--no-build-isolation", "-w", folder, checkout)
    (built,) = folder.glob("pirlc-*.whl")
    return built


def _environment(folder: Path) -> Path:
    """A fresh virtual environment that sees pirlc's dependencies, but no pirlc; its Python."""
    venv.create(folder, with_pip=False, symlinks=True)
    python = folder / "bin" / "python"
    command = [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]
    site = subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
    # A path that a .pth file names is searched, but its own .pth files (an editable install of
    # this checkout, say) are not read.
    dependencies = Path(lark.__file__).parents[1]
    (Path(site) / "dependencies.pth").write_text(f"{dependencies}\n")
    return python


def _run(python: Path, folder: Path, *arguments: str) -> str:
    clean = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    command = [str(python.with_name("pirlc")), *arguments]
    done = subprocess.run(
        command, cwd=folder, env=clean, check=False, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def _where(python: Path, folder: Path) -> Path:
    clean = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    command = [python, "-c", "import pirlc; print(pirlc.__file__)"]
    done = subprocess.run(
        command, cwd=folder, env=clean, check=True, capture_output=True, text=True
    )
    return Path(done.stdout.strip())


def _use(python: Path, folder: Path) -> None:
    """Check, explain and compile something from a folder far from the checkout."""
    (folder / "pole.pirl").write_text(POLE)
    assert "a program of 14 nodes" in _run(python, folder, "check", "pole.pirl")
    assert _run(python, folder, "explain", "E0303").startswith("# E0303: ")
    _run(python, folder, "emit", "pole.pirl", "-o", "out")
    assert {path.name for path in (folder / "out").iterdir()} == {"pole.c", "pole.h", "pole.py"}


def test_the_wheel_holds_all_that_the_package_reads(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    wanted = {
        f"pirlc/_resources/{path.relative_to(ROOT).as_posix()}"
        for folder in RESOURCES
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    wanted |= {
        path.relative_to(ROOT).as_posix()
        for pattern in ("*.py", "*.md", "py.typed")
        for path in (ROOT / "pirlc").rglob(pattern)
    }
    assert wanted <= names
    others = {name for name in names - wanted if ".dist-info/" not in name}
    assert not others


def test_the_wheel_works_in_an_empty_environment(wheel, tmp_path):
    python = _environment(tmp_path / "venv")
    _pip("--python", python, "install", "--no-deps", wheel)
    away = tmp_path / "away"
    away.mkdir()
    assert _where(python, away).is_relative_to(tmp_path / "venv")
    _use(python, away)


def test_the_editable_install_works(checkout, tmp_path):
    python = _environment(tmp_path / "venv")
    _pip("--python", python, "install", "--no-deps", "--no-build-isolation", "-e", checkout)
    away = tmp_path / "away"
    away.mkdir()
    assert _where(python, away).is_relative_to(checkout)
    _use(python, away)


# Pins.


def _names(requirements: list[str]) -> set[str]:
    return {re.split(r"[<>=!~ \[;]", entry)[0].lower() for entry in requirements}


def test_everything_that_is_used_directly_is_pinned():
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pins = dict(line.split("==") for line in lines if line and not line.startswith("#"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    used = _names(project["dependencies"]) | _names(extras["ray"]) | _names(extras["study"])
    development = _names(extras["dev"]) - {"pirlc"}
    assert set(pins) == used | development
    assert pins["torch"] == "2.13.0"


@pytest.mark.skipif(not shutil.which("make"), reason="needs make")
@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ('case "$2" in *version_info*) exit 1;; esac', "pirlc needs Python 3.11 or later"),
        ('case "$2" in *ensurepip*) exit 1;; esac', "apt install python3-venv"),
    ],
)
def test_make_says_what_python_lacks(tmp_path, answer, words):
    python = tmp_path / "python"
    python.write_text(f"#!/bin/sh\n{answer}\nexit 0\n")
    python.chmod(0o755)
    for name in ("Makefile", "pyproject.toml", "setup.py", "constraints.txt"):
        shutil.copy(ROOT / name, tmp_path / name)
    command = ["make", "-C", str(tmp_path), "synth", f"PYTHON={python}"]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode != 0
    assert words in done.stderr
    assert not (tmp_path / ".venv").exists()
