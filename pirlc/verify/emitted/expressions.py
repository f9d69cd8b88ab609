"""Evaluates the expressions of emitted C on nodes; they have no side effects."""

from __future__ import annotations

import math
from typing import Any

from pirlc.ir.operators import Operator
from pirlc.semantics.precision import BINARY32, BINARY64
from pirlc.verify.emitted.graph import Graph
from pirlc.verify.emitted.memory import Array, Memory, Place
from pirlc.verify.emitted.nodes import (
    Choice,
    Counter,
    Integer,
    Node,
    NotUnderstood,
    Places,
    Undefined,
    Unset,
    describe,
)
from pirlc.verify.emitted.numbers import decimal
from pirlc.verify.emitted.syntax import LEAST_RANGE, USUAL_RANGE, CType, Member, Unit

_ARITHMETIC = {
    "+": Operator.ADD,
    "-": Operator.SUBTRACT,
    "*": Operator.MULTIPLY,
    "/": Operator.DIVIDE,
}
_COMPARISONS = {
    "<": Operator.LESS,
    "<=": Operator.LESS_EQUAL,
    ">": Operator.GREATER,
    ">=": Operator.GREATER_EQUAL,
    "==": Operator.EQUAL,
    "!=": Operator.NOT_EQUAL,
}
_FUNCTIONS = {
    name + suffix: (operator, type_)
    for suffix, type_ in (("", CType.DOUBLE), ("f", CType.FLOAT))
    for name, operator in (
        ("fabs", Operator.ABS),
        ("sqrt", Operator.SQRT),
        ("exp", Operator.EXP),
        ("tanh", Operator.TANH),
    )
}
_RANKS = (
    CType.INT,
    CType.UNSIGNED,
    CType.LONG,
    CType.UNSIGNED_LONG,
    CType.LONG_LONG,
    CType.UNSIGNED_LONG_LONG,
)
_INTEGER_SUFFIXES = {"": 0, "u": 1, "l": 2, "ul": 3, "ll": 4, "ull": 5}
"""The least rank of a constant's type; the next of its kind is taken where the value needs it."""

Typed = tuple[CType, Node]


class Expressions:
    """The memory and the names in scope, and what expressions are worth there."""

    def __init__(self, graph: Graph, unit: Unit, memory: Memory) -> None:
        self.graph, self.unit, self.memory = graph, unit, memory
        self.needs_wide_int = False
        self.scopes: list[dict[str, Place]] = []
        self.objects: dict[str, tuple[str, dict[str, Member], bool]] = {}

    def constant_of(self, expression: Any, type_: CType) -> Node:
        """The value of an initialiser, which names nothing."""
        return self.converted(self.value(expression), type_)

    # Places

    def place(self, node: Any) -> Place:
        match type(node).__name__:
            case "ID":
                for scope in reversed(self.scopes):
                    if node.name in scope:
                        return scope[node.name]
                raise NotUnderstood(f"the name {node.name}")
            case "StructRef" if node.type == "->" and type(node.name).__name__ == "ID":
                pointer = node.name.name
                hidden = any(pointer in scope for scope in self.scopes)
                if pointer not in self.objects or hidden:
                    raise NotUnderstood(f"the pointer {pointer}")
                name, members, writable = self.objects[pointer]
                if node.field.name not in members:
                    raise NotUnderstood(f"the member {node.field.name}")
                member = members[node.field.name]
                return Place((name, member.name), member.type, writable)
            case other:
                raise NotUnderstood(f"a place: {other}")

    def index(self, node: Any) -> Node:
        type_, index = self.value(node)
        if type_.precision is not None:
            raise NotUnderstood("an index that is no integer")
        return index

    # Expressions

    def value(self, node: Any) -> Typed:
        match type(node).__name__:
            case "ID" | "StructRef":
                return self._read(node)
            case "ArrayRef":
                place = self.place(node.name)
                array = self.memory[place.key]
                if not isinstance(array, Array):
                    raise NotUnderstood(f"an index of {place.key[1]}")
                return place.type, array.read(self.index(node.subscript), place.key[1])
            case "Constant":
                return self._constant(node.value)
            case "BinaryOp" if node.op in ("&&", "||"):
                return self._logical(node)
            case "BinaryOp":
                return self.binary(node.op, self.value(node.left), self.value(node.right))
            case "UnaryOp":
                return self._unary(node)
            case "TernaryOp":
                return self._ternary(node)
            case "FuncCall":
                return self._call(node)
            case "Cast":
                names = getattr(node.to_type.type.type, "names", None)
                if names is None:
                    raise NotUnderstood("a cast")
                type_ = self.unit.type_named(names)
                return type_, self.converted(self.value(node.expr), type_)
            case other:
                raise NotUnderstood(f"an expression: {other}")

    def _read(self, node: Any) -> Typed:
        if type(node).__name__ == "ID" and node.name in ("HUGE_VAL", "HUGE_VALF"):
            if node.name not in self.unit.declared:
                raise NotUnderstood(f"{node.name} without <math.h>")
            if node.name == "HUGE_VAL":
                return CType.DOUBLE, self.graph.real(math.inf, BINARY64)
            return CType.FLOAT, self.graph.real(math.inf, BINARY32)
        place = self.place(node)
        held = self.memory[place.key]
        if isinstance(held, Array):
            raise NotUnderstood(f"the array {place.key[1]} as a value")
        if isinstance(held, Unset) or (isinstance(held, Choice) and held.unset):
            raise Undefined(f"{place.key[1]} is read before it is set")
        return place.type, held

    def _constant(self, text: str) -> Typed:
        lower = text.lower()
        if not lower.startswith("0x") and any(c in lower for c in ".e"):
            if lower.endswith("f"):
                return CType.FLOAT, self.graph.real(decimal(lower[:-1], BINARY32), BINARY32)
            if lower.endswith("l"):
                raise NotUnderstood(f"the constant {text}")
            return CType.DOUBLE, self.graph.real(decimal(lower, BINARY64), BINARY64)
        digits = lower.rstrip("ul")
        least = _INTEGER_SUFFIXES.get(lower[len(digits) :])
        if least is None or not digits.isdigit() or (len(digits) > 1 and digits[0] == "0"):
            raise NotUnderstood(f"the constant {text}")
        value = int(digits)
        for type_ in _RANKS[least::2]:
            if value <= LEAST_RANGE[type_][1]:
                return type_, self.graph.integer(value)
        raise NotUnderstood(f"the constant {text}")

    def _unary(self, node: Any) -> Typed:
        type_, inner = self.value(node.expr)
        match node.op:
            case "!":
                return CType.INT, self._not(self.truth((type_, inner)))
            case "-" if type_.precision is not None:
                return type_, self.graph.operation(Operator.NEGATE, type_.precision, inner)
            case "-":
                return self.arithmetic("-", (CType.INT, self.graph.false), (type_, inner))
            case other:
                raise NotUnderstood(f"the operator {other}")

    def _not(self, condition: Node) -> Node:
        return self.graph.selected(condition, self.graph.false, self.graph.true)

    def _logical(self, node: Any) -> Typed:
        left = self.truth(self.value(node.left))
        decided = self.graph.false if node.op == "&&" else self.graph.true
        if left is decided:
            return CType.INT, left
        right = self.truth(self.value(node.right))
        join = self.graph.both if node.op == "&&" else self.graph.either
        return CType.INT, join(left, right)

    def binary(self, op: str, left: Typed, right: Typed) -> Typed:
        if op in _COMPARISONS:
            return CType.INT, self._comparison(op, left, right)
        if op == "|":
            type_ = _common(left[0], right[0])
            if type_.precision is not None:
                raise NotUnderstood("bits of a real number")
            sides = (self.converted(side, type_) for side in (left, right))
            return type_, self.graph.bits_of_either(*sides)
        return self.arithmetic(op, left, right)

    def arithmetic(self, op: str, left: Typed, right: Typed) -> Typed:
        type_ = _common(left[0], right[0])
        a, b = self.converted(left, type_), self.converted(right, type_)
        if type_.precision is not None and op in _ARITHMETIC:
            return type_, self.graph.operation(_ARITHMETIC[op], type_.precision, a, b)
        if op not in ("+", "-"):
            raise NotUnderstood(f"the operator {op} on {type_.value}")
        low, high = USUAL_RANGE[type_]
        total = self.graph.sum(a, b, 1 if op == "+" else -1, low, high)
        return type_, self._fitting(total, type_)

    def _comparison(self, op: str, left: Typed, right: Typed) -> Node:
        graph = self.graph
        type_ = _common(left[0], right[0])
        a, b = self.converted(left, type_), self.converted(right, type_)
        if type_.precision is not None:
            return graph.compared(_COMPARISONS[op], a, b)
        match op:
            case "==":
                return graph.same(a, b)
            case "!=":
                return self._not(graph.same(a, b))
            case "<=":
                return graph.at_most(a, b)
            case ">=":
                return graph.at_most(b, a)
            case "<":
                return self._not(graph.at_most(b, a))
            case _:
                return self._not(graph.at_most(a, b))

    def _ternary(self, node: Any) -> Typed:
        graph = self.graph
        condition = self.truth(self.value(node.cond))
        if condition is graph.true or condition is graph.false:
            taken, other = node.iftrue, node.iffalse
            if condition is graph.false:
                taken, other = other, taken
            value = self.value(taken)
            type_ = _common(value[0], self._type(other))
            return type_, self.converted(value, type_)
        high, low = self.value(node.iftrue), self.value(node.iffalse)
        type_ = _common(high[0], low[0])
        return type_, graph.selected(
            condition, self.converted(high, type_), self.converted(low, type_)
        )

    def _type(self, node: Any) -> CType:
        """The type of an expression that is not evaluated."""
        match type(node).__name__:
            case "ID" if node.name in ("HUGE_VAL", "HUGE_VALF"):
                return self._read(node)[0]
            case "ID" | "StructRef":
                return self.place(node).type
            case "ArrayRef":
                return self.place(node.name).type
            case "Constant":
                return self._constant(node.value)[0]
            case "BinaryOp" if node.op in ("&&", "||", *_COMPARISONS):
                return CType.INT
            case "BinaryOp":
                return _common(self._type(node.left), self._type(node.right))
            case "UnaryOp":
                return CType.INT if node.op == "!" else _promoted(self._type(node.expr))
            case "TernaryOp":
                return _common(self._type(node.iftrue), self._type(node.iffalse))
            case "FuncCall" if getattr(node.name, "name", "") in _FUNCTIONS:
                return _FUNCTIONS[node.name.name][1]
            case other:
                raise NotUnderstood(f"an expression: {other}")

    def _call(self, node: Any) -> Typed:
        name = getattr(node.name, "name", "")
        arguments = node.args.exprs if node.args else []
        hidden = any(name in scope for scope in self.scopes)
        if name not in _FUNCTIONS or len(arguments) != 1 or hidden:
            raise NotUnderstood(f"a call of {name}")
        operator, type_ = _FUNCTIONS[name]
        if self.unit.prototypes.get(name) != (type_.value, (("", type_.value, False),)):
            raise NotUnderstood(f"{name} without <math.h>")
        argument = self.converted(self.value(arguments[0]), type_)
        assert type_.precision is not None
        return type_, self.graph.operation(operator, type_.precision, argument)

    # Types

    def truth(self, value: Typed) -> Node:
        """Whether a value is not zero, as a diagram over 1 and 0."""
        type_, node = value
        graph = self.graph
        if type_.precision is not None:
            zero = graph.real(0.0, type_.precision)
            return graph.compared(Operator.NOT_EQUAL, node, zero)
        return graph.mapped("truth", self._leaf_truth, node)

    def _leaf_truth(self, leaf: Node) -> Node:
        if leaf is self.graph.true or leaf is self.graph.false:
            return leaf
        return self._not(self.graph.same(leaf, self.graph.false))

    def converted(self, value: Typed, to: CType) -> Node:
        type_, node = value
        if type_ is to:
            return node
        if to.precision is not None:
            if type_.precision is not None:
                return self.graph.converted(node, to.precision)
            precision = to.precision

            def real(leaf: Node) -> Node:
                if not isinstance(leaf, Integer) or abs(leaf.value) > 2**24:
                    raise NotUnderstood(f"{describe(leaf)} as a real number")
                return self.graph.real(float(leaf.value), precision)

            return self.graph.mapped(("real", precision), real, node)
        if type_.precision is not None:
            raise NotUnderstood(f"a real number, {describe(node)}, as {to.value}")
        if to is CType.BOOL:
            return self.truth(value)
        return self._fitting(node, to)

    def _fitting(self, node: Node, type_: CType) -> Node:
        """The integer, which the type must be able to hold."""
        return self.graph.mapped(("fits", type_), lambda leaf: self._leaf_fits(leaf, type_), node)

    def _leaf_fits(self, leaf: Node, type_: CType) -> Node:
        match leaf:
            case Integer(_, value):
                held = [value]
            case Counter(_, _, _, low, high):
                held = [low, high]
            case Places(_, _, values, _):
                held = [value for value in values if value is not None]
            case _:
                raise NotUnderstood(f"{describe(leaf)} as {type_.value}")
        least, most = LEAST_RANGE[type_]
        if any(not least <= value <= most for value in held):
            self.needs_wide_int = True
            least, most = USUAL_RANGE[type_]
            if any(not least <= value <= most for value in held):
                raise NotUnderstood(f"{describe(leaf)} does not fit {type_.value}")
        return leaf


def _promoted(type_: CType) -> CType:
    return CType.INT if type_ in (CType.BOOL, CType.UNSIGNED_CHAR) else type_


def _common(left: CType, right: CType) -> CType:
    """The type that both are converted to before an operation.

    Of integers of both signs the unsigned one, which must be able to hold the values.
    """
    left, right = _promoted(left), _promoted(right)
    for real in (CType.DOUBLE, CType.FLOAT):
        if real in (left, right):
            return real
    rank = max(_RANKS.index(left), _RANKS.index(right))
    unsigned = _RANKS.index(left) % 2 or _RANKS.index(right) % 2
    return _RANKS[rank | 1] if unsigned else _RANKS[rank]
