"""Values as nodes: equal nodes are one object, so that equality is identity.

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

Younger groups are asked first, or older ones: for a fold over `if`s the first is better, for a long
chain of `else if`s the second.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from pirlc.ir.operators import Operator
from pirlc.semantics.interpreter import ARITHMETIC
from pirlc.semantics.precision import Precision
from pirlc.verify.emitted.diagrams import Diagrams
from pirlc.verify.emitted.nodes import (
    Atom,
    Choice,
    Counter,
    Integer,
    Node,
    NotUnderstood,
    Operation,
    Places,
    Real,
    Undefined,
    Variable,
    describe,
    precision_of,
)
from pirlc.verify.emitted.numbers import LARGEST, below


class Graph(Diagrams):
    """Makes the nodes of numbers and integers."""

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
        return self.made(key, lambda n: Operation(n, name, precision, arguments))

    def is_nan(self, x: Node) -> Node:
        if isinstance(x, Real):
            return self.true if x.value != x.value else self.false
        if isinstance(x, Choice) and x.constant:
            return self.mapped("nan", self.is_nan, x)
        group = self.group(("number", x), (x,))
        if group.nan is None:
            group.nan = Atom((group.number, 0, 0.0), False, (x,))
        return self.choice(group.nan, self.true, self.false)

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
        group = self.group(("number", x), (x,))
        rung = group.rung(place if isinstance(place, int) else place + 0.0)  # +0 for -0
        return self.choice(rung, self.true, self.false)

    def _pair(self, left: Node, right: Node, place: float) -> Node:
        group = self.group(("pair", left, right), (left, right))
        return self.choice(group.rung(place), self.true, self.false)

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
                    return self.counted(
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
