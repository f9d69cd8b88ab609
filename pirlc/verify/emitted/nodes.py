"""The nodes that values are, before anything is known of how they are made (`graph`).

Grammar::

    Node ::= Real x | Variable v | Operation op Node* | Integer n | Counter v + k
           | Places ring (n?)* | Unset | Choice Atom Node Node
    Atom ::= nan Node | Node <= x | Node < Node | Node <= Node | free name
"""

from __future__ import annotations

from dataclasses import dataclass

from pirlc.semantics.precision import BINARY32, BINARY64, Precision


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
                f"({atom_text(atom, depth - 1)} ? {_text(high, depth - 1)}"
                f" : {_text(low, depth - 1)})"
            )


def atom_text(atom: Atom, depth: int) -> str:
    """The condition in words, terms in it cut off below `depth`."""
    if not atom.subjects:
        return atom.name
    inside = [_text(x, depth) for x in atom.subjects]
    if not atom.ladder:
        return f"isnan({inside[0]})"
    if len(inside) == 1:
        return f"{inside[0]} <= {atom.key[2]!r}"
    return f"{inside[0]} {'<' if atom.key[2] == 1.0 else '<='} {inside[1]}"
