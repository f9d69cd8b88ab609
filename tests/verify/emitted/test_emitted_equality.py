"""Emitted C is proved to be its program: of every example, and of random programs."""

from __future__ import annotations

import random

import pytest

from pirlc.backend.c import CPrinter, c_files
from pirlc.backend.files import Provenance
from pirlc.backend.numbers import PRECISIONS, RealType
from pirlc.frontend import parse_sketch
from pirlc.ir.evidence import PROVED, Kind
from pirlc.ir.expansion import close
from pirlc.ir.policy import Program
from pirlc.lower import lower
from pirlc.resources import explanations
from pirlc.semantics.interpreter import initial_state, step
from pirlc.source import SourceText
from pirlc.verify.emitted import check_emitted, check_text
from pirlc.verify.emitted.check import Comparison
from pirlc.verify.emitted.example import example_of
from pirlc.verify.emitted.graph import Graph
from pirlc.verify.emitted.meaning import Meaning
from pirlc.verify.emitted.nodes import Integer, Node, Real
from tests.support.command_line import POLE, ROOT
from tests.support.observations import random_observations
from tests.support.programs import Kinds, random_program

REALS: tuple[RealType, ...] = ("double", "float")


def _program(text: str) -> Program | None:
    return close(parse_sketch(SourceText("program.pirl", text)))


def _closed() -> dict[str, Program]:
    files = [
        *(ROOT / "examples").rglob("*.pirl"),
        *(ROOT / "tests/backend/programs").glob("*.pirl"),
    ]
    found = {str(file.relative_to(ROOT)): _program(file.read_text()) for file in sorted(files)}
    return {name: program for name, program in found.items() if program is not None}


@pytest.mark.parametrize("real", REALS)
def test_every_example_is_proved(real):
    programs = _closed()
    assert len(programs) >= 25
    for name, program in programs.items():
        finding = check_emitted(program, real)
        assert finding.evidence == PROVED, (name, finding.differences)
        assert (finding.real, finding.differences) == (real, ())
        assert finding.seconds < 5
        parts = set(finding.compared)
        assert {"default parameters", "status"} <= parts
        assert {f"action {action.name}" for action in program.interface.actions} <= parts


def _random(seed: int) -> Program:
    return random_program(random.Random(seed), Kinds(libm=seed % 2 == 0, depth=3 + seed % 4))


def _all_proved(seeds: range) -> None:
    for seed in seeds:
        program = _random(seed)
        for real in REALS:
            finding = check_emitted(program, real)
            assert finding.evidence == PROVED, (seed, real, finding.differences)


def test_random_programs_are_proved():
    _all_proved(range(80))


@pytest.mark.slow
def test_a_thousand_random_programs_are_proved():
    _all_proved(range(1000))


def _number(node: Node) -> float:
    assert isinstance(node, Real | Integer)
    return node.value


@pytest.mark.parametrize("real", REALS)
def test_the_meaning_of_a_program_is_the_interpreter_s(real):
    # On constants every node is a constant, so that what programs are compared by can itself be
    # compared, step by step, with the interpreter.
    precision, steps, odd = PRECISIONS[real], 0, 0
    for seed in range(60):
        program = _random(seed)
        meaning = Meaning(Graph(folding=True), program, precision)
        graph, interface = meaning.graph, program.interface
        values = {name: meaning.real(value) for name, value in program.values.items()}
        object.__setattr__(meaning, "parameter", values.__getitem__)
        nodes, state = meaning.initial(), initial_state(program, precision)
        for observation in random_observations(random.Random(seed), interface, 12).tolist():
            readings = {
                sensor.name: graph.real(precision.round(observation[sensor.index]), precision)
                for sensor in interface.sensors
            }
            after, result = (
                meaning.step(nodes, readings),
                step(program, state, observation, precision),
            )
            nodes, state = after.state, result.state
            assert not meaning.invariant(nodes)
            assert repr(tuple(map(_number, after.actions))) == repr(result.actions)
            assert _number(after.status) == result.status
            for sensor, expected in zip(nodes.sensors, state.sensors, strict=True):
                assert repr(tuple(map(_number, sensor.buffer))) == repr(expected.buffer)
                assert (_number(sensor.flags), _number(sensor.absent)) == (
                    expected.flags,
                    expected.absent,
                )
                assert bool(_number(sensor.started)) == expected.started
            steps, odd = steps + 1, odd + (result.status != 0)
    assert steps == 60 * 12
    assert odd > 100


def test_executed_with_constants_the_c_is_the_interpreter():
    for seed in range(8):
        program = _random(seed)
        for real in REALS:
            controller = lower(program)
            header, source = c_files(controller, real, Provenance("random"))
            printer = CPrinter(controller, real)
            assert example_of(program, header.text, source.text, printer, real) is None


def _texts(program: Program, real: RealType = "double") -> tuple[str, str]:
    header, source = c_files(lower(program), real, Provenance("text"))
    return header.text, source.text


STRANGE = {
    "a call": ("    return status;", "    abort();\n    return status;"),
    "a while": ("    return status;", "    while (status) { }\n    return status;"),
    "a return in the middle": (
        "    unsigned status = 0u;",
        "    unsigned status = 0u;\n    { return 1u; }",
    ),
    "an endless loop": (
        "    return status;",
        "    for (unsigned k = 0u; k < 1u; ) { }\n    return status;",
    ),
    "a shift": ("    return status;", "    status = status << 1u;\n    return status;"),
    "a global": ("void pole_reset", "static int count;\nvoid pole_reset"),
    "a pragma": ("void pole_reset", "#pragma STDC FENV_ACCESS ON\nvoid pole_reset"),
    "no C": ("void pole_reset", "void void pole_reset"),
    "another header": ("#include <float.h>", "#include <float.h>\n#include <fenv.h>"),
    "an input that is written": ("    return status;", "    in->Angle = 0.0;\n    return status;"),
    "an index past the end": ("    return status;", "    s->Angle[3] = 0.0;\n    return status;"),
    "a refusal of everything": ("void pole_reset", "#error no\nvoid pole_reset"),
}


@pytest.mark.parametrize("name", STRANGE)
def test_what_is_not_understood_is_never_passed_over(name):
    program = _program(POLE)
    assert program is not None
    header, source = _texts(program)
    assert check_text(program, header, source).evidence == PROVED
    old, new = STRANGE[name]
    assert source.count(old) == 1
    finding = check_text(program, header, source.replace(old, new))
    assert finding.evidence.kind is Kind.UNKNOWN
    assert [d for d in finding.differences if d.emitted.startswith("not understood: ")]


def test_c_of_another_program_is_not_this_one():
    program, other = _program(POLE), _program(POLE.replace("k = 3", "k = 2"))
    assert program is not None and other is not None
    finding = check_text(program, *_texts(other))
    assert finding.evidence.kind is Kind.REFUTED
    assert "default k" in [difference.part for difference in finding.differences]
    # In the other precision nothing fits.
    assert check_text(program, *_texts(program, "float")).evidence.kind is Kind.UNKNOWN


def test_equal_by_algebra_is_not_equal():
    # k * a + b > 0 and b + k * a > 0: a sum that commutes, but another program text.
    program = _program(POLE)
    turned = _program(
        POLE.replace(
            "k * peek(Angle, -1) + peek(AngularVelocity, -1)",
            "peek(AngularVelocity, -1) + k * peek(Angle, -1)",
        )
    )
    assert program is not None and turned is not None
    finding = check_text(program, *_texts(turned))
    assert finding.evidence.kind is Kind.UNKNOWN
    assert [difference.part for difference in finding.differences] == ["action Push"]


def test_an_int_of_32_bits_is_named_where_it_takes_one():
    text = POLE.replace(
        "Angle           : [-0.21, 0.21] = 2", "Angle : [-1, 1] = 2 missing hold 70000 then fail"
    )
    program = _program(text)
    assert program is not None
    # The counter has a type that is wide enough on every machine.
    assert check_emitted(program).evidence == PROVED
    header, source = _texts(program)
    assert "unsigned long Angle_missing" in header
    narrow = check_text(
        program,
        header.replace("unsigned long Angle_missing", "unsigned Angle_missing"),
        source.replace("unsigned long Angle_missing", "unsigned Angle_missing"),
    )
    assert str(narrow.evidence) == "proved (where int has 32 bits)"


def test_a_program_too_large_is_unknown(monkeypatch):
    monkeypatch.setattr("pirlc.verify.emitted.diagrams.MOST_NODES", 40)
    program = _program(POLE)
    assert program is not None
    finding = check_emitted(program)
    assert str(finding.evidence) == "unknown (limit reached: the program is too large to compare)"
    assert finding.differences == ()


def test_long_chains_take_the_other_order():
    body = "0"
    for i in range(60):
        body = f"if peek(x, -1) > {i} / 60 then {i} else {body}"
    text = f"policy chain\nsensor x : [-1, 1] = 0\naction u : [-1, 1] safe 0 = {body}\n"
    program = _program(text)
    assert program is not None
    header, source = _texts(program)
    printer = CPrinter(lower(program), "double")
    nodes = []
    for older_first in (False, True):
        graph = Graph(older_first=older_first)
        comparison = Comparison(program, printer, "double", graph)
        comparison.run(header, source)
        assert comparison.differences == []
        nodes.append(graph.size)
    assert nodes[1] * 20 < nodes[0]


def test_every_code_has_a_page():
    page = (explanations() / "E0915.md").read_text(encoding="utf-8")
    assert page.startswith("# E0915: ") and "## What to do" in page
