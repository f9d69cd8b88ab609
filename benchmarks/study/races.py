"""The suite `torcs`: programs and oracles of the paper's Table performance, raced for three laps.

A row's limit is a number of tunings and races. "Timeout" is a row without a program that
completes the race, as in the paper. Refinement on return, which the paper has not, makes up for
much of what an ablation leaves out; so Algorithm 1's own program is raced as well.
"""

from __future__ import annotations

import threading
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, assert_never

from benchmarks.study.classic import Job, run_of, with_program, without_program
from benchmarks.study.records import COMPLETE, TIMEOUT, Record
from benchmarks.study.rows import TORCS, Lowest, Synthesis, Teacher
from benchmarks.study.running import Children, Failed, synthesise
from benchmarks.torcs import drivers
from benchmarks.torcs.drivers import CompiledProgram, Driver, Network, compiled
from benchmarks.torcs.racing import WHOLE, race
from benchmarks.torcs.telling import as_data, plain
from pirlc.backend.files import write_text
from pirlc.simulation.torcs.protocol import Status
from pirlc.simulation.torcs.summary import summary

FINAL, IMITATED = "program", "imitated"

_ONE_AT_A_TIME = threading.Lock()
"""Races of one process share its simulators."""


def run(job: Job, children: Children) -> Record:
    """Does what the row asks for. Raises Failed."""
    match job.row:
        case Synthesis():
            return synthesised(job, children)
        case Teacher():
            return taught(job)
        case Lowest():
            raise Failed("there is no row of this name in TORCS")
        case _:
            assert_never(job.row)


def raced(wheel: CompiledProgram | Network, track: str) -> dict[str, Any]:
    """A race over three laps, in figures; `finished` says whether it was completed."""
    with _ONE_AT_A_TIME:
        figures = summary(race(Driver("", wheel), track, WHOLE))
    told: dict[str, Any] = plain(as_data(figures))
    return {"finished": figures.status is Status.FINISHED, **told}


def race_of(text: str, track: str) -> dict[str, Any]:
    """A race of the program in a text."""
    with TemporaryDirectory(prefix="pirlc-") as place:
        file = write_text(Path(place) / "program.pirl", text)
        return raced(compiled(file, Path(place)), track)


def synthesised(job: Job, children: Children) -> Record:
    """A row of programs: the result, and what Algorithm 1 alone had found."""
    made = run_of(job)
    found = synthesise(made, children)
    manifest = found.manifest
    if manifest is None:
        return without_program(TORCS, job, made, found)
    imitated = manifest["imitated"]
    races = {FINAL: race_of(manifest["program"]["text"], job.place.name)}
    figures: dict[str, Any] = {"races": races}
    if imitated is not None:
        races[IMITATED] = race_of(imitated["text"], job.place.name)
        figures |= {"imitated_size": imitated["size"], "imitated_program": imitated["text"]}
    ending = COMPLETE if races[FINAL]["finished"] else TIMEOUT
    return with_program(TORCS, job, made, found, manifest, figures, ending)


def taught(job: Job) -> Record:
    """The oracle that the programs for a track were made from; it comes with the repository."""
    name = f"paper-{job.place.name}"
    folder = drivers.ORACLES / name
    found = [driver for driver in drivers.oracles(folder) if driver.fits(job.place.name)]
    if not found or not isinstance(found[0].wheel, Network):
        raise Failed(f"there is no oracle in {folder}")
    figures = raced(found[0].wheel, job.place.name)
    return Record(
        suite=TORCS,
        method=job.row.method,
        environment=job.place.name,
        seed=job.seed,
        command=(
            *("python", "-m", "benchmarks.study", "--suite", TORCS),
            *("--row", job.row.method, "--environment", job.place.name),
        ),
        provable="nothing",
        distance=0.0,
        ending=COMPLETE if figures["finished"] else TIMEOUT,
        oracle=found[0].digest,
        figures={"asked": job.asked, "races": {FINAL: figures}},
    )
