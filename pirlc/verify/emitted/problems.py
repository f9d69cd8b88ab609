"""What is said where emitted C is not shown to be its program (E0915)."""

from __future__ import annotations

from dataclasses import dataclass

from pirlc.diagnostics import Diagnostic, PirlcError
from pirlc.verify.findings import Difference, EmittedFinding

_SHOWN = 4


@dataclass(frozen=True)
class NotTheProgram:
    """Emitted C of a policy that differs from it, or is not understood."""

    policy: str
    finding: EmittedFinding


def describe(problem: NotTheProgram) -> Diagnostic:
    """The problem in words."""
    differences = problem.finding.differences
    notes = [told(difference) for difference in differences[:_SHOWN]]
    if len(differences) > _SHOWN:
        notes.append(f"and {len(differences) - _SHOWN} more parts")
    return Diagnostic(
        "E0915",
        f"the C emitted for {problem.policy} ({problem.finding.real}) is not shown to be the "
        "program",
        notes=tuple(notes),
        help="this is a fault of pirlc, not of your file: please report it with the program; "
        "nothing was written",
    )


def told(difference: Difference) -> str:
    """A difference in one line."""
    if not difference.program:
        return f"{difference.part}: {difference.emitted}"
    if not difference.emitted:
        return f"{difference.part}: {difference.program}"
    return f"{difference.part}: C has {difference.emitted}, the program {difference.program}"


def error(problem: NotTheProgram) -> PirlcError:
    return PirlcError(describe(problem))
