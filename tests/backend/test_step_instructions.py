"""Emitted C takes hardly more instructions than C written by hand for the same law."""

from __future__ import annotations

import shutil
import subprocess
import sys

import pytest


@pytest.mark.slow
@pytest.mark.skipif(
    shutil.which("valgrind") is None or shutil.which("gcc") is None,
    reason="counting instructions needs valgrind and gcc",
)
def test_the_bar_is_met():
    found = subprocess.run(
        [sys.executable, "-m", "benchmarks.step_instructions", "--steps", "5000"],
        capture_output=True,
        text=True,
    )
    assert found.returncode == 0, found.stdout + found.stderr
    assert "bar: 1.1; met" in found.stdout
