"""The command line run in this process, and as a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from joblib.externals.loky import get_reusable_executor

from pirlc.cli import main
from tests.support.command_line import POLE, ROOT, SKETCH, Outcome
from tests.support.point import ENVIRONMENT as POINT_ENVIRONMENT
from tests.support.point import SKETCH as POINT_SKETCH


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty current folder but for `pole.pirl`, a program, and `sketch.pirl`."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pole.pirl").write_text(POLE)
    (tmp_path / "sketch.pirl").write_text(SKETCH)
    return tmp_path


@pytest.fixture
def pirlc(here, capfd):
    def run(*arguments: str) -> Outcome:
        code = main([str(argument) for argument in arguments])
        out, err = capfd.readouterr()
        assert "Traceback" not in out + err
        return Outcome(code, out, err)

    return run


@pytest.fixture
def process(here):
    """The same as a process: for what depends on the whole process."""

    def run(*arguments: str, **options) -> Outcome:
        done = subprocess.run(
            [sys.executable, "-m", "pirlc", *map(str, arguments)],
            capture_output="stdout" not in options,
            text=True,
            check=False,
            timeout=120,
            env={**os.environ, "PYTHONPATH": str(ROOT), **options.pop("env", {})},
            **options,
        )
        assert "Traceback" not in (done.stdout or "") + (done.stderr or "")
        return Outcome(done.returncode, done.stdout, done.stderr)

    return run


@pytest.fixture
def point(here, monkeypatch):
    """The current folder with a small environment of the user's own, and a sketch for it."""
    (here / "point_environment.py").write_text(POINT_ENVIRONMENT)
    (here / "point.pirl").write_text(POINT_SKETCH)
    monkeypatch.setenv("XDG_CACHE_HOME", str(here / "cache"))
    # Processes that an earlier test started would not find this folder's modules.
    get_reusable_executor().shutdown(wait=True)
    yield here
    get_reusable_executor().shutdown(wait=True)
