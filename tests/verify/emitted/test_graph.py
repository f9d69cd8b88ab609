"""Nodes mean what they say, and equal functions of one number are one node."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping

import pytest

from pirlc.ir.operators import Operator
from pirlc.semantics.interpreter import ARITHMETIC, TRUTH
from pirlc.semantics.precision import BINARY32, BINARY64, Precision, to_binary32
from pirlc.verify.emitted.graph import Graph
from pirlc.verify.emitted.memory import Array
from pirlc.verify.emitted.nodes import (
    Atom,
    Choice,
    Integer,
    Node,
    NotUnderstood,
    Operation,
    Places,
    Real,
    Undefined,
    Variable,
)
from pirlc.verify.emitted.numbers import below, decimal

Values = Mapping[str, float]


def evaluated(node: Node, values: Values) -> float:
    """A node's value where its variables have these."""
    match node:
        case Real(_, value) | Integer(_, value):
            return value
        case Variable(_, name):
            return values[name]
        case Operation(_, name, precision, arguments):
            inside = [evaluated(a, values) for a in arguments]
            return precision.round(ARITHMETIC[Operator(name)](*inside))
        case Choice(_, atom, high, low):
            return evaluated(high if _holds(atom, values) else low, values)
        case _:
            raise AssertionError(node)


def _holds(atom: Atom, values: Values) -> bool:
    if not atom.subjects:
        return bool(values[atom.name])
    inside = [evaluated(x, values) for x in atom.subjects]
    if not atom.ladder:
        return math.isnan(inside[0])
    if len(inside) == 1:
        return inside[0] <= atom.key[2]
    return inside[0] < inside[1] if atom.key[2] == 1.0 else inside[0] <= inside[1]


COMPARISONS = (
    Operator.LESS,
    Operator.LESS_EQUAL,
    Operator.GREATER,
    Operator.GREATER_EQUAL,
    Operator.EQUAL,
    Operator.NOT_EQUAL,
)
CONSTANTS = (-math.inf, -1e300, -1.0, -5e-324, -0.0, 0.0, 0.1, 1.0, 1e300, math.inf, math.nan)
Formula = tuple[Node, Callable[[Values], bool]]


def _numbers(precision: Precision) -> list[float]:
    """The constants and their neighbours, in the precision."""
    found = [precision.round(c) for c in CONSTANTS]
    real = [c for c in found if c > -math.inf]
    return [
        *found,
        *(below(c, precision) for c in real),
        *(-below(-c, precision) for c in real if c < math.inf),
    ]


def formula(
    rng: random.Random, graph: Graph, names: tuple[str, ...], precision: Precision, depth: int
) -> Formula:
    """A random condition, as a node and as a function."""
    if depth == 0:

        def side() -> tuple[Node, Callable[[Values], float]]:
            if rng.random() < 0.6:
                name = rng.choice(names)
                return graph.variable(name, precision), lambda values: values[name]
            constant = precision.round(rng.choice(CONSTANTS))
            return graph.real(constant, precision), lambda _: constant

        operator, (a, f), (b, g) = rng.choice(COMPARISONS), side(), side()
        if rng.random() < 0.1:
            return graph.is_finite(a), lambda values: math.isfinite(f(values))
        return graph.compared(operator, a, b), lambda values: TRUTH[operator](f(values), g(values))
    (a, f), (b, g), (c, h) = (formula(rng, graph, names, precision, depth - 1) for _ in range(3))
    match rng.randrange(4):
        case 0:
            return graph.both(a, b), lambda values: f(values) and g(values)
        case 1:
            return graph.either(a, b), lambda values: f(values) or g(values)
        case 2:
            return graph.negation(a), lambda values: not f(values)
        case _:
            return graph.choose(a, b, c), lambda values: g(values) if f(values) else h(values)


@pytest.mark.parametrize("precision", list(Precision))
def test_conditions_hold_where_they_should(precision):
    rng, graph = random.Random(1), Graph()
    numbers = _numbers(precision)
    for _ in range(400):
        node, function = formula(rng, graph, ("a", "b", "c"), precision, rng.randint(0, 3))
        for _ in range(30):
            values = {name: rng.choice(numbers) for name in "abc"}
            assert bool(evaluated(node, values)) == function(values), values


@pytest.mark.parametrize("precision", list(Precision))
def test_equal_conditions_on_one_number_are_one_node(precision):
    rng, graph = random.Random(2), Graph()
    points = [{"a": x} for x in _numbers(precision)]
    known: dict[tuple[bool, ...], Node] = {}
    repeated = 0
    for _ in range(3000):
        node, function = formula(rng, graph, ("a",), precision, rng.randint(0, 3))
        # The points tell apart whatever comparisons with the constants can tell apart.
        table = tuple(function(values) for values in points)
        repeated += table in known
        assert known.setdefault(table, node) is node
    assert len(known) > 100 and repeated > 300
    assert len(set(map(id, known.values()))) == len(known)


def test_in_range_is_finite():
    graph = Graph()
    for precision in Precision:
        x = graph.variable("x", precision)
        low, high = graph.real(-2.0, precision), graph.real(0.5, precision)
        within = graph.both(
            graph.compared(Operator.GREATER_EQUAL, x, low),
            graph.compared(Operator.LESS_EQUAL, x, high),
        )
        assert graph.both(within, graph.is_finite(x)) is within
        difference = graph.operation(Operator.SUBTRACT, precision, x, x)
        zero = graph.real(0.0, precision)
        assert graph.compared(Operator.NOT_EQUAL, difference, zero) is graph.negation(
            graph.is_finite(x)
        )


def test_what_differs_is_not_one_node():
    graph = Graph()
    x, y = (graph.variable(name, BINARY64) for name in "xy")
    narrow = graph.variable("x", BINARY32)

    def add(a: Node, b: Node) -> Node:
        return graph.operation(Operator.ADD, BINARY64, a, b)

    distinct = [
        add(x, y),
        add(y, x),
        add(x, graph.real(0.0, BINARY64)),
        add(x, graph.real(-0.0, BINARY64)),
        x,
        narrow,
        graph.converted(narrow, BINARY64),
        graph.operation(Operator.SUBTRACT, BINARY64, x, y),
        add(add(x, y), x),
        add(x, add(y, x)),
        graph.choose(graph.compared(Operator.LESS, x, y), x, y),
        graph.choose(graph.compared(Operator.LESS_EQUAL, x, y), x, y),
        graph.choose(graph.compared(Operator.LESS, y, x), y, x),
    ]
    assert len(set(map(id, distinct))) == len(distinct)
    assert add(x, y) is add(x, y)


def test_decimals_are_rounded_once():
    # 1 + 2^-24 + 2^-60 is nearest to 1 + 2^-23, but its binary64 neighbour lies halfway to 1.
    text = "1.00000005960464477625790"
    assert to_binary32(float(text)) == 1.0
    assert decimal(text, BINARY32) == 1.0 + 2.0**-23
    rng = random.Random(3)
    for _ in range(300):
        x = to_binary32(rng.uniform(-1, 1) * 10.0 ** rng.randint(-44, 37))
        assert decimal(repr(x), BINARY32) == x == decimal(f"{x:.60e}", BINARY32)
    assert decimal("1e39", BINARY32) == math.inf
    assert decimal("0.1", BINARY64) == 0.1


def test_places_of_a_ring():
    graph = Graph()
    head = graph.places("head", tuple(range(4)))
    one, three, zero = (graph.integer(n) for n in (1, 3, 0))
    cells = tuple(graph.variable(f"v{i}", BINARY64) for i in range(4))
    ring = Array(cells, "head")
    assert ring.read(head, "v") is cells[0]
    at_end = graph.same(head, three)
    following = graph.selected(at_end, zero, graph.sum(head, one, 1, 0, 99))
    assert ring.read(following, "v") is cells[1]
    assert graph.at_most(zero, head) is graph.true
    with pytest.raises(Undefined, match="outside of v"):
        ring.read(graph.sum(head, one, 1, 0, 99), "v")
    with pytest.raises(NotUnderstood, match="does not turn"):
        ring.read(graph.places("head", (0, 0, 1, 2)), "v")
    with pytest.raises(NotUnderstood):
        ring.read(graph.places("other", tuple(range(4))), "v")
    with pytest.raises(NotUnderstood):
        ring.read(one, "v")
    # Below zero there is no place; where it is not used, that does no harm.
    before = graph.sum(head, one, -1, 0, 99)
    assert isinstance(before, Places) and before.values == (None, 0, 1, 2)
    last = graph.selected(graph.same(head, zero), three, before)
    assert ring.read(last, "v") is cells[3]
    filled = ring
    for k in range(4):
        filled = filled.written(graph.integer(k), cells[2], "v")
        if k < 3:
            with pytest.raises(NotUnderstood, match="at some fixed places"):
                filled.read(head, "v")
    assert filled == Array((cells[2],) * 4, "head")


def test_counts_are_bounded():
    graph = Graph()
    count, one = graph.counter("n", 0, 5), graph.integer(1)
    more = graph.sum(count, one, 1, 0, 6)
    assert graph.at_most(more, graph.integer(6)) is graph.true
    assert graph.at_most(graph.integer(7), more) is graph.false
    half = graph.at_most(count, graph.integer(2))
    assert half not in (graph.true, graph.false)
    assert half is graph.at_most(more, graph.integer(3))
    with pytest.raises(NotUnderstood, match="overflow"):
        graph.sum(count, one, 1, 0, 5)
