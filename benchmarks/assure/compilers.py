"""No warning under gcc and clang."""

from __future__ import annotations

from pathlib import Path

from benchmarks.assure import tools
from benchmarks.assure.outcome import Outcome
from benchmarks.assure.subjects import Subject
from pirlc.backend.toolchain import FLAGS, WARNINGS

TOOLS = (tools.GCC, tools.CLANG)
LEVELS = ("-O0", "-O2")


def check(subject: Subject, work: Path) -> Outcome:
    """Compiles with every warning of the contract an error; the optimiser finds more of them."""
    findings = []
    for tool in TOOLS:
        for level in LEVELS:
            answer = tools.run(
                [tool.command, *FLAGS, level, *WARNINGS, "-c", subject.source, "-o", work / "o"]
            )
            if answer.returncode or answer.stderr:
                findings.append(f"{tool.command} {level}: {answer.stderr.strip()}")
    return Outcome(tuple(findings))
