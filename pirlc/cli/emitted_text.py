"""What is printed of the comparison of emitted C with its program."""

from __future__ import annotations

import sys
from collections.abc import Iterator

from pirlc.cli.session import colored
from pirlc.diagnostics import Diagnostic, render
from pirlc.verify.emitted.problems import NotTheProgram, describe
from pirlc.verify.findings import EmittedFinding


def in_words(finding: EmittedFinding) -> str:
    """One line."""
    return f"emitted C = program: {finding.evidence} ({finding.seconds:.2f} s)"


def emitted_texts(policy: str, findings: tuple[EmittedFinding, ...]) -> Iterator[str]:
    """A line for each precision; where something differs, what."""
    for finding in findings:
        yield f"{finding.real}: {in_words(finding)}"
    for diagnostic in emitted_problems(policy, findings):
        yield f"\n{render(diagnostic, color=colored(sys.stdout))}"


def emitted_problems(policy: str, findings: tuple[EmittedFinding, ...]) -> list[Diagnostic]:
    return [describe(NotTheProgram(policy, finding)) for finding in findings if finding.differences]
