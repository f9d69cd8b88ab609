"""What a reading says is so: sums and regions agree with the reference interpreter on histories."""

from __future__ import annotations

import math
from typing import assert_never

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pirlc.analyze.paths import paths
from pirlc.analyze.reading.ranges import box_of, range_of
from pirlc.analyze.reading.regions import region_of
from pirlc.analyze.reading.sums import (
    Atom,
    Compare,
    Every,
    Function,
    Guard,
    Relation,
    Some,
    Sum,
    guard_of,
    negation,
    sum_of,
)
from pirlc.analyze.tangent import Earlier, Reading
from pirlc.frontend import parse_sketch
from pirlc.ir.expansion import close
from pirlc.ir.policy import Choice, Program
from pirlc.semantics.interpreter import Scope, evaluate
from pirlc.semantics.precision import BINARY64
from pirlc.source import SourceText
from tests.support.command_line import ROOT

EXAMPLES = ROOT / "examples"
CLOSED = sorted(
    path
    for pattern in ("*/*-0.pirl", "torcs/printed/*.pirl", "torcs/synthesised/*.pirl")
    for path in EXAMPLES.glob(pattern)
)


def closed(text: str) -> Program:
    program = close(parse_sketch(SourceText("p.pirl", text)))
    assert program is not None
    return program


def scope_in(program: Program, rng: np.random.Generator) -> Scope:
    """Readings in their ranges, sometimes at an end; small ones often, where guards are."""
    interface = program.interface

    def one(low: float, high: float) -> float:
        size = rng.choice([1.0, 0.1, 0.001])
        return float(np.clip(rng.uniform(low, high) * size, low, high))

    return Scope(
        parameters=program.values,
        windows={
            s.name: tuple(one(s.lower, s.upper) for _ in range(interface.window))
            for s in interface.sensors
        },
        previous={
            a.name: int(rng.choice(a.domain.values))
            if isinstance(a.domain, Choice)
            else float(rng.uniform(a.domain.lower, a.domain.upper))
            for a in interface.actions
        },
        locals={},
    )


def value(total: Sum, scope: Scope) -> float:
    return float(total.constant) + sum(float(w) * atom(a, scope) for a, w in total.terms)


def atom(found: Atom, scope: Scope) -> float:
    match found:
        case Reading(sensor, age):
            return scope.windows[sensor][-1 - age]
        case Earlier(action):
            return scope.previous[action]
        case Function(name, arguments, condition):
            values = [value(argument, scope) for argument in arguments]
            match name:
                case "abs":
                    return abs(values[0])
                case "min":
                    return min(values)
                case "max":
                    return max(values)
                case "clip":
                    return min(max(values[0], values[1]), values[2])
                case "*":
                    return values[0] * values[1]
                case "/":
                    return values[0] / values[1]
                case "sqrt":
                    return math.sqrt(values[0])
                case "tanh":
                    return math.tanh(values[0])
                case "if":
                    assert condition is not None
                    return values[0] if truth(condition, scope) else values[1]
                case _:
                    raise AssertionError(name)
        case _:
            assert_never(found)


_RELATIONS = {
    Relation.GREATER: lambda x: x > 0,
    Relation.GREATER_EQUAL: lambda x: x >= 0,
    Relation.LESS: lambda x: x < 0,
    Relation.LESS_EQUAL: lambda x: x <= 0,
    Relation.EQUAL: lambda x: x == 0,
    Relation.NOT_EQUAL: lambda x: x != 0,
}


def truth(guard: Guard, scope: Scope) -> bool:
    match guard:
        case Compare(total, relation):
            return bool(_RELATIONS[relation](value(total, scope)))
        case Every(parts):
            return all(truth(part, scope) for part in parts)
        case Some(parts):
            return any(truth(part, scope) for part in parts)
        case _:
            assert_never(guard)


def in_doubt(guard: Guard, scope: Scope) -> bool:
    """Whether rounding may decide one of its comparisons."""
    match guard:
        case Compare(total, _):
            return abs(value(total, scope)) < 1e-9
        case Every(parts) | Some(parts):
            return any(in_doubt(part, scope) for part in parts)
        case _:
            assert_never(guard)


def check(program: Program, rng: np.random.Generator) -> None:
    scope = scope_in(program, rng)
    box = box_of(program.interface)
    for body in program.bodies:
        ways, complete = paths(body)
        assert complete
        for way in ways:
            guards = [
                guard_of(c.term, program) if c.holds else negation(guard_of(c.term, program))
                for c in way.conditions
            ]
            if any(in_doubt(guard, scope) for guard in guards):
                continue
            taken = all(evaluate(c.term, scope, BINARY64) == c.holds for c in way.conditions)
            assert all(truth(guard, scope) for guard in guards) == taken
            region = region_of(guards, box)
            inside = not region.never and all(
                bound.interval[0] <= atom(a, scope) <= bound.interval[1]
                for a, bound in region.bounds
            )
            assert (inside and all(truth(g, scope) for g in region.guards)) == taken
            total = sum_of(way.term, program)
            computed = evaluate(way.term, scope, BINARY64)
            assert isinstance(computed, float | int)
            assert value(total, scope) == pytest.approx(float(computed), rel=1e-9, abs=1e-9)
            low, high = range_of(total, box)
            assert low - 1e-9 <= value(total, scope) <= high + 1e-9


@pytest.mark.parametrize("path", CLOSED, ids=lambda path: path.stem)
def test_examples(path) -> None:
    program = closed(path.read_text(encoding="utf-8"))
    rng = np.random.default_rng(0)
    for _ in range(40):
        check(program, rng)


numbers = st.integers(-8, 8).map(lambda k: f"({k / 4})" if k < 0 else str(k / 4))
leaves = st.one_of(
    st.sampled_from(["peek(X, -1)", "peek(Y, -1)", "peek(X, -2)", "previous(A)", "fold(+, X)"]),
    numbers.map(lambda n: f"(0 - {n})" if n.startswith("(") else n),
).map(lambda text: text.replace("(-", "(0 - "))
reals = st.recursive(
    leaves,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from("+-*"), inner).map(lambda t: f"({t[0]} {t[1]} {t[2]})"),
        inner.map(lambda t: f"abs({t})"),
        st.tuples(st.sampled_from(["min", "max"]), inner, inner).map(
            lambda t: f"{t[0]}({t[1]}, {t[2]})"
        ),
        inner.map(lambda t: f"clip({t}, 0 - 1, 1)"),
    ),
    max_leaves=5,
)
comparisons = st.tuples(reals, st.sampled_from(["<", "<=", ">", ">="]), reals).map(
    lambda t: f"{t[0]} {t[1]} {t[2]}"
)
conditions = st.recursive(
    comparisons,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from(["and", "or", "implies"]), inner).map(
            lambda t: f"({t[0]}) {t[1]} ({t[2]})"
        ),
        inner.map(lambda t: f"not ({t})"),
    ),
    max_leaves=4,
)


@settings(max_examples=80, deadline=None)
@given(conditions, conditions, reals, st.integers(0, 2**32))
def test_any_program(first: str, second: str, law: str, seed: int) -> None:
    program = closed(
        "policy p\nsensor X : [-1, 1] = 0\nsensor Y : [0, 4] = 1\nwindow 3\n"
        f"action A : [-1, 1] safe 0 = if {first} then (if {second} then {law} else 1) else 0\n"
    )
    rng = np.random.default_rng(seed)
    for _ in range(10):
        check(program, rng)
