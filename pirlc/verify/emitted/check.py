"""Compares emitted C with its program, part by part."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from pirlc.backend.c import CPrinter, c_files
from pirlc.backend.files import Provenance
from pirlc.backend.numbers import PRECISIONS, RealType
from pirlc.ir.controller import Controller
from pirlc.ir.evidence import REFUTED, Evidence, unknown
from pirlc.ir.evidence import Kind as EvidenceKind
from pirlc.ir.policy import Program
from pirlc.lower import lower
from pirlc.verify.emitted.example import example_of
from pirlc.verify.emitted.graph import Graph
from pirlc.verify.emitted.loading import Loaded, defaults, load
from pirlc.verify.emitted.machine import Machine
from pirlc.verify.emitted.meaning import Meaning, StateNodes
from pirlc.verify.emitted.memory import Array
from pirlc.verify.emitted.nodes import LimitReached, Node, NotUnderstood
from pirlc.verify.emitted.preprocess import guard_faults
from pirlc.verify.emitted.relation import (
    INPUT,
    OUTPUT,
    PARAMETERS,
    STATE,
    Relation,
    blank,
)
from pirlc.verify.emitted.telling import apart
from pirlc.verify.findings import Difference, EmittedFinding

_LIMIT = "limit reached: the program is too large to compare"
_WIDE = "where int has 32 bits"
_DEEPEST = 6_000


def check_emitted(program: Program, real: RealType = "double") -> EmittedFinding:
    """Whether the C that is emitted for a program is that program."""
    controller = lower(program)
    header, source = c_files(controller, real, Provenance(program.interface.name))
    return _checked(program, controller, header.text, source.text, real)


def check_text(
    program: Program, header: str, source: str, real: RealType = "double"
) -> EmittedFinding:
    """The same of a given header and source."""
    return _checked(program, lower(program), header, source, real)


def _checked(
    program: Program, controller: Controller, header: str, source: str, real: RealType
) -> EmittedFinding:
    start = time.perf_counter()
    with _deep():
        return _compared(program, controller, header, source, real, start)


@contextmanager
def _deep() -> Iterator[None]:
    """Room for nesting: an `else if` of C lies inside the one before."""
    before = sys.getrecursionlimit()
    sys.setrecursionlimit(max(before, _DEEPEST))
    try:
        yield
    finally:
        sys.setrecursionlimit(before)


def _compared(
    program: Program,
    controller: Controller,
    header: str,
    source: str,
    real: RealType,
    start: float,
) -> EmittedFinding:
    # Most programs are small in either order of their conditions, some in one alone.
    for older_first in (False, True):
        graph = Graph(older_first=older_first)
        comparison = Comparison(program, CPrinter(controller, real), real, graph)
        evidence = Evidence(EvidenceKind.PROVED)
        try:
            comparison.run(header, source)
            break
        except (LimitReached, RecursionError):
            evidence = unknown(_LIMIT)
    if comparison.needs_wide_int and evidence.kind is EvidenceKind.PROVED:
        evidence = Evidence(evidence.kind, _WIDE)
    differences = tuple(comparison.differences)
    if differences:
        example = example_of(program, header, source, comparison.printer, real)
        evidence = unknown("not shown to be equal")
        if example is not None:
            evidence = REFUTED
            differences = (example, *differences)
    seconds = time.perf_counter() - start
    return EmittedFinding(real, evidence, seconds, tuple(comparison.compared), differences)


class Comparison:
    """One comparison: what was compared, and what differs."""

    def __init__(self, program: Program, printer: CPrinter, real: RealType, graph: Graph) -> None:
        self.printer, self.real = printer, real
        self.meaning = Meaning(graph, program, PRECISIONS[real])
        self.compared: list[str] = []
        self.differences: list[Difference] = []
        self.needs_wide_int = False

    def run(self, header: str, source: str) -> None:
        try:
            loaded = load(header, source, self.printer, self.real)
        except NotUnderstood as reason:
            self._refuse("source", reason)
            return
        self.compared += ["refusals of other platforms", "components in the header"]
        self._components(header)
        for fault in guard_faults(source, loaded.stem, self.real):
            self.differences.append(Difference("platform", fault, "refuses what changes results"))
        for part, compare in (
            ("default parameters", self._defaults),
            ("reset", self._reset),
            ("step", self._step),
        ):
            try:
                compare(loaded)
            except NotUnderstood as reason:
                self._refuse(part, reason)

    def _refuse(self, part: str, reason: NotUnderstood) -> None:
        self.differences.append(Difference(part, f"not understood: {reason}", ""))

    def _components(self, header: str) -> None:
        """The header's words on which component of an observation each reading is."""
        for sensor in self.meaning.interface.sensors:
            member = self.printer.inputs[sensor.name]
            wanted = rf"\b{member}; /\* .*, component {sensor.index}, "
            if not re.search(wanted, header):
                self.differences.append(
                    Difference(f"component of {member}", "", f"component {sensor.index}")
                )

    def _defaults(self, loaded: Loaded) -> None:
        self.compared.append("default parameters")
        held = defaults(self.meaning.graph, loaded)
        for name, value in self.meaning.program.values.items():
            member = self.printer.parameters[name]
            self._same(f"default {member}", held[PARAMETERS, member], self.meaning.real(value))

    def _reset(self, loaded: Loaded) -> None:
        graph, members = self.meaning.graph, loaded.unit.structs[loaded.struct("state")]
        machine = Machine(graph, loaded.unit, blank(graph, STATE, members))
        machine.run(loaded.unit.functions[f"{loaded.stem}_reset"], loaded.objects())
        self._note("after reset, ", loaded, machine, self.meaning.initial())

    def _step(self, loaded: Loaded) -> None:
        meaning, graph, unit = self.meaning, self.meaning.graph, loaded.unit
        state = meaning.any_state()
        relation = self._relation(loaded)
        memory = relation.before(state)
        readings = {s.name: meaning.reading(s) for s in meaning.interface.sensors}
        after = meaning.step(state, readings)
        for lack in meaning.invariant(after.state) + meaning.invariant(meaning.initial()):
            self.differences.append(Difference("program", "", f"not shown: {lack}"))
        for object_, kind in ((OUTPUT, "action"), (INPUT, "observation"), (PARAMETERS, "params")):
            memory |= blank(graph, object_, unit.structs[loaded.struct(kind)])
        for name, node in readings.items():
            memory[INPUT, self.printer.inputs[name]] = node
        for name in meaning.program.values:
            memory[PARAMETERS, self.printer.parameters[name]] = meaning.parameter(name)
        machine = Machine(graph, unit, memory)
        status = machine.run(unit.functions[f"{loaded.stem}_step"], loaded.objects())
        assert status is not None
        for action, node in zip(meaning.interface.actions, after.actions, strict=True):
            self.compared.append(f"action {action.name}")
            held = machine.memory[OUTPUT, self.printer.actions[action.name]]
            self._same(f"action {action.name}", held, node)
        self.compared.append("status")
        self._same("status", status, after.status)
        self._note("", loaded, machine, after.state)

    def _note(self, when: str, loaded: Loaded, machine: Machine, state: StateNodes) -> None:
        self.needs_wide_int |= machine.needs_wide_int
        relation = self._relation(loaded)
        self.compared += [f"{when}state {name}" for name in relation.expected(state)]
        for mismatch in relation.mismatches(machine.memory, state):
            self._same(f"{when}{mismatch.part}", mismatch.emitted, mismatch.program)

    def _relation(self, loaded: Loaded) -> Relation:
        members = loaded.unit.structs[loaded.struct("state")]
        return Relation(self.meaning, self.printer, {m.name: m for m in members})

    def _same(self, part: str, emitted: Node | Array, program: Node) -> None:
        assert not isinstance(emitted, Array)
        if emitted is not program:
            where, one, other = apart(emitted, program)
            one = f"{one} (where {where})" if where else one
            self.differences.append(Difference(part, one, other))
