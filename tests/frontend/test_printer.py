"""Printed programs read back as equal values."""

from __future__ import annotations

import random
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pirlc.frontend import format_source, parse_sketch
from pirlc.ir.layout import number_text
from pirlc.ir.policy import Continuous, Program, ProgramTemplate
from pirlc.ir.printer import program_text, term_text
from pirlc.ir.terms import DiscreteLiteral, Literal, LocalRef, Term, transform
from pirlc.ir.types import Discrete, Real
from pirlc.source import SourceText
from tests.support.programs import Kinds, random_program

SAMPLES = sorted((Path(__file__).parent / "samples").glob("*.pirl"))


def _undiscrete(term: Term) -> Term:
    """Values of discrete actions that are compared with each other read back as reals."""
    match term:
        case DiscreteLiteral(value):
            return Literal(float(value))
        case LocalRef(name, Discrete()):
            return LocalRef(name, Real())
        case _:
            return term


def _with_safe_values(program: Program) -> Program:
    actions = tuple(
        replace(action, domain=replace(action.domain, safe=action.safe))
        if isinstance(action.domain, Continuous)
        else action
        for action in program.interface.actions
    )
    return replace(program, interface=replace(program.interface, actions=actions))


def _round_trip(program: Program) -> None:
    text = program_text(program)
    sketch = parse_sketch(SourceText("printed", text))
    assert sketch.interface == program.interface
    assert sketch.parameters == program.parameters
    assert sketch.rules == ()
    for read, printed in zip(sketch.bodies, program.bodies, strict=True):
        # `str`, because it tells -0.0 from 0.0.
        assert str(transform(read, _undiscrete)) == str(transform(printed, _undiscrete))
    again = ProgramTemplate(sketch.interface, sketch.parameters, sketch.bodies)
    assert program_text(again) == text
    assert format_source(SourceText("printed", text)) == text


@given(st.randoms(use_true_random=False))
@settings(max_examples=60, deadline=None)
def test_random_programs(rng: random.Random) -> None:
    _round_trip(_with_safe_values(random_program(rng, Kinds(libm=True))))


@pytest.mark.slow
def test_many_random_programs() -> None:
    for seed in range(3_000):
        _round_trip(
            _with_safe_values(random_program(random.Random(seed), Kinds(libm=True, depth=7)))
        )


@pytest.mark.parametrize("file", SAMPLES, ids=lambda file: file.stem)
def test_interface_parameters_and_properties_of_samples(file: Path) -> None:
    sketch = parse_sketch(SourceText(file.name, file.read_text(encoding="utf-8")))
    bodies = tuple(
        Literal(0.0)
        if isinstance(action.domain, Continuous)
        else DiscreteLiteral(action.domain.values[0], action.type)  # type: ignore[arg-type]
        for action in sketch.interface.actions
    )
    template = ProgramTemplate(sketch.interface, sketch.parameters, bodies, sketch.properties)
    text = program_text(template, ("made for a test", ""))
    assert text.startswith("# made for a test\n#\n")
    read = parse_sketch(SourceText("printed", text))
    assert (read.interface, read.parameters, read.bodies, read.properties) == (
        sketch.interface,
        sketch.parameters,
        bodies,
        sketch.properties,
    )
    assert format_source(SourceText("printed", text)) == text


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_numbers(value: float) -> None:
    text = number_text(value)
    assert str(float(text)) == str(value)
    assert len(text) <= len(repr(value))


def test_long_expressions_are_wrapped() -> None:
    head = "policy p\nsensor Angle : [-1, 1] = 0\nwindow 3\n"
    total = " + ".join(f"0.{i}5 * peek(Angle, -{1 + i % 3})" for i in range(12))
    sketch = parse_sketch(
        SourceText(
            "t",
            f"{head}action Push : [-1, 1] = if {total} > 0 then {total} else clip({total}, 0, 1)\n",
        )
    )
    program = Program(sketch.interface, (), sketch.bodies)
    lines = program_text(program).splitlines()
    assert max(map(len, lines)) <= 100
    assert any(line.strip().startswith("else") for line in lines)
    one_line = term_text(sketch.bodies[0])
    assert "\n" not in one_line
    assert one_line == f"if {total} > 0 then {total} else clip({total}, 0, 1)"
