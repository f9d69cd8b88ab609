"""Decision diagrams: values that depend on conditions, each made once (see `graph`)."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field

from pirlc.semantics.precision import Precision
from pirlc.verify.emitted.nodes import (
    Atom,
    Choice,
    Counter,
    Integer,
    LimitReached,
    Node,
    NotUnderstood,
    Places,
    Real,
    Unset,
    Variable,
    describe,
)

MOST_NODES = 250_000
"""More nodes than this and the proof is given up: the limit is a count, so that it is the same on
every machine."""


class _Group:
    """Atoms about the same: one number and constants, or two numbers."""

    def __init__(self, number: int, subjects: tuple[Node, ...]) -> None:
        self.number = number
        self.subjects = subjects
        self.atoms: dict[float, Atom] = {}
        self.nan: Atom | None = None

    def rung(self, place: float) -> Atom:
        if place not in self.atoms:
            self.atoms[place] = Atom((self.number, 1, place), True, self.subjects)
        return self.atoms[place]


@dataclass
class Diagrams:
    """Makes nodes, each once. With `folding`, operations on constants are computed: what is built
    from constants alone is then a constant. `older_first`: the order of the groups of atoms."""

    folding: bool = False
    older_first: bool = False
    _nodes: dict[object, Node] = field(default_factory=dict)
    _groups: dict[object, _Group] = field(default_factory=dict)
    _chosen: dict[tuple[Node, Node, Node], Node] = field(default_factory=dict)
    _mapped: dict[object, Node] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.false = self.integer(0)
        self.true = self.integer(1)
        self.unset: Node = self.made("unset", lambda n: Unset(n))

    @property
    def size(self) -> int:
        """The number of nodes made so far."""
        return len(self._nodes)

    def made(self, key: object, make: Callable[[int], Node]) -> Node:
        node = self._nodes.get(key)
        if node is None:
            serial = len(self._nodes)
            if serial > MOST_NODES:
                raise LimitReached
            node = self._nodes[key] = make(serial)
        return node

    # Leaves

    def real(self, value: float, precision: Precision) -> Node:
        bits = b"nan" if value != value else struct.pack("<d", value)
        return self.made(("real", bits, precision), lambda n: Real(n, value, precision))

    def variable(self, name: str, precision: Precision | None) -> Node:
        return self.made(("variable", name, precision), lambda n: Variable(n, name, precision))

    def integer(self, value: int) -> Node:
        return self.made(("integer", value), lambda n: Integer(n, value))

    def counter(self, name: str, low: int, high: int) -> Node:
        """Any integer in [low, high]."""
        return self.counted(self.variable(name, None), 0, low, high)

    def counted(self, variable: Node, offset: int, low: int, high: int) -> Node:
        assert isinstance(variable, Variable)
        if low == high:
            return self.integer(low)
        key = ("counter", variable, offset)
        return self.made(key, lambda n: Counter(n, variable, offset, low, high))

    def places(self, ring: str, values: tuple[int | None, ...]) -> Node:
        first = values[0]
        if first is not None and all(value == first for value in values):
            return self.integer(first)
        return self.made(("places", ring, values), lambda n: Places(n, ring, values, _turn(values)))

    def free(self, name: str) -> Node:
        """A truth value that may be either."""
        group = self.group(("free", name), ())
        if group.nan is None:
            group.nan = Atom((group.number, 0, 0.0), False, (), name)
        return self.choice(group.nan, self.true, self.false)

    # Decision diagrams

    def group(self, key: object, subjects: tuple[Node, ...]) -> _Group:
        group = self._groups.get(key)
        if group is None:
            number = len(self._groups)
            number = number if self.older_first else -number
            group = self._groups[key] = _Group(number, subjects)
        return group

    def choice(self, atom: Atom, high: Node, low: Node) -> Node:
        if high is low:
            return low
        if (
            atom.ladder
            and isinstance(low, Choice)
            and low.atom.ladder
            and low.atom.key[0] == atom.key[0]
            and low.high is high
        ):
            return low
        constant = all(
            isinstance(side, Real | Integer) or (isinstance(side, Choice) and side.constant)
            for side in (high, low)
        )
        unset = any(
            isinstance(side, Unset) or (isinstance(side, Choice) and side.unset)
            for side in (high, low)
        )
        key = ("choice", atom, high, low)
        return self.made(key, lambda n: Choice(n, atom, high, low, constant, unset))

    def choose(self, condition: Node, high: Node, low: Node) -> Node:
        """`high` where the condition (a diagram over 1 and 0) holds, else `low`."""
        if condition is self.true or high is low:
            return high
        if condition is self.false:
            return low
        if high is self.true and low is self.false:
            return condition
        if not isinstance(condition, Choice):
            raise NotUnderstood(f"a condition that is {describe(condition)}")
        key = (condition, high, low)
        known = self._chosen.get(key)
        if known is None:
            atom = condition.atom
            for side in (high, low):
                if isinstance(side, Choice) and side.atom.key < atom.key:
                    atom = side.atom
            known = self.choice(
                atom,
                self.choose(under(condition, atom), under(high, atom), under(low, atom)),
                self.choose(without(condition, atom), without(high, atom), without(low, atom)),
            )
            self._chosen[key] = known
        return known

    def mapped(self, key: object, change: Callable[[Node], Node], node: Node) -> Node:
        """`change` of every leaf of a diagram; `key` tells this change from others."""
        if not isinstance(node, Choice):
            return change(node)
        name = (key, node)
        known = self._mapped.get(name)
        if known is None:
            high = self.mapped(key, change, node.high)
            low = self.mapped(key, change, node.low)
            # Through `choose`, since what leaves become may ask atoms that come before this one.
            test = self.choice(node.atom, self.true, self.false)
            known = self._mapped[name] = self.choose(test, high, low)
        return known

    def mapped2(
        self, key: object, change: Callable[[Node, Node], Node], left: Node, right: Node
    ) -> Node:
        """The same of two diagrams' leaves, pair by pair."""
        name = (key, left, right)
        known = self._mapped.get(name)
        if known is None:
            known = self._mapped[name] = self.mapped(
                (key, right, "left"),
                lambda a: self.mapped((key, a, "right"), lambda b: change(a, b), right),
                left,
            )
        return known

    def negation(self, condition: Node) -> Node:
        return self.choose(condition, self.false, self.true)

    def both(self, left: Node, right: Node) -> Node:
        return self.choose(left, right, self.false)

    def either(self, left: Node, right: Node) -> Node:
        return self.choose(left, self.true, right)


def _turn(values: tuple[int | None, ...]) -> int | None:
    count, first = len(values), values[0]
    if first is None:
        return None
    fits = all(value == (first + i) % count for i, value in enumerate(values))
    return first if fits else None


def under(node: Node, atom: Atom) -> Node:
    """The node where the atom, which is no later than any of its own, holds."""
    if isinstance(node, Choice) and (
        node.atom is atom or (atom.ladder and node.atom.ladder and node.atom.key[0] == atom.key[0])
    ):
        return node.high
    return node


def without(node: Node, atom: Atom) -> Node:
    """The node where the atom, which is no later than any of its own, does not hold."""
    return node.low if isinstance(node, Choice) and node.atom is atom else node
