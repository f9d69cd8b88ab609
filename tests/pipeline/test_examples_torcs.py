"""The programs that come with the racing examples drive as their READMEs say."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pirlc.backend.policies import c_controller
from pirlc.cli.files import program_in
from pirlc.frontend import parse_sketch
from pirlc.ir.terms import size
from pirlc.simulation.torcs.installation import Installation
from pirlc.simulation.torcs.protocol import Conditions, Status
from pirlc.simulation.torcs.simulator import Course, TorcsProcess
from pirlc.simulation.torcs.summary import RaceSummary, summary
from pirlc.source import SourceText
from tests.support.command_line import ROOT

SYNTHESISED = ROOT / "examples" / "torcs" / "synthesised"

BARS = {
    ("paper", "g-track-1"): 61.56,
    ("paper", "aalborg"): 158.87,
    ("racer", "g-track-1"): 54.27,
    ("racer", "aalborg"): 109.66,
}
"""Mean laps (s) of the paper's programs, and of its neural driver."""

TRACKS = ("g-track-1", "g-track-2", "eroad", "aalborg", "alpine-2", "ruudskogen")


def race(path: Path, track: str, installation: Installation, libraries: Path) -> RaceSummary:
    """Three laps from standstill; the program's actions are at most 100 nodes each."""
    source = SourceText(path.name, path.read_text(encoding="utf-8"))
    program = program_in(source, parse_sketch(source))
    assert max(map(size, program.bodies)) <= 100
    library = c_controller(program, libraries).library
    process = TorcsProcess(installation, Course(track, laps=3))
    try:
        return summary(process.race(Conditions(), library, None, len(program.interface.actions)))
    finally:
        process.close()


@pytest.mark.parametrize(("sketch", "track"), list(BARS))
def test_each_seed_beats_the_bar(
    sketch: str, track: str, torcs_installation: Installation, tmp_path: Path
) -> None:
    paths = [SYNTHESISED / f"{sketch}-{track}-{seed}.pirl" for seed in range(3)]
    for path in paths:
        raced = race(path, track, torcs_installation, tmp_path)
        assert raced.status is Status.FINISHED
        assert sketch == "paper" or raced.damage == 0
        assert np.mean(raced.laps) <= BARS[sketch, track]


@pytest.mark.parametrize("name", ["racer-aalborg-2", "racer-aalborg-varied-0"])
def test_one_program_trained_on_aalborg_completes_all_tracks(
    name: str, torcs_installation: Installation, tmp_path: Path
) -> None:
    path = SYNTHESISED / f"{name}.pirl"
    for track in TRACKS:
        raced = race(path, track, torcs_installation, tmp_path)
        assert (raced.status, raced.damage) == (Status.FINISHED, 0), track


@pytest.mark.slow
@pytest.mark.parametrize(("sketch", "track"), list(BARS))
def test_a_whole_synthesis_beats_the_bar(
    sketch: str, track: str, torcs_installation: Installation, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    words = ["synth", f"examples/torcs/{sketch}.pirl", "--argument", f"track={track}"]
    words += ["--seed", "0", "--episodes", "10", "-o", str(run)]
    subprocess.run([sys.executable, "-m", "pirlc", *words], check=True, cwd=ROOT)
    raced = race(run / f"{sketch}.pirl", track, torcs_installation, tmp_path)
    assert raced.status is Status.FINISHED
    assert np.mean(raced.laps) <= BARS[sketch, track]
