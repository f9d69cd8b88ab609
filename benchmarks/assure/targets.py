"""Emitted C on other machines, under emulation: the same bits as here."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.assure import tools
from benchmarks.assure.driving import HOST, TARGETS, Machine, answers, build, difference
from benchmarks.assure.outcome import Outcome
from benchmarks.assure.streams import Stream, stream
from benchmarks.assure.subjects import Subject

TOOLS = (tools.GCC, *dict.fromkeys(tool for target in TARGETS for tool in target.tools))

EXAMPLE_STEPS = 5_000
RANDOM_STEPS = 500


def check(subject: Subject, work: Path, machines: tuple[Machine, ...] = TARGETS) -> Outcome:
    """A recorded stream, on this machine and on each target.

    Programs with `exp` and `tanh` are left out: see `functions`.
    """
    if subject.uses_libm:
        return Outcome(counts=Counter({"left out for exp or tanh": 1}))
    steps = EXAMPLE_STEPS if subject.is_example else RANDOM_STEPS
    readings = stream(subject.program, steps, subject.seed + 1_000)
    here = answers(build(subject, HOST, work / "host"), subject, HOST, readings)
    findings = [
        f"{machine.name}: {said}"
        for machine in machines
        if (said := _fault(subject, machine, work / machine.name, readings, here))
    ]
    return Outcome(tuple(findings), counts=Counter({"programs": 1, "steps": steps}))


def _fault(
    subject: Subject, machine: Machine, folder: Path, readings: Stream, here: NDArray[np.float64]
) -> str | None:
    try:
        program = build(subject, machine, folder)
        return difference(here, answers(program, subject, machine, readings))
    except tools.ToolFailed as failure:
        return str(failure)
