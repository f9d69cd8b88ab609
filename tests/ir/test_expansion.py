"""Sketches are expanded without capture, and what comes out reads back."""

from __future__ import annotations

import random

import pytest

from pirlc.diagnostics import PirlcError
from pirlc.frontend import parse_sketch
from pirlc.ir.expansion import (
    NAME_LIMIT,
    Derivation,
    Expansion,
    close,
    expand,
    only_derivation,
)
from pirlc.ir.policy import FreeParameter, ProgramTemplate, Sketch
from pirlc.ir.printer import program_text, term_text
from pirlc.ir.terms import FoldLambda, Let, ParameterRef, Term, subterms
from pirlc.source import SourceText
from tests.search.sketches import CLASHES, SHAPES, random_expansion, sketch_of


def chosen(number: int, *children: Derivation) -> Derivation:
    return Derivation(number, children)


def expanded(text: str, *derivations: Derivation) -> Expansion:
    """The expansion of a sketch; for each action the derivations of the calls in its body."""
    return expand(sketch_of(text), derivations)


def body_text(expansion: Expansion) -> str:
    (body,) = expansion.template.bodies
    return term_text(body)


def names(expansion: Expansion) -> list[str]:
    return [p.name for p in expansion.template.parameters]


# Hygiene.


def test_a_rules_let_does_not_capture_the_callers_name() -> None:
    text = """
        action A : [-1, 1] = let e = peek(S, -1) in R(e)
        rule R(x) = let e = peek(T, -1) in x - e
    """
    found = expanded(text, chosen(0, chosen(0)))
    assert body_text(found) == "let e = peek(S, -1) in let e_2 = peek(T, -1) in e - e_2"


def test_an_argument_is_evaluated_where_the_call_stands() -> None:
    # The argument mentions the caller's x, and the rule's own argument is also called x.
    text = """
        action A : [-1, 1] = let x = peek(S, -1) in R(x + 1)
        rule R(x) = let y = x in Q(y * x)
        rule Q(x) = x * x
    """
    found = expanded(text, chosen(0, chosen(0, chosen(0))))
    assert body_text(found) == (
        "let x = peek(S, -1) in let x_2 = x + 1 in let y = x_2 in let x_3 = y * x_2 in x_3 * x_3"
    )


def test_a_lambdas_names_do_not_capture_arguments() -> None:
    text = r"""
        action A : [-1, 1] safe 0 = let v = peek(S, -1) in R(v)
        rule R(k) = fold(\v acc -> v * k + acc, T, k)
    """
    found = expanded(text, chosen(0, chosen(0)))
    assert body_text(found) == r"let v = peek(S, -1) in fold(\v_2 acc -> v_2 * v + acc, T, v)"


def test_a_let_that_hides_another_of_its_rule_is_kept_apart() -> None:
    text = "action A : [-1, 1] = let x = peek(S, -1) in let x = x + 1 in x * x"
    assert body_text(expanded(text, chosen(0))) == (
        "let x = peek(S, -1) in let x_2 = x + 1 in x_2 * x_2"
    )


# Arguments.


def test_an_argument_that_is_computed_is_bound_once() -> None:
    text = """
        action A : [-1, 1] = Square(Reading)
        rule Square(x) = x * x
        rule Reading = peek(S, -1) + ?k
    """
    found = expanded(text, chosen(0, chosen(0), chosen(0)))
    assert body_text(found) == "let x = peek(S, -1) + A_k in x * x"
    assert names(found) == ["A_k"]


@pytest.mark.parametrize(
    ("argument", "body"),
    [
        ("2", "2 * 2"),
        ("?k", "A_k * A_k"),
        ("q", "q * q"),
        ("Id(q)", "q * q"),
        ("peek(S, -1)", "let x = peek(S, -1) in x * x"),
        ("previous(A)", "let x = previous(A) in x * x"),
        ("-q", "let x = -q in x * x"),
    ],
)
def test_a_single_name_or_number_takes_the_place_of_its_uses(argument: str, body: str) -> None:
    text = f"""
        param q = 3
        action A : [-1, 1] = R({argument})
        rule R(x) = x * x
        rule Id(y) = y
    """
    below = (chosen(0),) if "Id" in argument else ()
    assert body_text(expanded(text, chosen(0, chosen(0), *below))) == body


def test_a_sensor_takes_the_place_of_a_sequence_argument() -> None:
    text = """
        action A : [-1, 1] = R(S, S - T)
        rule R(x, y) = fold(+, x) + fold(+, y) * peek(y, -1)
    """
    found = expanded(text, chosen(0, chosen(0)))
    assert body_text(found) == "let y = S - T in fold(+, S) + fold(+, y) * peek(y, -1)"


def test_an_argument_that_goes_unused_leaves_nothing_behind() -> None:
    text = """
        param q in [0, 1]
        action A : [-1, 1] = R(?k * q + Reading)
        rule R(x) = ?c
        rule Reading = peek(S, -1) * ?k
    """
    found = expanded(text, chosen(0, chosen(0), chosen(0)))
    assert body_text(found) == "A_c"
    assert names(found) == ["A_c"]
    assert [name for name, _ in found.origins] == ["A_c"]


def test_shared_choices_are_made_once_and_independent_ones_each_time() -> None:
    text = """
        action A : [-1, 1] = (let g = R in g * g) + R * R
        rule R = ?k * peek(S, -1) | ?k * peek(T, -1)
    """
    found = expanded(text, chosen(0, chosen(0), chosen(1), chosen(0)))
    assert body_text(found) == (
        "(let g = A_k * peek(S, -1) in g * g) + A_k_2 * peek(T, -1) * (A_k_3 * peek(S, -1))"
    )


# Holes.


def test_a_hole_is_one_parameter_in_an_expansion_and_another_in_the_next() -> None:
    text = """
        action A : [-1, 1] = R + R + ?k * ?k
        rule R = ?k * (1 + ?k)
    """
    found = expanded(text, chosen(0, chosen(0), chosen(0)))
    assert body_text(found) == "A_k * (1 + A_k) + A_k_2 * (1 + A_k_2) + A_k_3 * A_k_3"
    assert {origin.path for _, origin in found.origins} == {(0, 0), (0, 1), (0,)}
    assert {origin.hole for _, origin in found.origins} == {"k"}


def test_a_hole_in_an_argument_belongs_to_the_caller() -> None:
    text = """
        action A : [-1, 1] = ?k + R(?k, ?k + 1)
        rule R(x, y) = x * ?k + y
    """
    found = expanded(text, chosen(0, chosen(0)))
    assert body_text(found) == "A_k + (let y = A_k + 1 in A_k * A_k_2 + y)"


def test_a_hole_in_a_calls_argument_of_a_rule_belongs_to_that_rule() -> None:
    text = """
        action A : [-1, 1] = Outer + ?k
        rule Outer = Inner(?k) + ?k
        rule Inner(x) = x * ?k
    """
    found = expanded(text, chosen(0, chosen(0, chosen(0))))
    assert body_text(found) == "A_k * A_k_2 + A_k + A_k_3"
    origins = {name: origin.path for name, origin in found.origins}
    assert origins == {"A_k": (0, 0), "A_k_2": (0, 0, 0), "A_k_3": (0,)}


def test_parameters_keep_the_bounds_and_the_guess_of_their_hole() -> None:
    text = "action A : [-1, 1] = ?(k in [2, 9] = 3) * ?k + ?l"
    found = expanded(text, chosen(0))
    assert found.template.parameters == (
        FreeParameter("A_k", 2.0, 9.0, 3.0),
        FreeParameter("A_l", -100.0, 100.0),
    )


def test_a_declared_parameter_is_one_wherever_it_is_named() -> None:
    text = """
        param q in [0, 1]
        param unused in [0, 1]
        param fixed = 3
        action A : [-1, 1] = q * R
        action B : [-1, 1] = R
        rule R = q + ?k
    """
    found = expanded(text, chosen(0, chosen(0)), chosen(0, chosen(0)))
    assert [term_text(b) for b in found.template.bodies] == ["q * (q + A_k)", "q + B_k"]
    assert names(found) == ["q", "fixed", "A_k", "B_k"]


# Names that clash.


@pytest.mark.parametrize("kind", [*CLASHES, *SHAPES])
def test_what_is_expanded_reads_back(kind: str) -> None:
    sketch = sketch_of({**CLASHES, **SHAPES}[kind])
    texts = set()
    for seed in range(60):
        template = random_expansion(sketch, random.Random(seed)).template
        text = program_text(template)
        texts.add(text)
        read = parse_sketch(SourceText("expanded", text))
        assert read.rules == ()
        assert (
            ProgramTemplate(read.interface, read.parameters, read.bodies, read.properties)
            == template
        )
    assert len(texts) > 1


@pytest.mark.parametrize("kind", [*CLASHES, *SHAPES])
def test_names_are_short_and_apart(kind: str) -> None:
    sketch = sketch_of({**CLASHES, **SHAPES}[kind])
    for seed in range(60):
        expansion = random_expansion(sketch, random.Random(seed))
        template = expansion.template
        locals_of = [list(bound(body)) for body in template.bodies]
        for found in locals_of:
            assert len(set(found)) == len(found)
        everywhere = {name for found in locals_of for name in found}
        everywhere |= {name for p in template.properties for name in bound(p.body)}
        parameters = [p.name for p in template.parameters]
        assert len(set(parameters)) == len(parameters)
        assert everywhere.isdisjoint(parameters)
        assert all(len(name) <= NAME_LIMIT for name in (*everywhere, *parameters))
        used = {
            sub.name
            for body in template.bodies
            for sub in subterms(body)
            if isinstance(sub, ParameterRef)
        }
        assert {p.name for p in template.free} <= used
        assert {name for name, _ in expansion.origins} <= set(parameters)


def bound(term: Term) -> list[str]:
    found = []
    for sub in subterms(term):
        match sub:
            case Let(name):
                found.append(name)
            case FoldLambda(element, accumulator):
                found += [element, accumulator]
            case _:
                pass
    return found


def test_the_limit_is_that_of_the_language() -> None:
    name = "k" * NAME_LIMIT
    text = "policy p\naction A : [-1, 1] = {0}\nparam {0} = 1\n"
    assert parse_sketch(SourceText("within", text.format(name))).parameters[0].name == name
    with pytest.raises(PirlcError, match=r"E0204.* is longer than 64 characters"):
        parse_sketch(SourceText("beyond", text.format(name + "k")))


def test_names_tell_the_action_and_the_hole() -> None:
    text = """
        action Steer : [-1, 1] = PID + PID
        action Accel : [-1, 1] = PID
        rule PID = ?kp * peek(S, -1) + ?kd * peek(T, -1)
    """
    found = expanded(text, chosen(0, chosen(0), chosen(0)), chosen(0, chosen(0)))
    assert names(found) == [
        "Steer_kp", "Steer_kd", "Steer_kp_2", "Steer_kd_2", "Accel_kp", "Accel_kd",
    ]  # fmt: skip


def test_of_a_long_name_the_hole_stays_readable() -> None:
    action = "A" * 64
    found = expanded(f"action {action} : [-1, 1] = ?gain * R\nrule R = ?gain", chosen(0, chosen(0)))
    assert names(found) == ["A" * 59 + "_gain", "A" * 59 + "_ga_2"]


# Nothing left to choose.


def closed(text: str) -> tuple[Sketch, tuple[Derivation, ...] | None]:
    sketch = sketch_of(text)
    return sketch, only_derivation(sketch)


def test_a_program_closes_to_itself() -> None:
    sketch, derivations = closed("param k = 2\naction A : [-1, 1] = k * peek(S, -1)")
    assert derivations == (Derivation(0),)
    program = close(sketch)
    assert program is not None
    assert (program.parameters, program.bodies) == (sketch.parameters, sketch.bodies)


def test_rules_with_one_alternative_leave_nothing_to_choose() -> None:
    sketch, derivations = closed("""
        action A : [-1, 1] = Twice(Twice(peek(S, -1)))
        action B : [-1, 1] = Twice(1)
        rule Twice(x) = x + x
    """)
    assert derivations == (chosen(0, chosen(0), chosen(0)), chosen(0, chosen(0)))
    program = close(sketch)
    assert program is not None
    assert [term_text(b) for b in program.bodies] == [
        "let x_2 = let x = peek(S, -1) in x + x in x_2 + x_2",
        "1 + 1",
    ]


@pytest.mark.parametrize(
    "text",
    [
        "action A : [-1, 1] = R\nrule R = 1 | 2",
        "action A : [-1, 1] = R + 1\nrule R = peek(S, -1) | R + 1",
        "action A : [-1, 1] = R(Q)\nrule R(x) = x\nrule Q = 1 | 2",
    ],
)
def test_a_choice_of_rules_is_open(text: str) -> None:
    sketch, derivations = closed(text)
    assert derivations is None
    assert close(sketch) is None


@pytest.mark.parametrize(
    "text",
    ["action A : [-1, 1] = ?k", "param q in [0, 1]\naction A : [-1, 1] = R\nrule R = q"],
)
def test_a_parameter_is_open(text: str) -> None:
    sketch, derivations = closed(text)
    assert derivations is not None
    assert close(sketch) is None
