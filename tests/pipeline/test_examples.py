"""The examples reach what their READMEs say, by the commands that the READMEs show."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.command_line import ROOT

BARS = {"cartpole": 499.5, "mountain_car": -100.0, "acrobot": -80.0, "pendulum": -150.0}
"""Mean returns over 1,000 unseen episodes."""


def command(example: str) -> list[str]:
    text = (ROOT / "examples" / example / "README.md").read_text(encoding="utf-8")
    (line,) = re.findall(r"^\$ pirlc (synth .*)$", text, re.MULTILINE)
    return shlex.split(line)


def test_every_example_has_its_sketch_and_its_command() -> None:
    folders = {p.name for p in (ROOT / "examples").iterdir() if p.is_dir()}
    assert folders == {*BARS, "torcs"}
    for example in BARS:
        words = command(example)
        assert words[1] == f"examples/{example}/{example}.pirl"
        assert (ROOT / words[1]).is_file()


@pytest.mark.slow
@pytest.mark.parametrize("example", list(BARS))
def test_the_command_reaches_the_bar(example: str, tmp_path: Path) -> None:
    words = command(example)
    words[words.index("-o") + 1] = str(tmp_path / "run")
    subprocess.run([sys.executable, "-m", "pirlc", *words], check=True, cwd=ROOT)
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text())
    returns = manifest["evaluation"]["returns"]
    assert returns["program"]["episodes"] == 1000
    assert returns["program"]["mean"] >= BARS[example]
    assert returns["program"] == returns["emitted C"]
    assert example != "cartpole" or manifest["program"]["size"] <= 20


@pytest.mark.slow
def test_make_synth_on_a_fresh_clone(tmp_path: Path) -> None:
    clone = tmp_path / "pirlc"
    subprocess.run(["git", "clone", "-q", str(ROOT), str(clone)], check=True)
    subprocess.run(["make", "synth"], check=True, cwd=clone)
    assert (clone / "runs" / "cartpole" / "cartpole.pirl").is_file()
    assert (clone / "runs" / "cartpole" / "c" / "cartpole.c").is_file()
