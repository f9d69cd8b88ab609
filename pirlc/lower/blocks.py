"""What lowering builds with: statement blocks, fresh names, sequences that are never stored."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from pirlc.ir.controller import (
    Define,
    Expression,
    Kind,
    Local,
    LoopIndex,
    Operation,
    Select,
    Statement,
    is_leaf,
)


class Names:
    """Hands out names that are unique in the controller."""

    def __init__(self, taken: Iterable[str]) -> None:
        self._taken = set(taken)

    def fresh(self, wish: str) -> str:
        name, number = wish, 2
        while name in self._taken:
            name, number = f"{wish}_{number}", number + 1
        self._taken.add(name)
        return name


@dataclass(frozen=True, slots=True)
class At:
    """A place in a sequence, counted from its oldest element: `offset`, plus a loop's index."""

    offset: int
    index: LoopIndex | None = None

    def next(self) -> At:
        return At(self.offset + 1, self.index)


class Block:
    """Statements that run one after another; what an outer block has computed may be used."""

    def __init__(self, names: Names, outer: Block | None = None) -> None:
        self.names = names
        self.statements: list[Statement] = []
        self._outer = outer
        self._elements: dict[tuple[Sequence, At], Expression] = {}

    def inner(self) -> Block:
        return Block(self.names, self)

    def define(self, wish: str, kind: Kind, value: Expression) -> Local:
        local = Local(self.names.fresh(wish), kind)
        self.statements.append(Define(local, value))
        return local

    def leaf(self, value: Expression, wish: str, kind: Kind = Kind.REAL) -> Expression:
        """The value, computed once and named if it takes an operation."""
        return value if is_leaf(value) else self.define(wish, kind, value)

    def known(self, sequence: Sequence, at: At) -> Expression | None:
        block: Block | None = self
        while block is not None:
            if (sequence, at) in block._elements:
                return block._elements[sequence, at]
            block = block._outer
        return None

    def remember(self, sequence: Sequence, at: At, value: Expression) -> None:
        self._elements[sequence, at] = value


@dataclass(frozen=True, eq=False)
class Sequence:
    """A sequence of the program as a function from a place to the element there.

    `element` may add statements to the block that it is handed. Two sequences are the same only if
    they are one object.
    """

    length: int
    element: Callable[[At, Block], Expression]


def shared(sequence: Sequence, wish: str) -> Sequence:
    """The sequence with each of its elements computed once for all uses that it dominates.

    Without this, uses of uses of a named sequence would multiply.
    """

    def element(at: At, block: Block) -> Expression:
        known = block.known(sequence, at)
        if known is None:
            # A number in the name says how many steps ago the element was the newest.
            name = wish if at.index else f"{wish}_{sequence.length - 1 - at.offset}"
            known = block.leaf(sequence.element(at, block), name)
            block.remember(sequence, at, known)
        return known

    return Sequence(sequence.length, element)


def height(expression: Expression) -> int:
    return expression.height if isinstance(expression, Operation | Select) else 0
