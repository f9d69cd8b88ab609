"""What `pirlc verify` prints for people."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator

from pirlc.cli.session import colored
from pirlc.diagnostics import render
from pirlc.ir.evidence import Evidence, Kind
from pirlc.ir.layout import number_text
from pirlc.ir.policy import ActionSpec, Choice, Continuous, Program, Property
from pirlc.ir.terms import PreviousAction, subterms
from pirlc.semantics.precision import to_binary32
from pirlc.source import SourceText
from pirlc.verify.findings import PropertyFinding, Replay, Tightest, Verification
from pirlc.verify.problems import problems_of
from pirlc.verify.properties.cone import concerned

REFUTED, UNDECIDED = 1, 2


def exit_code(found: Verification) -> int:
    """0: every property is proved, of what runs too; 1: one is refuted; 2: one is undecided.

    Where the emitted C was compared, that counts as one more.
    """
    kinds = {evidence.kind for finding in found.properties for evidence in _statements(finding)}
    kinds |= {finding.evidence.kind for finding in found.emitted}
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
    claims = {claim.name: claim for claim in program.properties}
    width = max(len(finding.name) for finding in findings)
    for finding in findings:
        yield f"{finding.name:{width}}  {finding.evidence}"
        for label, evidence in _beside(finding):
            yield f"{'':{width}}    {label}: {evidence}"
        for tight in finding.tightest:
            yield f"{'':{width}}    {_tightest(tight)}"
    diagnostics = iter(problems_of(source, findings))
    for finding in findings:
        if finding.counterexample is None and finding.evidence.kind is Kind.PROVED:
            continue
        yield ""
        yield render(next(diagnostics), color=colored(sys.stdout))
        if finding.counterexample is not None:
            yield ""
            yield from replay_text(program, finding.counterexample, claims[finding.name])
    for finding in findings:
        for obligation in finding.obligations:
            if obligation.counterexample is not None:
                yield ""
                yield f"{finding.name}, {obligation.name}:"
                yield ""
                yield from replay_text(program, obligation.counterexample, claims[finding.name])


def _tightest(found: Tightest) -> str:
    extreme = found.extreme
    assert extreme.value is not None
    ways = "up" if found.upward else "down"
    reached = "attained" if extreme.attained else "not attained"
    return f"{found.text} goes {ways} to {float(extreme.value):.12g}, {reached}"


def _beside(finding: PropertyFinding) -> Iterator[tuple[str, Evidence]]:
    """What is worth a line beside the property's own evidence."""
    if finding.evidence.kind is Kind.UNKNOWN:
        return
    yield "binary64", finding.binary64
    yield "binary32", finding.binary32
    if finding.evidence.kind is Kind.PROVED:
        for obligation in finding.obligations:
            yield obligation.name, obligation.evidence


def replay_text(
    program: Program, replay: Replay, concerning: Property | None = None
) -> Iterator[str]:
    """The readings, oldest first, beside what the interpreter answered to the newest.

    Only the sensors and actions that a property concerns, if one is given.
    """
    interface, history = program.interface, replay.history
    everything = {s.name for s in interface.sensors} | {a.name for a in interface.actions}
    names = everything if concerning is None else concerned(program, concerning)
    actions = [spec for spec in interface.actions if spec.name in names]
    sensors = {name: values for name, values in history.readings.items() if name in names}
    looking_back = _looked_back_at(program, concerning)
    before = [f"{name} {_short(x)}" for name, x in history.previous.items() if name in looking_back]
    if before:
        yield f"  before: {', '.join(before)}"
    head = ["", *sensors]
    for spec in actions:
        head.extend(_columns(spec))
    length = max((len(readings) for readings in history.readings.values()), default=1)
    rows = [head]
    for place in range(length):
        number = place - length + len(replay.steps)
        row = [str(place - length), *(_short(readings[place]) for readings in sensors.values())]
        for spec in actions:
            if number < 0:
                row.extend("" for _ in _columns(spec))
                continue
            taken = replay.steps[number]
            if isinstance(spec.domain, Continuous):
                row.append(_short(taken.raw[spec.name]))
            row.append(_short(taken.applied[spec.name]))
        rows.append(row)
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    for row in rows:
        cells = (cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        yield ("  " + "  ".join(cells)).rstrip()


def _columns(spec: ActionSpec) -> list[str]:
    match spec.domain:
        case Continuous():
            return [f"raw({spec.name})", spec.name]
        case Choice():
            return [spec.name]


def _looked_back_at(program: Program, claim: Property | None) -> set[str]:
    """The actions whose value before the first step matters."""
    everything = (*program.bodies, *((claim.body,) if claim else ()))
    mentioned = (term for body in everything for term in subterms(body))
    return {term.action for term in mentioned if isinstance(term, PreviousAction)}


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
