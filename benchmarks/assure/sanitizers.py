"""Emitted C under sanitizers, over random steps with missing readings."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.assure import tools
from benchmarks.assure.driving import HOST, Machine, answers, build, difference
from benchmarks.assure.outcome import Outcome
from benchmarks.assure.streams import stream
from benchmarks.assure.subjects import Subject

TOOLS = (tools.GCC, tools.CLANG_SANITIZERS)

EXAMPLE_STEPS = 1_000_000
RANDOM_STEPS = 5_000

_COMMON = ("-std=c99", "-O1", "-g", "-ffp-contract=off", "-fno-sanitize-recover=all")
BUILDS = (
    replace(
        HOST,
        name="gcc: address, undefined",
        flags=(*_COMMON, "-fsanitize=address,undefined"),
    ),
    # Beyond undefined behaviour: reads of what was never written, unsigned sums that wrap,
    # conversions that lose a value.
    replace(
        HOST,
        name="clang: memory, undefined, unsigned-integer-overflow, implicit-conversion",
        compiler=tools.CLANG,
        flags=(
            *_COMMON,
            "-fsanitize=memory,undefined,unsigned-integer-overflow,implicit-conversion",
        ),
    ),
)


def check(subject: Subject, work: Path, builds: tuple[Machine, ...] = BUILDS) -> Outcome:
    """Runs plainly and with two sets of sanitizers; all must answer alike, bit for bit.

    Division by zero and conversions between floating-point types have a value in IEEE 754, and are
    no errors here.
    """
    steps = EXAMPLE_STEPS if subject.is_example else RANDOM_STEPS
    readings = stream(subject.program, steps, subject.seed)
    plain = answers(build(subject, HOST, work / "plain"), subject, HOST, readings)
    findings = []
    for machine in builds:
        folder = work / machine.compiler.command
        try:
            sanitized = answers(build(subject, machine, folder), subject, machine, readings)
        except tools.ToolFailed as failure:
            findings.append(f"{machine.name}: {failure}")
            continue
        if differs := difference(plain, sanitized):
            findings.append(f"{machine.name}: not what the plain build answers: {differs}")
    status = plain[:, -1].astype(np.int64) % 8
    return Outcome(
        tuple(findings),
        counts=Counter(
            {
                "steps": steps,
                "steps with a missing reading": int((status & 1 != 0).sum()),
                "steps with a reading out of range": int((status & 2 != 0).sum()),
                "steps with a safe value": int((status & 4 != 0).sum()),
            }
        ),
    )
