"""Executes a function of emitted C on nodes, statement by statement.

Both sides of an `if` are run and what they leave behind is joined, unless the condition is known.
Loops run as often as their conditions, which must be known, say. Expressions have no side effects
(a statement may assign). Whatever is not listed here raises `NotUnderstood`: other statements and
types, an index that may lie outside its array, a variable read before it is set, an integer that
may overflow, a write through a pointer to const.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pirlc.verify.emitted.expressions import Expressions, Typed
from pirlc.verify.emitted.graph import Graph
from pirlc.verify.emitted.memory import Array, Memory, Place, merged
from pirlc.verify.emitted.nodes import (
    Choice,
    LimitReached,
    Node,
    NotUnderstood,
    describe,
)
from pirlc.verify.emitted.syntax import CType, Function, Unit

MOST_STATEMENTS = 400_000
"""More executed statements than this and the proof is given up."""


class Machine(Expressions):
    """One run of a function.

    After `run`, `memory` holds what it left, and `needs_wide_int` tells whether some integer goes
    beyond what an `int` of 16 bits can hold.
    """

    def __init__(self, graph: Graph, unit: Unit, memory: Memory) -> None:
        super().__init__(graph, unit, memory)
        self._locals = 0
        self._left = MOST_STATEMENTS

    def run(self, function: Function, objects: Mapping[str, str]) -> Node | None:
        """Executes the function's body; `objects` names the memory's object of each struct type.

        Returns what it returns (None: void).
        """
        for name, struct, constant in function.parameters:
            if struct not in objects or struct not in self.unit.structs:
                raise NotUnderstood(f"the parameter {name} of {function.name}")
            members = {member.name: member for member in self.unit.structs[struct]}
            self.objects[name] = objects[struct], members, not constant
        result = self._block(function.body, returns=True)
        if (result is None) != (function.result == "void"):
            raise NotUnderstood(f"{function.name} returns {function.result}")
        if result is None:
            return None
        return self.converted(result, self.unit.type_named(function.result.split()))

    # Statements

    def _block(self, node: Any, returns: bool = False) -> Typed | None:
        """Runs a compound statement; a `return` may only be the last of a function."""
        self.scopes.append({})
        items = node.block_items or []
        result = None
        for number, item in enumerate(items):
            if type(item).__name__ == "Return" and returns and number == len(items) - 1:
                result = None if item.expr is None else self.value(item.expr)
            else:
                self._statement(item)
        self.scopes.pop()
        return result

    def _statement(self, node: Any) -> None:
        self._left -= 1
        if self._left < 0:
            raise LimitReached
        match type(node).__name__:
            case "Compound":
                self._block(node)
            case "Decl":
                self._declare(node)
            case "DeclList":
                for declaration in node.decls:
                    self._declare(declaration)
            case "Assignment":
                self._assign(node)
            case "UnaryOp" if node.op in ("p++", "++"):
                self._store(node.expr, self.arithmetic("+", self.value(node.expr), self._one()))
            case "If":
                self._if(node)
            case "For":
                self._for(node)
            case "Cast" if self._is_void(node) and type(node.expr).__name__ == "ID":
                pass
            case "EmptyStatement":
                pass
            case other:
                raise NotUnderstood(f"a statement: {other}")

    def _one(self) -> Typed:
        return CType.INT, self.graph.true

    def _is_void(self, cast: Any) -> bool:
        return getattr(cast.to_type.type.type, "names", None) == ["void"]

    def _declare(self, node: Any) -> None:
        inner = getattr(node.type, "type", None)
        names = getattr(inner, "names", None)
        if type(node.type).__name__ != "TypeDecl" or names is None or node.storage:
            raise NotUnderstood(f"the declaration of {node.name}")
        type_ = self.unit.type_named(names)
        start = self.graph.unset
        if node.init is not None:
            start = self.converted(self.value(node.init), type_)
        self._locals += 1
        place = Place((f"local {self._locals}", node.name), type_, "const" not in node.quals)
        if node.name in self.scopes[-1]:
            raise NotUnderstood(f"two declarations of {node.name}")
        self.scopes[-1][node.name] = place
        self.memory[place.key] = start

    def _assign(self, node: Any) -> None:
        value = self.value(node.rvalue)
        if node.op != "=":
            value = self.binary(node.op.removesuffix("="), self.value(node.lvalue), value)
        self._store(node.lvalue, value)

    def _store(self, target: Any, value: Typed) -> None:
        if type(target).__name__ == "ArrayRef":
            place = self.place(target.name)
            array = self.memory[place.key]
            if not isinstance(array, Array):
                raise NotUnderstood(f"an index of {place.key[1]}")
            index = self.index(target.subscript)
            node = self.converted(value, place.type)
            self.memory[place.key] = array.written(index, node, place.key[1])
        else:
            place = self.place(target)
            if isinstance(self.memory[place.key], Array):
                raise NotUnderstood(f"an assignment to the array {place.key[1]}")
            self.memory[place.key] = self.converted(value, place.type)
        if not place.writable:
            raise NotUnderstood(f"an assignment to {place.key[1]}, which is const")

    def _if(self, node: Any) -> None:
        graph = self.graph
        condition = self.truth(self.value(node.cond))
        if condition is graph.true or condition is graph.false:
            taken = node.iftrue if condition is graph.true else node.iffalse
            if taken is not None:
                self._inside(taken)
            return
        if not isinstance(condition, Choice):
            raise NotUnderstood(f"an if on {describe(condition)}")
        before = self.memory
        self.memory = dict(before)
        self._inside(node.iftrue)
        high, self.memory = self.memory, dict(before)
        if node.iffalse is not None:
            self._inside(node.iffalse)
        self.memory = merged(graph, condition, high, self.memory)

    def _inside(self, node: Any) -> None:
        self.scopes.append({})
        self._statement(node)
        self.scopes.pop()

    def _for(self, node: Any) -> None:
        if node.init is None or node.cond is None or node.next is None:
            raise NotUnderstood("a loop without start, condition or step")
        self.scopes.append({})
        self._statement(node.init)
        while True:
            condition = self.truth(self.value(node.cond))
            if condition is self.graph.false:
                break
            if condition is not self.graph.true:
                raise NotUnderstood("a loop whose end is not known")
            self._inside(node.stmt)
            self._statement(node.next)
        self.scopes.pop()
