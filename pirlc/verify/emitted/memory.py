"""What the executed C's variables hold: nodes, and arrays of nodes."""

from __future__ import annotations

from dataclasses import dataclass, replace

from pirlc.verify.emitted.graph import Graph
from pirlc.verify.emitted.nodes import (
    Choice,
    Integer,
    Node,
    NotUnderstood,
    Places,
    Undefined,
    Unset,
    describe,
)
from pirlc.verify.emitted.syntax import CType


@dataclass(frozen=True)
class Place:
    """A variable or member: its key in the memory, its type, whether it may be written."""

    key: tuple[str, str]
    type: CType
    writable: bool


@dataclass(frozen=True)
class Array:
    """`cells` by index; where `ring` names one, by distance from its oldest reading's place.

    `pending` are writes to a ring at fixed indices: they mean something only once every index was
    written with the same value.
    """

    cells: tuple[Node, ...]
    ring: str = ""
    pending: tuple[tuple[int, Node], ...] = ()

    def read(self, index: Node, name: str) -> Node:
        node = self.cells[self._place(index, name)]
        if isinstance(node, Unset) or (isinstance(node, Choice) and node.unset):
            raise Undefined(f"{name} is read before it is set")
        return node

    def written(self, index: Node, value: Node, name: str) -> Array:
        if self.ring and isinstance(index, Integer):
            if not 0 <= index.value < len(self.cells):
                raise Undefined(f"the index {index.value} is outside of {name}")
            pending = {**dict(self.pending), index.value: value}
            if len(pending) < len(self.cells):
                return replace(self, pending=tuple(pending.items()))
            if any(other is not value for other in pending.values()):
                raise NotUnderstood(f"{name} is written at fixed places")
            return Array((value,) * len(self.cells), self.ring)
        place = self._place(index, name)
        return replace(self, cells=(*self.cells[:place], value, *self.cells[place + 1 :]))

    def settled(self, name: str) -> Array:
        if self.pending:
            raise NotUnderstood(f"{name} is written at some fixed places and not at all")
        return self

    def _place(self, index: Node, name: str) -> int:
        self.settled(name)
        count = len(self.cells)
        match index:
            case Integer(_, value) if not self.ring:
                if not 0 <= value < count:
                    raise Undefined(f"the index {value} is outside of {name}")
                return value
            case Places(_, ring, values, turn) if ring == self.ring:
                if turn is not None and len(values) == count:
                    return turn
                if any(value is None or not 0 <= value < count for value in values):
                    raise Undefined(f"an index outside of {name}")
                raise NotUnderstood(f"an index of {name} that does not turn with its ring")
            case _:
                raise NotUnderstood(f"{describe(index)} as an index of {name}")


Memory = dict[tuple[str, str], Node | Array]
"""Members by object and name, locals by function-wide number and name."""


def merged(graph: Graph, condition: Node, high: Memory, low: Memory) -> Memory:
    """What memory holds after an `if`; locals of one branch alone are gone."""
    result: Memory = {}
    for key, one in high.items():
        other = low.get(key)
        if other is None:
            continue
        if one is other:
            result[key] = one
        elif isinstance(one, Array) and isinstance(other, Array):
            one, other = one.settled(key[1]), other.settled(key[1])
            cells = tuple(
                graph.choose(condition, a, b) for a, b in zip(one.cells, other.cells, strict=True)
            )
            result[key] = replace(one, cells=cells)
        else:
            assert not isinstance(one, Array) and not isinstance(other, Array)
            result[key] = graph.choose(condition, one, other)
    return result
