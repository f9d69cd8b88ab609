"""Values as nodes: equal nodes are one object, so that equality is identity.

Grammar::

    Node ::= Real x | Variable v | Operation op Node* | Integer n | Counter v + k
           | Places ring (n?)* | Unset | Choice Atom Node Node
    Atom ::= nan Node | Node <= x | Node < Node | Node <= Node | free name

Operations on numbers are opaque: the same operation of the same precision on the same nodes is the
same node, and nothing else is known of it (but `x - x`, which is +0 or NaN, and the sign of a
constant). What depends on conditions is a decision diagram: `Choice` nodes in one fixed order of
their atoms, without redundant tests, so that two equal functions of the atoms are one node. Truth
values are diagrams over the integers 1 and 0.

Comparisons are IEEE's: `nan x` is an atom, every comparison is false under it, and what is left is
order. The atoms about one number's place among constants (`x <= c`, for any `c`) stand side by
side, smallest first, and imply each other upwards; where one holds, the next are not asked. So
`low <= x and x <= high` implies `x is finite` without being told. Two numbers' order is one such
group of two atoms: `a < b`, `a <= b`.

Younger groups are asked first: a fold over `if`s is then a list, not a tree.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass, field

from pirlc.ir.operators import Operator
from pirlc.semantics.interpreter import ARITHMETIC
from pirlc.semantics.precision import BINARY32, BINARY64, Precision
from pirlc.verify.emitted.numbers import LARGEST, below

MOST_NODES = 600_000
"""More nodes than this and the proof is given up: the limit is a count, so that it is the same on
every machine."""


class LimitReached(Exception):
    """The proof would take too long."""


class NotUnderstood(Exception):
    """What the C does is outside what is modelled; the argument says what."""


class Undefined(NotUnderstood):
    """C gives it no meaning, should it come to it."""


@dataclass(eq=False, slots=True)
class Real:
    """A constant of a format; all NaNs are one."""

    serial: int
    value: float
    precision: Precision


@dataclass(eq=False, slots=True)
class Variable:
    """Any number of the format, NaN and infinities too; an integer where there is no format."""

    serial: int
    name: str
    precision: Precision | None


@dataclass(eq=False, slots=True)
class Operation:
    serial: int
    name: str
    precision: Precision
    arguments: tuple[Node, ...]


@dataclass(eq=False, slots=True)
class Integer:
    serial: int
    value: int


@dataclass(eq=False, slots=True)
class Counter:
    """`variable + offset`, in [low, high]."""

    serial: int
    variable: Variable
    offset: int
    low: int
    high: int


@dataclass(eq=False, slots=True)
class Places:
    """An integer for every place where a ring's oldest reading may stand; None is no integer.

    `turn`: how far, from each such place, the integer is along the ring; None if that differs, or
    some integer is no place of the ring.
    """

    serial: int
    ring: str
    values: tuple[int | None, ...]
    turn: int | None


@dataclass(eq=False, slots=True)
class Unset:
    """What a variable holds that was never written."""

    serial: int


@dataclass(eq=False, slots=True)
class Choice:
    """`high` where the atom holds, else `low`."""

    serial: int
    atom: Atom
    high: Node
    low: Node
    constant: bool
    unset: bool


Node = Real | Variable | Operation | Integer | Counter | Places | Unset | Choice


@dataclass(eq=False, slots=True)
class Atom:
    """`key` is the place in the order; atoms of a `ladder` imply the next of their group."""

    key: tuple[int, int, float]
    ladder: bool
    subjects: tuple[Node, ...]
    name: str = ""


class _Group:
    """Atoms about the same: one number and constants, or two numbers."""

    def __init__(self, number: int, subjects: tuple[Node, ...]) -> None:
        self.number = number
        self.subjects = subjects
        self.atoms: dict[float, Atom] = {}
        self.nan: Atom | None = None

    def rung(self, place: float) -> Atom:
        if place not in self.atoms:
            self.atoms[place] = Atom((-self.number, 1, place), True, self.subjects)
        return self.atoms[place]


@dataclass
class Graph:
    """Makes nodes, each once. With `folding`, operations on constants are computed: what is built
    from constants alone is then a constant."""

    folding: bool = False
    _nodes: dict[object, Node] = field(default_factory=dict)
    _groups: dict[object, _Group] = field(default_factory=dict)
    _chosen: dict[tuple[Node, Node, Node], Node] = field(default_factory=dict)
    _mapped: dict[object, Node] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.false = self.integer(0)
        self.true = self.integer(1)
        self.unset: Node = self._made("unset", lambda n: Unset(n))

    def _made(self, key: object, make: Callable[[int], Node]) -> Node:
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
        return self._made(("real", bits, precision), lambda n: Real(n, value, precision))

    def variable(self, name: str, precision: Precision | None) -> Node:
        return self._made(("variable", name, precision), lambda n: Variable(n, name, precision))

    def integer(self, value: int) -> Node:
        return self._made(("integer", value), lambda n: Integer(n, value))

    def counter(self, name: str, low: int, high: int) -> Node:
        """Any integer in [low, high]."""
        return self._counted(self.variable(name, None), 0, low, high)

    def _counted(self, variable: Node, offset: int, low: int, high: int) -> Node:
        assert isinstance(variable, Variable)
        if low == high:
            return self.integer(low)
        key = ("counter", variable, offset)
        return self._made(key, lambda n: Counter(n, variable, offset, low, high))

    def places(self, ring: str, values: tuple[int | None, ...]) -> Node:
        first = values[0]
        if first is not None and all(value == first for value in values):
            return self.integer(first)
        return self._made(
            ("places", ring, values), lambda n: Places(n, ring, values, _turn(values))
        )

    def free(self, name: str) -> Node:
        """A truth value that may be either."""
        group = self._group(("free", name), ())
        if group.nan is None:
            group.nan = Atom((-group.number, 0, 0.0), False, (), name)
        return self._choice(group.nan, self.true, self.false)

    # Decision diagrams

    def _group(self, key: object, subjects: tuple[Node, ...]) -> _Group:
        group = self._groups.get(key)
        if group is None:
            group = self._groups[key] = _Group(len(self._groups), subjects)
        return group

    def _choice(self, atom: Atom, high: Node, low: Node) -> Node:
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
        return self._made(key, lambda n: Choice(n, atom, high, low, constant, unset))

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
            known = self._choice(
                atom,
                self.choose(_under(condition, atom), _under(high, atom), _under(low, atom)),
                self.choose(_without(condition, atom), _without(high, atom), _without(low, atom)),
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
            test = self._choice(node.atom, self.true, self.false)
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

    # Numbers

    def operation(self, operator: Operator, precision: Precision, *arguments: Node) -> Node:
        """An IEEE operation, rounded once to the precision, which is that of the arguments."""
        constants = [a for a in arguments if isinstance(a, Real)]
        all_constant = len(constants) == len(arguments)
        if all_constant and (self.folding or operator is Operator.NEGATE):
            values = [a.value for a in constants]
            return self.real(precision.round(ARITHMETIC[operator](*values)), precision)
        if operator is Operator.SUBTRACT and arguments[0] is arguments[1]:
            zero, nan = self.real(0.0, precision), self.real(math.nan, precision)
            return self.choose(self.is_finite(arguments[0]), zero, nan)
        return self._opaque(operator.value, precision, arguments)

    def converted(self, node: Node, precision: Precision) -> Node:
        """A number of the other format, rounded to this one."""
        if isinstance(node, Real):
            return self.real(precision.round(node.value), precision)
        return self._opaque("convert", precision, (node,))

    def _opaque(self, name: str, precision: Precision, arguments: tuple[Node, ...]) -> Node:
        key = (name, precision, arguments)
        return self._made(key, lambda n: Operation(n, name, precision, arguments))

    def is_nan(self, x: Node) -> Node:
        if isinstance(x, Real):
            return self.true if x.value != x.value else self.false
        if isinstance(x, Choice) and x.constant:
            return self.mapped("nan", self.is_nan, x)
        group = self._group(("number", x), (x,))
        if group.nan is None:
            group.nan = Atom((-group.number, 0, 0.0), False, (x,))
        return self._choice(group.nan, self.true, self.false)

    def is_finite(self, x: Node) -> Node:
        precision = precision_of(x)
        low, high = (self.real(m, precision) for m in (-LARGEST[precision], LARGEST[precision]))
        return self.both(
            self.compared(Operator.GREATER_EQUAL, x, low),
            self.compared(Operator.LESS_EQUAL, x, high),
        )

    def compared(self, operator: Operator, left: Node, right: Node) -> Node:
        """A comparison of two numbers of one format; false with a NaN, `!=` true."""
        match operator:
            case Operator.NOT_EQUAL:
                return self.negation(self.compared(Operator.EQUAL, left, right))
            case Operator.GREATER:
                return self.compared(Operator.LESS, right, left)
            case Operator.GREATER_EQUAL:
                return self.compared(Operator.LESS_EQUAL, right, left)
            case _:
                pass
        for side in (left, right):
            if isinstance(side, Choice) and side.constant:
                return self.mapped2(
                    operator, lambda a, b: self.compared(operator, a, b), left, right
                )
        if isinstance(left, Real) and isinstance(right, Real):
            a, b = left.value, right.value
            holds = {Operator.LESS: a < b, Operator.LESS_EQUAL: a <= b, Operator.EQUAL: a == b}
            return self.true if holds[operator] else self.false
        ordered = self.negation(self.either(self.is_nan(left), self.is_nan(right)))
        if operator is Operator.LESS:
            return self.both(ordered, self._is_below(left, right))
        if operator is Operator.LESS_EQUAL:
            return self.both(ordered, self.negation(self._is_below(right, left)))
        apart = self.either(self._is_below(left, right), self._is_below(right, left))
        return self.both(ordered, self.negation(apart))

    def _is_below(self, left: Node, right: Node) -> Node:
        """`left < right` of numbers that are not NaN (else anything)."""
        if left is right:
            return self.false
        if isinstance(left, Real):
            # c < x: not x <= c
            return self.negation(self._rung(right, left.value))
        if isinstance(right, Real):
            if right.value == -math.inf:
                return self.false
            return self._rung(left, below(right.value, right.precision))
        if left.serial < right.serial:
            return self._pair(left, right, 1.0)
        return self.negation(self._pair(right, left, 2.0))

    def _rung(self, x: Node, place: float) -> Node:
        """`x <= place`."""
        if place != place:
            return self.false
        if place == math.inf:
            return self.true
        group = self._group(("number", x), (x,))
        rung = group.rung(place if isinstance(place, int) else place + 0.0)  # +0 for -0
        return self._choice(rung, self.true, self.false)

    def _pair(self, left: Node, right: Node, place: float) -> Node:
        group = self._group(("pair", left, right), (left, right))
        return self._choice(group.rung(place), self.true, self.false)

    # Integers

    def at_most(self, left: Node, right: Node) -> Node:
        """`left <= right` of integers."""
        return self.mapped2("<=", self._at_most, left, right)

    def same(self, left: Node, right: Node) -> Node:
        """`left == right` of integers."""
        return self.mapped2("==", self._same, left, right)

    def _at_most(self, left: Node, right: Node) -> Node:
        match left, right:
            case ((Integer() | Places()), (Integer() | Places())):
                return self._placewise(lambda a, b: int(a <= b), left, right)
            case Counter(), Integer():
                return self._bounded(left, right.value)
            case Integer(), Counter():
                return self.negation(self._bounded(right, left.value - 1))
            case (Variable(precision=None), Integer()):
                return self._rung(left, right.value)
            case (Integer(), Variable(precision=None)):
                return self.negation(self._rung(right, left.value - 1))
            case (Variable(precision=None), Variable(precision=None)):
                return self.negation(self._is_below(right, left))
            case _:
                raise NotUnderstood(f"{describe(left)} compared with {describe(right)}")

    def _same(self, left: Node, right: Node) -> Node:
        if isinstance(left, Integer | Places) and isinstance(right, Integer | Places):
            return self._placewise(lambda a, b: int(a == b), left, right)
        return self.both(self._at_most(left, right), self._at_most(right, left))

    def _bounded(self, counter: Counter, bound: int) -> Node:
        if bound >= counter.high:
            return self.true
        if bound < counter.low:
            return self.false
        return self._rung(counter.variable, bound - counter.offset)

    def _placewise(self, change: Callable[[int, int], int | None], *sides: Node) -> Node:
        """An operation on integers, one of which may depend on a ring's place."""
        rings = [side for side in sides if isinstance(side, Places)]
        if not rings:
            left, right = sides
            assert isinstance(left, Integer) and isinstance(right, Integer)
            result = change(left.value, right.value)
            if result is None:
                raise Undefined("an integer operation that overflows")
            return self.integer(result)
        ring, count = rings[0].ring, len(rings[0].values)
        if any(other.ring != ring for other in rings):
            raise NotUnderstood("the places of two rings in one expression")
        columns = []
        for side in sides:
            if isinstance(side, Places):
                columns.append(side.values)
            else:
                assert isinstance(side, Integer)
                columns.append((side.value,) * count)
        values = tuple(
            None if a is None or b is None else change(a, b) for a, b in zip(*columns, strict=True)
        )
        return self.places(ring, values)

    def sum(self, left: Node, right: Node, sign: int, low: int, high: int) -> Node:
        """`left + sign * right` of integers whose result must lie in [low, high]."""

        def add(a: Node, b: Node) -> Node:
            if isinstance(a, Integer) and isinstance(b, Counter) and sign == 1:
                a, b = b, a
            match a, b:
                case ((Integer() | Places()), (Integer() | Places())):
                    return self._placewise(
                        lambda x, y: x + sign * y if low <= x + sign * y <= high else None, a, b
                    )
                case Counter(), Integer():
                    change = sign * b.value
                    if a.low + change < low or a.high + change > high:
                        raise NotUnderstood(f"a count that may overflow: {describe(a)}")
                    return self._counted(
                        a.variable, a.offset + change, a.low + change, a.high + change
                    )
                case _:
                    raise NotUnderstood(f"a sum of {describe(a)} and {describe(b)}")

        return self.mapped2(("sum", sign, low, high), add, left, right)

    def bits_of_either(self, left: Node, right: Node) -> Node:
        """Bitwise or of integers that are known."""
        if left is self.false:
            return right
        if right is self.false:
            return left
        if isinstance(right, Choice) and (
            not isinstance(left, Choice) or right.atom.key < left.atom.key
        ):
            # The upper diagram first: the lower one is then joined whole, not taken apart.
            left, right = right, left
        if isinstance(left, Choice):
            return self.mapped(("|", right), lambda a: self.bits_of_either(a, right), left)
        if (
            isinstance(left, Integer)
            and isinstance(right, Integer)
            and min(left.value, right.value) >= 0
        ):
            return self.integer(left.value | right.value)
        raise NotUnderstood(f"{describe(left)} | {describe(right)}")

    def selected(self, condition: Node, high: Node, low: Node) -> Node:
        """As `choose`, where the condition may also depend on a ring's place."""
        if not isinstance(condition, Places):
            return self.choose(condition, high, low)
        columns: list[tuple[int | None, ...]] = []
        for side in (high, low):
            match side:
                case Integer(_, value):
                    columns.append((value,) * len(condition.values))
                case Places(_, ring, values) if ring == condition.ring:
                    columns.append(values)
                case _:
                    raise NotUnderstood(f"{describe(side)}, chosen by a ring's place")
        values = tuple(
            None if test is None else a if test else b
            for test, a, b in zip(condition.values, *columns, strict=True)
        )
        return self.places(condition.ring, values)


def _turn(values: tuple[int | None, ...]) -> int | None:
    count, first = len(values), values[0]
    if first is None:
        return None
    fits = all(value == (first + i) % count for i, value in enumerate(values))
    return first if fits else None


def _under(node: Node, atom: Atom) -> Node:
    """The node where the atom, which is no later than any of its own, holds."""
    if isinstance(node, Choice) and (
        node.atom is atom or (atom.ladder and node.atom.ladder and node.atom.key[0] == atom.key[0])
    ):
        return node.high
    return node


def _without(node: Node, atom: Atom) -> Node:
    return node.low if isinstance(node, Choice) and node.atom is atom else node


def precision_of(node: Node) -> Precision:
    """The format of a number; a diagram's leaves are of one."""
    while isinstance(node, Choice):
        node = node.high if not isinstance(node.high, Unset) else node.low
    match node:
        case Real() | Operation():
            return node.precision
        case Variable(_, _, precision) if precision is not None:
            return precision
        case _:
            raise NotUnderstood(f"{describe(node)}, where a number belongs")


def is_integer(node: Node) -> bool:
    """Whether a diagram's leaves are integers."""
    while isinstance(node, Choice):
        node = node.high if not isinstance(node.high, Unset) else node.low
    return isinstance(node, Integer | Counter | Places) or (
        isinstance(node, Variable) and node.precision is None
    )


def describe(node: Node, most: int = 160) -> str:
    """The node in words, cut off where it gets long."""
    text = _text(node, 5)
    return text if len(text) <= most else f"{text[: most - 4]} ..."


_INFIX = {"+", "-", "*", "/"}


def _text(node: Node, depth: int) -> str:
    if depth < 0:
        return "..."
    match node:
        case Real(_, value, precision):
            return f"{value!r}{'f' if precision is BINARY32 else ''}"
        case Variable(_, name):
            return name
        case Operation(_, name, precision, arguments):
            inside = [_text(a, depth - 1) for a in arguments]
            if name in _INFIX:
                return f"({inside[0]} {name} {inside[1]})"
            if name == "convert":
                name = "double" if precision is BINARY64 else "float"
            return f"{name}({', '.join(inside)})"
        case Integer(_, value):
            return str(value)
        case Counter(_, variable, offset):
            return f"{variable.name} + {offset}" if offset else variable.name
        case Places(_, ring, _):
            return f"a place of {ring}"
        case Unset():
            return "a variable that was never set"
        case Choice(_, atom, high, low):
            return (
                f"({_atom_text(atom, depth - 1)} ? {_text(high, depth - 1)}"
                f" : {_text(low, depth - 1)})"
            )


def _atom_text(atom: Atom, depth: int) -> str:
    if not atom.subjects:
        return atom.name
    inside = [_text(x, depth) for x in atom.subjects]
    if not atom.ladder:
        return f"isnan({inside[0]})"
    if len(inside) == 1:
        return f"{inside[0]} <= {atom.key[2]!r}"
    return f"{inside[0]} {'<' if atom.key[2] == 1.0 else '<='} {inside[1]}"
