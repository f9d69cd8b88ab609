"""What `pirlc verify` prints for people."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator

from pirlc.cli.session import colored
from pirlc.diagnostics import render
from pirlc.ir.evidence import Evidence, Kind
from pirlc.ir.layout import number_text
from pirlc.ir.policy import Choice, Program
from pirlc.ir.terms import PreviousAction, subterms
from pirlc.semantics.precision import to_binary32
from pirlc.source import SourceText
from pirlc.verify.findings import PropertyFinding, Replay, Verification
from pirlc.verify.problems import problems_of

REFUTED, UNDECIDED = 1, 2


def exit_code(found: Verification) -> int:
    """0: every property is proved, of what runs too; 1: one is refuted; 2: one is undecided."""
    kinds = {evidence.kind for finding in found.properties for evidence in _statements(finding)}
    if Kind.REFUTED in kinds:
        return REFUTED
    return UNDECIDED if kinds - {Kind.PROVED} else 0


def _statements(finding: PropertyFinding) -> tuple[Evidence, ...]:
    beside = (obligation.evidence for obligation in finding.obligations)
    return (finding.evidence, finding.binary64, finding.binary32, *beside)


def property_texts(
    source: SourceText, program: Program, findings: tuple[PropertyFinding, ...]
) -> Iterator[str]:
    """The properties, then each that does not hold at its place in the file, with a history."""
    if not findings:
        yield f"{program.interface.name} has no properties; `property NAME = ...` states one"
        return
    width = max(len(finding.name) for finding in findings)
    for finding in findings:
        yield f"{finding.name:{width}}  {finding.evidence}"
        for label, evidence in _beside(finding):
            yield f"{'':{width}}    {label}: {evidence}"
    diagnostics = iter(problems_of(source, findings))
    for finding in findings:
        if finding.counterexample is None and finding.evidence.kind is Kind.PROVED:
            continue
        yield ""
        yield render(next(diagnostics), color=colored(sys.stdout))
        if finding.counterexample is not None:
            yield ""
            yield from replay_text(program, finding.counterexample)
    for finding in findings:
        for obligation in finding.obligations:
            if obligation.counterexample is not None:
                yield ""
                yield f"{finding.name}, {obligation.name}:"
                yield ""
                yield from replay_text(program, obligation.counterexample)


def _beside(finding: PropertyFinding) -> Iterator[tuple[str, Evidence]]:
    """What is worth a line beside the property's own evidence."""
    if finding.evidence.kind is Kind.UNKNOWN:
        return
    yield "binary64", finding.binary64
    yield "binary32", finding.binary32
    if finding.evidence.kind is Kind.PROVED:
        for obligation in finding.obligations:
            yield obligation.name, obligation.evidence


def replay_text(program: Program, replay: Replay) -> Iterator[str]:
    """The readings, oldest first, beside what the interpreter answered to the newest."""
    interface, history = program.interface, replay.history
    if _looks_back(program):
        before = ", ".join(f"{name} {_short(x)}" for name, x in history.previous.items())
        yield f"  before: {before}"
    head = ["", *history.readings]
    for spec in interface.actions:
        head.extend([spec.name] if isinstance(spec.domain, Choice) else _pair(spec.name))
    length = max((len(readings) for readings in history.readings.values()), default=1)
    rows = [head]
    for place in range(length):
        step = place - length + len(replay.steps)
        row = [str(place - length)]
        row += [_short(readings[place]) for readings in history.readings.values()]
        for spec in interface.actions:
            if step < 0:
                row += [""] if isinstance(spec.domain, Choice) else ["", ""]
                continue
            taken = replay.steps[step]
            if not isinstance(spec.domain, Choice):
                row.append(_short(taken.raw[spec.name]))
            row.append(_short(taken.applied[spec.name]))
        rows.append(row)
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    for row in rows:
        cells = (cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        yield ("  " + "  ".join(cells)).rstrip()


def _pair(name: str) -> list[str]:
    return [f"raw({name})", name]


def _looks_back(program: Program) -> bool:
    everything = (*program.bodies, *(claim.body for claim in program.properties))
    return any(isinstance(s, PreviousAction) for body in everything for s in subterms(body))


def _short(x: float) -> str:
    """The shortest text of a number; of one of binary32 the shortest that reads back as that."""
    if not math.isfinite(x):
        return "missing" if math.isnan(x) else str(x)
    if x and to_binary32(x) == x:
        for digits in range(1, 9):
            text = f"{x:.{digits}g}"
            if to_binary32(float(text)) == x:
                return number_text(float(text))
    return number_text(float(x))
