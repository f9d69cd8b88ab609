"""What expressions become: types, references, instances of rules."""

from __future__ import annotations

import pytest

from pirlc.diagnostics import PirlcError
from pirlc.frontend import check, parse_sketch
from pirlc.ir.operators import Operator
from pirlc.ir.policy import Choice, Continuous, Fill, Hold, Sketch, Zero
from pirlc.ir.terms import (
    ActionRef,
    Apply,
    DiscreteLiteral,
    Fold,
    Hole,
    If,
    Let,
    Literal,
    LocalRef,
    Peek,
    PreviousAction,
    RuleCall,
    SensorRef,
    Term,
    subterms,
    type_of,
)
from pirlc.ir.types import Bool, Discrete, Real, Sequence
from pirlc.source import SourceText

HEAD = "policy p\nsensor x : [-1, 1] = 0\nsensor y : [-1, 1] = 1\nwindow 5\nparam k = 2\n"
CHOICE = Discrete((0, 1, 4))


def sketch(text: str) -> Sketch:
    return parse_sketch(SourceText("test.pirl", HEAD + text))


def body(expression: str) -> Term:
    return sketch(f"action A : [-1, 1] safe 0 = {expression}").bodies[0]


def discrete(expression: str, more: str = "") -> Term:
    return sketch(f"action D : {{0, 1, 4}} = {expression}\n{more}").bodies[0]


def test_interface() -> None:
    interface = sketch(
        """environment "E-v0" { a = 1, b = 1.0, c = true, d = "t" }
        sensor u : [0, 1] = 2 missing zero
        sensor v : [0, 1] = 3 missing fail
        sensor w : [0, 1] = 4 missing hold 7 then fail
        sample_time 0.5 latency 3 fill zero
        action A : [-1, 1] = 1 safe -1 = 0
        action B : {3, -2} safe -2 = 0 = 3
        """
    ).interface
    assert interface.environment is not None
    arguments = interface.environment.arguments
    assert arguments == (("a", 1), ("b", 1.0), ("c", True), ("d", "t"))
    assert [type(value) for _, value in arguments] == [int, float, bool, str]
    policies = [sensor.missing for sensor in interface.sensors]
    assert policies == [Hold(), Hold(), Zero(), Hold(0), Hold(7)]
    assert (interface.window, interface.sample_time, interface.latency) == (5, 0.5, 3)
    assert interface.fill is Fill.ZERO
    assert [action.domain for action in interface.actions] == [
        Continuous(-1.0, 1.0, -1.0),
        Choice((3, -2), -2),
    ]
    assert [action.component for action in interface.actions] == [1, 0]


def test_precedence_and_associativity() -> None:
    assert body("1 - 2 - 3") == body("(1 - 2) - 3")
    assert body("1 - 2 * 3 / 4") == body("1 - ((2 * 3) / 4)")
    assert body("-k * k") == body("(-k) * k")
    for left, right in [
        ("1 < 2 and 3 < 4 or 5 < 6", "((1 < 2) and (3 < 4)) or (5 < 6)"),
        ("not 1 < 2 and 3 < 4", "(not (1 < 2)) and (3 < 4)"),
        ("1 < 2 implies 3 < 4 implies 5 < 6", "1 < 2 implies (3 < 4 implies 5 < 6)"),
    ]:
        assert body(f"if {left} then 1 else 0") == body(f"if {right} then 1 else 0")
    assert body("if 1 < 2 then 1 else 2 + 3") == body("if 1 < 2 then 1 else (2 + 3)")
    assert body("let e = 1 in e + 2") == body("let e = 1 in (e + 2)")


def test_negative_numbers_are_literals() -> None:
    assert body("-1") == Literal(-1.0)
    assert body("-(1)") == Apply(Operator.NEGATE, (Literal(1.0),))
    assert body("--1") == Apply(Operator.NEGATE, (Literal(-1.0),))
    assert str(body("-0")) == str(Literal(-0.0))


def test_broadcasting() -> None:
    term = body("fold(+, 2 * (x - y))")
    assert isinstance(term, Fold)
    assert type_of(term.sequence) == Sequence(5)
    assert type_of(body("peek(diff(diff(x)), -3)").sequence) == Sequence(3)  # type: ignore[union-attr]
    assert body("clip(peek(x, -1), k, 3)") == Apply(
        Operator.CLIP,
        (Peek(SensorRef("x", 5), -1), sketch("action A : [0, 9] = k").bodies[0], Literal(3.0)),
    )


def test_whole_numbers_become_discrete_where_asked_for() -> None:
    assert discrete("4") == DiscreteLiteral(4, CHOICE)
    term = discrete("if peek(x, -1) > 1 then 1 else (0)")
    assert isinstance(term, If)
    assert term.consequent == DiscreteLiteral(1, CHOICE)
    assert term.alternative == DiscreteLiteral(0, CHOICE)
    assert isinstance(term.condition, Apply)
    assert term.condition.arguments[1] == Literal(1.0)
    for comparison in ("previous(D) == 4", "4 == previous(D)"):
        condition = discrete(f"if {comparison} then 0 else 1").condition  # type: ignore[union-attr]
        assert DiscreteLiteral(4, CHOICE) in condition.arguments
        assert PreviousAction("D", CHOICE) in condition.arguments


@pytest.mark.parametrize(
    "expression",
    [
        "let a = 4 in a",
        "let a = 4 in if previous(D) == a then 0 else 1",
        "let a = 4 in let b = 1 in if 0 < 1 then b else a",
        "let a = if 0 < 1 then 4 else 0 in a",
        "(let a = 4 in (a))",
    ],
)
def test_let_of_a_whole_number_is_discrete_where_used_so(expression: str) -> None:
    term = discrete(expression)
    assert type_of(term) == CHOICE
    assert DiscreteLiteral(4, CHOICE) in list(subterms(term))


def test_let_of_a_whole_number_is_real_otherwise() -> None:
    term = discrete("let a = 4 in if a == 4 then 0 else 1")
    assert isinstance(term, Let)
    assert term.value == Literal(4.0)


def test_rule_instances() -> None:
    found = sketch(
        """action A : [-1, 1] = R(x) + R(diff(x)) + R(k) + peek(S, -1) + fold(+, S)
        rule R(a) = fold(+, a * T) | 1
        rule T = 2 | ?t
        rule S = x + ?s | S - y
        """.replace("fold(+, a * T)", "T * 3")
    )
    instances = {rule.key: (rule.parameters, rule.result) for rule in found.rules}
    assert instances == {
        "R": ((("a", Sequence(5)),), Real()),
        "R#2": ((("a", Sequence(4)),), Real()),
        "R#3": ((("a", Real()),), Real()),
        "T": ((), Real()),
        "S": ((), Sequence(5)),
    }


def test_result_type_of_a_rule_is_what_is_asked_for() -> None:
    found = sketch(
        """action A : [-1, 1] = Number
        action D : {0, 1, 4} = Number
        rule Number = 0 | 1 | if Guard then Number else Number
        rule Guard = peek(x, -1) > 0 | Guard and Guard
        """
    )
    results = {rule.key: rule.result for rule in found.rules}
    assert results == {"Number": Real(), "Number#2": CHOICE, "Guard": Bool()}
    assert found.rule("Number#2").alternatives[1] == DiscreteLiteral(1, CHOICE)


def test_result_type_of_a_recursive_rule_that_begins_with_itself() -> None:
    found = sketch("action A : [-1, 1] = peek(S, -1)\nrule S = S + S | (S) * 2 | diff(x)")
    assert found.rule("S").result == Sequence(4)


def test_holes_share_bounds_in_an_alternative() -> None:
    found = sketch(
        """action A : [-1, 1] = ?k1 * peek(x, -1) + ?(k1 in [0, 1] = 0.5) + R
        rule R = ?k1 | ?(k1 in [2, 3])"""
    )
    holes = [term for term in subterms(found.bodies[0]) if isinstance(term, Hole)]
    assert holes == [Hole("k1", 0.0, 1.0, 0.5)] * 2
    assert found.rule("R").alternatives == (Hole("k1", -100.0, 100.0), Hole("k1", 2.0, 3.0))


def test_local_names_may_shadow_local_names() -> None:
    term = body("let e = x in let e = e - 1 in peek(e, -1)")
    assert isinstance(term, Let)
    assert isinstance(term.body, Let)
    assert term.body.value == Apply(Operator.SUBTRACT, (LocalRef("e", Sequence(5)), Literal(1.0)))


def test_property_over_steps() -> None:
    actions = "action A : [-1, 1] = 0\naction D : {0, 1, 4} = 0\n"
    alone, over = sketch(
        actions
        + """property alone = raw(A) < 1 and D == 4 and peek(x, -5) < previous(A)
        property over 2 over 3 = peek(raw(A), -3) < 1 and peek(x, -3) < 2 and peek(D, -1) == 4
        """.replace("over 2 over", "long over")
    ).properties
    assert (alone.steps, alone.ranged) == (1, False)
    leaves = list(subterms(alone.body))
    assert ActionRef("A", True, Real()) in leaves
    assert ActionRef("D", False, CHOICE) in leaves
    assert DiscreteLiteral(4, CHOICE) in leaves
    assert SensorRef("x", 5) in leaves
    assert PreviousAction("A", Real()) in leaves
    assert (over.steps, over.ranged) == (3, True)
    leaves = list(subterms(over.body))
    assert ActionRef("A", True, Sequence(3)) in leaves
    assert SensorRef("x", 3) in leaves
    assert ActionRef("D", False, Sequence(3)) in leaves


def test_no_warning_and_no_safe_needed_for_total_expressions() -> None:
    text = "action A : [-1, 1] = k * tanh(peek(x, -1) / 3) + fold(max, y)\n"
    assert check(SourceText("t", HEAD + text))[1] == ()


@pytest.mark.parametrize("depth", [150, 198])
def test_deep_expressions_within_the_limit(depth: int) -> None:
    chain = "1" + " + 1" * depth
    nested = "(" * depth + "1" + ")" * depth
    choice = "if k > 0 then 1 else " * depth + "0"
    for expression in (
        chain,
        nested,
        choice,
        "-" * depth + "k",
        "abs(" * depth + "k" + ")" * depth,
    ):
        body(expression)


@pytest.mark.parametrize(
    "expression",
    [
        "1" + " + 1" * 50_000,
        "(" * 50_000 + "1" + ")" * 50_000,
        "-" * 50_000 + "k",
        "if k > 0 then 1 else " * 5_000 + "0",
        "let a = 1 in " * 5_000 + "a",
        "abs(" * 50_000 + "k" + ")" * 50_000,
        "(" * 50_000,
    ],
    ids=["sum", "parentheses", "minus", "if", "let", "call", "unclosed"],
)
def test_very_deep_expressions_are_diagnosed(expression: str) -> None:
    with pytest.raises(PirlcError) as raised:
        body(expression)
    assert {d.code for d in raised.value.diagnostics} <= {"E0105", "E0102"}


def test_rules_that_nest_deeply_are_diagnosed_or_read() -> None:
    tower = "".join(f"rule R{i} = {'(' * 150}R{i + 1} + 1{')' * 150}\n" for i in range(300))
    text = f"action A : [-1, 1] = peek(R0 + x, -1)\n{tower}rule R300 = 1\n"
    try:
        assert len(sketch(text).rules) == 301
    except PirlcError as error:
        assert [d.code for d in error.diagnostics] == ["E0105"]


def test_rule_call_is_a_reference() -> None:
    found = sketch("action A : [-1, 1] = R(2 * k)\nrule R(a) = a | R(a) + 1")
    assert found.bodies[0] == RuleCall("R", (body("2 * k"),), Real())


@pytest.mark.parametrize(
    "rules",
    [
        "rule R = peek(S, -1) | Limit(R)\nrule Limit(x) = x | clip(x, -1, 1)",
        "rule R = peek(S, -1) | Same(Same(R))\nrule Same(x) = x",
        "rule R = peek(S, -1) | First(R, 1)\nrule First(x, y) = y | Same(x)\nrule Same(x) = x",
    ],
)
def test_an_alternative_that_may_be_the_rule_itself(rules: str) -> None:
    text = f"policy p\nsensor S : [-1, 1] = 0\naction A : [-1, 1] = R\n{rules}\n"
    with pytest.raises(PirlcError, match="E0402: the rule `R` is an alternative of itself"):
        parse_sketch(SourceText("same", text))
