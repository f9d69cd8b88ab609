"""What verification tells in diagnostics (E0901, E0902)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

from pirlc.diagnostics import Diagnostic, Label, Severity
from pirlc.ir.evidence import Kind
from pirlc.source import SourceText
from pirlc.verify.findings import PropertyFinding


@dataclass(frozen=True)
class Violated:
    """A property that a history violates, over the reals or by rounding."""

    source: SourceText
    finding: PropertyFinding


@dataclass(frozen=True)
class Undecided:
    """A property that is neither proved nor refuted."""

    source: SourceText
    finding: PropertyFinding


Problem = Violated | Undecided


def describe(problem: Problem) -> Diagnostic:
    """The problem in words."""
    match problem:
        case Violated(source, finding):
            over = finding.evidence.kind is Kind.REFUTED
            return Diagnostic(
                "E0901",
                f"the property {finding.name} does not hold",
                source,
                Label(finding.span, "false on the history below" if over else "false by rounding"),
                notes=()
                if over
                else ("over the reals it is proved; the history below violates it as computed",),
            )
        case Undecided(source, finding):
            return Diagnostic(
                "E0902",
                f"the property {finding.name} is neither proved nor refuted",
                source,
                Label(finding.span),
                notes=(finding.evidence.reason,),
                severity=Severity.WARNING,
            )
        case _:
            assert_never(problem)


def problems_of(
    source: SourceText, findings: tuple[PropertyFinding, ...]
) -> tuple[Diagnostic, ...]:
    """A diagnostic for each property that is not proved, in their order."""
    found = []
    for finding in findings:
        if finding.counterexample is not None:
            found.append(describe(Violated(source, finding)))
        elif finding.evidence.kind is not Kind.PROVED:
            found.append(describe(Undecided(source, finding)))
    return tuple(found)
