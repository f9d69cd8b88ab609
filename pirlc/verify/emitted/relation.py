"""Which state of the emitted C stands for which state of the program.

The printer tells which member is meant to hold what; that is a guess which the proof puts to the
test, and a wrong guess makes it fail. Rings are given as they are seen from their oldest reading,
whose place may be any.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pirlc.backend.c import CPrinter
from pirlc.backend.c_expressions import is_ring
from pirlc.ir.controller import Kind
from pirlc.verify.emitted.graph import Graph
from pirlc.verify.emitted.meaning import Meaning, StateNodes, limit_of
from pirlc.verify.emitted.memory import Array, Memory
from pirlc.verify.emitted.nodes import Integer, Node, NotUnderstood, Places, describe
from pirlc.verify.emitted.syntax import LEAST_RANGE, CType, Member, Unit

STATE, INPUT, OUTPUT, PARAMETERS = "state", "in", "out", "params"
"""The names of the objects in the memory."""


@dataclass(frozen=True)
class Mismatch:
    """A part whose two values are not one node."""

    part: str
    emitted: Node
    program: Node


@dataclass(frozen=True)
class Relation:
    """Of one program and one translation unit; `members` are those of the state's struct."""

    meaning: Meaning
    printer: CPrinter
    members: Mapping[str, Member]

    @property
    def graph(self) -> Graph:
        return self.meaning.graph

    def expected(self, state: StateNodes) -> dict[str, tuple[Node, ...]]:
        """What each member holds, arrays oldest first. Raises `NotUnderstood` for a missing one."""
        graph, printer = self.graph, self.printer
        found: dict[str, tuple[Node, ...]] = {}
        real = CType(printer.real)
        for sensor, nodes, channel in zip(
            self.meaning.interface.sensors, state.sensors, printer.controller.channels, strict=True
        ):
            name = sensor.name
            if channel.kept:
                member = self._member(printer.buffers[name], real)
                found[member.name] = nodes.buffer[-(member.length or 1) :]
                if len(found[member.name]) != (member.length or 1):
                    raise NotUnderstood(f"{member.name} holds more readings than the program")
            found[self._member(printer.flags[name]).name] = (nodes.flags,)
            if name in printer.seen:
                found[self._member(printer.seen[name]).name] = (nodes.started,)
            if name in printer.counts:
                limit = limit_of(sensor)
                assert limit is not None
                most = graph.integer(limit)
                count = graph.choose(graph.at_most(nodes.absent, most), nodes.absent, most)
                found[self._member(printer.counts[name]).name] = (count,)
        for action, node, output in zip(
            self.meaning.interface.actions,
            state.previous,
            printer.controller.outputs,
            strict=True,
        ):
            if output.keeps_previous:
                type_ = real if output.kind is Kind.REAL else CType(printer.discrete)
                found[self._member(printer.previous[action.name], type_).name] = (node,)
        return found

    def rings(self) -> dict[str, tuple[str, int]]:
        """The members that are rings, with the member that says where their oldest reading is."""
        printer = self.printer
        found = {}
        for channel in printer.controller.channels:
            name = printer.buffers[channel.name]
            length = self.members[name].length if name in self.members else None
            if channel.kept and is_ring(channel) and length is not None:
                found[name] = self._member(printer.heads[channel.kept]).name, length
        return found

    def _member(self, name: str, type_: CType | None = None) -> Member:
        member = self.members.get(name)
        if member is None:
            raise NotUnderstood(f"the state has no {name}")
        if type_ is not None and member.type is not type_:
            raise NotUnderstood(f"{name} is of type {member.type.value}, not {type_.value}")
        if type_ is None and member.type not in LEAST_RANGE:
            raise NotUnderstood(f"{name} is of type {member.type.value}")
        return member

    def before(self, state: StateNodes) -> Memory:
        """The C's state that stands for a program's state, wherever its rings begin."""
        graph, rings = self.graph, self.rings()
        memory = blank(graph, STATE, tuple(self.members.values()))
        for head, length in rings.values():
            memory[STATE, head] = graph.places(head, tuple(range(length)))
        for name, nodes in self.expected(state).items():
            if self.members[name].length is None:
                memory[STATE, name] = nodes[0]
            else:
                memory[STATE, name] = Array(nodes, rings[name][0] if name in rings else "")
        return memory

    def mismatches(self, memory: Memory, state: StateNodes) -> list[Mismatch]:
        """Where the memory does not stand for the state."""
        found, rings = [], self.rings()
        for name, nodes in self.expected(state).items():
            held = memory[STATE, name]
            if not isinstance(held, Array):
                cells: tuple[Node, ...] = (held,)
            else:
                cells = held.settled(name).cells
                if name in rings:
                    cells = self._turned(cells, memory[STATE, rings[name][0]], *rings[name])
            what = f"state {name}"
            for age, (one, other) in enumerate(zip(reversed(cells), reversed(nodes), strict=True)):
                if one is not other:
                    part = what if len(nodes) == 1 else f"{what}, {age} steps ago"
                    found.append(Mismatch(part, one, other))
        return found

    def _turned(
        self, cells: tuple[Node, ...], place: Node | Array, head: str, length: int
    ) -> tuple[Node, ...]:
        """A ring's cells, oldest first, where its oldest reading is at `place`."""
        if isinstance(place, Integer) and 0 <= place.value < length:
            turn = place.value
        elif isinstance(place, Places) and place.ring == head:
            # Cells are told from where the oldest reading was before the step.
            if place.turn is None or len(place.values) != length:
                raise NotUnderstood(f"how {head} moves")
            turn = place.turn
        else:
            what = "an array" if isinstance(place, Array) else describe(place)
            raise NotUnderstood(f"{head} is {what}")
        return cells[turn:] + cells[:turn]


def blank(graph: Graph, object_: str, members: tuple[Member, ...]) -> Memory:
    """An object of which nothing is set."""
    memory: Memory = {}
    for member in members:
        if member.length is None:
            memory[object_, member.name] = graph.unset
        else:
            memory[object_, member.name] = Array((graph.unset,) * member.length)
    return memory


def check_struct(unit: Unit, struct: str, wanted: tuple[tuple[str, CType], ...]) -> None:
    """Raises `NotUnderstood` unless the struct has just these members, in this order."""
    members = unit.structs.get(struct)
    if members is None:
        raise NotUnderstood(f"there is no {struct}")
    have = tuple((member.name, member.type) for member in members if member.length is None)
    if not wanted:
        wanted = (("unused", CType.UNSIGNED_CHAR),)
    if have != wanted or len(have) != len(members):
        told = ", ".join(f"{type_.value} {name}" for name, type_ in wanted)
        raise NotUnderstood(f"{struct} is not {{ {told} }}")
