"""What is found without being asked: each kind where it is, and not where it is not."""

from __future__ import annotations

import itertools
import math
import random
import time
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest

from pirlc.frontend import parse_sketch
from pirlc.ir.evidence import PROVED, Kind
from pirlc.ir.expansion import close
from pirlc.ir.operators import Operator
from pirlc.ir.policy import Continuous, Program
from pirlc.ir.terms import (
    Apply,
    DiscreteLiteral,
    If,
    Literal,
    Term,
    children,
    type_of,
    with_children,
)
from pirlc.ir.types import Bool, Discrete, Real
from pirlc.semantics.precision import BINARY32
from pirlc.source import SourceText, Span
from pirlc.verify.bounds.actions import bounds
from pirlc.verify.exact import exact_step
from pirlc.verify.findings import GuardRounding, Matter, Remark
from pirlc.verify.remarks.collect import OVER_REALS, WHERE_DEFINED, guard_margins, remarks
from pirlc.verify.remarks.hazards import some_trials
from pirlc.verify.replay import Trial, run
from tests.support.programs import Kinds, random_program

EXAMPLES = Path(__file__).parents[2] / "examples"


def text_of(body: str, parameters: str = "", action: str = "[-100, 100]") -> str:
    return (
        "policy p\nsensor x : [-1, 1] = 0\nsensor y : [0, 2] = 1\nwindow 2\n"
        f"{parameters}\naction A : {action} safe 0 = {body}\n"
    )


def program_of(text: str) -> Program:
    program = close(parse_sketch(SourceText("test.pirl", text)))
    assert program is not None
    return program


def found(body: str, matter: Matter, parameters: str = "") -> list[Remark]:
    return [r for r in remarks(program_of(text_of(body, parameters))) if r.matter is matter]


def pointed_at(body: str, remark: Remark) -> str:
    text = text_of(body)
    return text[remark.span.start : remark.span.end]


def test_a_branch_that_no_history_reaches() -> None:
    body = "if abs(peek(x, -1)) > 1.5 then 7 else 3"
    (remark,) = found(body, Matter.DEAD_BRANCH)
    assert remark.evidence == PROVED
    assert not remark.clear
    assert pointed_at(body, remark) == "7"
    assert remark.text == "`7` is never reached: `abs(peek(x, -1)) > 1.5` never holds"


def test_a_branch_that_is_dead_because_of_the_one_around_it() -> None:
    body = "if peek(x, -1) > 0.5 then if peek(x, -1) < 0.25 then 1 else 2 else 3"
    (remark,) = found(body, Matter.DEAD_BRANCH)
    assert pointed_at(body, remark) == "1"
    (guard,) = found(body, Matter.CONSTANT_GUARD)
    assert pointed_at(body, guard) == "peek(x, -1) < 0.25"
    assert guard.text == "`peek(x, -1) < 0.25` is never true"


def test_what_is_inside_a_dead_branch_is_not_told_again() -> None:
    body = "if peek(y, -1) < 0 then if peek(x, -1) > 5 then 1 else 2 else 3"
    (remark,) = found(body, Matter.DEAD_BRANCH)
    assert pointed_at(body, remark) == "if peek(x, -1) > 5 then 1 else 2"
    (guard,) = found(body, Matter.CONSTANT_GUARD)
    assert pointed_at(body, guard) == "peek(y, -1) < 0"


def test_a_branch_reached_in_one_round_of_a_fold_is_not_dead() -> None:
    body = r"fold(\v acc -> if acc > 0 then acc - v else acc + 1, y, 0)"
    assert found(body, Matter.DEAD_BRANCH) == []


def test_live_branches_are_not_remarked() -> None:
    body = "if peek(x, -1) > 0.999999 and peek(y, -1) < 0.000001 then 1 else 2"
    assert found(body, Matter.DEAD_BRANCH) == []
    assert found(body, Matter.CONSTANT_GUARD) == []


def test_a_guard_that_is_always_true_among_others() -> None:
    body = "if peek(y, -1) >= 0 and peek(x, -1) > 0 then 1 else 2"
    (guard,) = found(body, Matter.CONSTANT_GUARD)
    assert guard.text == "`peek(y, -1) >= 0` is always true"
    assert guard.evidence == PROVED
    assert found(body, Matter.DEAD_BRANCH) == []


def test_what_rounding_may_revive_is_proved_over_the_reals_only() -> None:
    body = "if 0.1 * peek(x, -1) - 0.1 * peek(x, -1) > 0 then 1 else 2"
    (remark,) = found(body, Matter.DEAD_BRANCH)
    assert remark.evidence == OVER_REALS
    (guard,) = found(body, Matter.CONSTANT_GUARD)
    assert str(guard.evidence) == "proved (over the reals; rounding may turn a guard)"


def test_a_nan_may_take_a_branch_that_no_real_takes() -> None:
    body = "if peek(x, -1) / peek(y, -1) > 0 or peek(x, -1) / peek(y, -1) <= 0 then 1 else 2"
    (remark,) = found(body, Matter.DEAD_BRANCH)
    assert remark.evidence == WHERE_DEFINED
    program = program_of(text_of(body))
    assert run(program, Trial({"x": (0.0, 0.0), "y": (0.0, 0.0)}, {"A": 0.0}))[0].raw["A"] == 2.0


@pytest.mark.parametrize(
    ("body", "size"),
    [
        ("if peek(x, -1) > 0 then 3 else 1", 2),
        ("if peek(x, -1) > 0.5 then peek(x, -1) else -peek(x, -1) + peek(y, -2)", 1),
        # The second guard's jump is larger; its switch lies inside the first one's branch.
        ("if peek(x, -1) > 0 then if peek(y, -1) > 1 then 5 else -5 else -6", 11),
        # On the guard's boundary y is at most 1.
        ("if peek(x, -1) + peek(y, -1) > 0 then peek(y, -1) else -peek(y, -1)", 2),
        ("sign(peek(x, -1)) * 4", 8),
        ("if peek(x, -1) > 0 and peek(y, -1) > 1 then peek(y, -2) else -0.5", Fraction(5, 2)),
    ],
)
def test_the_largest_jump(body: str, size: Fraction) -> None:
    (remark,) = found(body, Matter.JUMP)
    assert remark.evidence == PROVED
    assert not remark.clear
    assert remark.size is not None
    assert remark.size.value == size
    assert remark.witness is not None


def test_a_jump_that_is_not_attained() -> None:
    body = "if peek(x, -1) > 0 then if peek(y, -1) < 1 then peek(y, -1) else 0.25 else 0"
    (remark,) = found(body, Matter.JUMP)
    assert remark.size is not None
    assert remark.size.value == 1
    assert not remark.size.attained
    assert remark.witness is not None
    assert 1 - 1e-9 < remark.witness.history.readings["y"][-1] < 1


def test_of_equal_jumps_the_one_that_is_attained_is_told() -> None:
    # At y = 1 the inner guard turns from 1 to 0 as well.
    body = "if peek(x, -1) > 0 then if peek(y, -1) < 1 then peek(y, -1) else 0 else 0"
    (remark,) = found(body, Matter.JUMP)
    assert remark.size is not None
    assert remark.size.value == 1
    assert remark.size.attained


def test_no_jump() -> None:
    (remark,) = found("if peek(x, -1) > 0 then peek(x, -1) else -peek(x, -1)", Matter.JUMP)
    assert remark.clear
    assert remark.evidence == PROVED
    assert found("abs(peek(x, -1))", Matter.JUMP) == []
    # Where a guard never turns there is nothing to jump.
    (remark,) = found(
        "if peek(x, -1) > 0 and peek(y, -1) >= 0 then peek(x, -1) else 0", Matter.JUMP
    )
    assert remark.clear


def test_jumps_of_nonlinear_actions_are_not_known() -> None:
    (remark,) = found("if peek(x, -1) > 0 then peek(x, -2) * peek(y, -1) else 9", Matter.JUMP)
    assert remark.evidence.kind is Kind.UNKNOWN


def test_jumps_against_sampling() -> None:
    """Held either way on points of a boundary, the action moves no more than the jump."""
    body = "if peek(x, -1) > 0.25 or peek(y, -1) > 1.5 then peek(y, -2) - 1 else 3 * peek(x, -2)"
    (remark,) = found(body, Matter.JUMP)
    assert remark.size is not None
    assert remark.size.value == 4
    program = program_of(text_of(body))
    rng = random.Random(2)
    largest = Fraction(0)
    for _ in range(500):
        windows = {
            "x": [rng.uniform(-1, 1), 0.25 if rng.random() < 0.5 else rng.uniform(-1, 0.25)],
            "y": [rng.uniform(0, 2), rng.uniform(0, 1.5)],
        }
        held = [
            Fraction(exact_step(program, windows, {"A": 0.0}, {("A", 0): side}).raw["A"])
            for side in (True, False)
        ]
        largest = max(largest, abs(held[0] - held[1]))
    assert remark.size.value - 1 < largest <= remark.size.value


def test_division_by_zero_is_shown() -> None:
    (remark,) = found("1 / (peek(x, -1) - 0.5)", Matter.DIVISION)
    assert remark.evidence.kind is Kind.REFUTED
    assert remark.text == "`peek(x, -1) - 0.5` can be zero"
    assert remark.witness is not None
    assert remark.witness.history.readings["x"][-1] == 0.5
    assert math.isinf(remark.witness.steps[0].raw["A"])


@pytest.mark.parametrize(
    "body",
    [
        "1 / (2 + peek(x, -1))",
        "if abs(peek(x, -1)) > 0.5 then 1 / peek(x, -1) else 0",
        "peek(x, -1) / 3",
    ],
)
def test_division_by_zero_is_excluded(body: str) -> None:
    (remark,) = found(body, Matter.DIVISION)
    assert remark.clear
    assert remark.evidence == PROVED
    assert remark.text.endswith("is never zero")


def test_a_masked_division_by_zero_is_found() -> None:
    (remark,) = found("min(1, 1 / abs(peek(x, -1)))", Matter.DIVISION)
    assert remark.evidence.kind is Kind.REFUTED
    assert remark.witness is not None
    assert remark.witness.steps[0].raw["A"] == 1.0


def test_a_division_that_only_rounding_reaches() -> None:
    (remark,) = found("1 / (peek(y, -1) * 0.1 - peek(y, -1) * 0.1 + 1e-300)", Matter.DIVISION)
    assert remark.evidence.kind is Kind.UNKNOWN
    assert "rounding" in remark.evidence.reason
    assert not remark.clear


def test_roots_of_negative_numbers() -> None:
    (remark,) = found("sqrt(peek(x, -1) + 0.5)", Matter.SQUARE_ROOT)
    assert remark.evidence.kind is Kind.REFUTED
    assert remark.witness is not None
    assert math.isnan(remark.witness.steps[0].raw["A"])
    (remark,) = found("sqrt(max(0, peek(x, -1)))", Matter.SQUARE_ROOT)
    assert remark.clear
    assert remark.evidence == PROVED


def test_overflow() -> None:
    (remark,) = found("1e300 * peek(x, -1) * 1e300", Matter.OVERFLOW)
    assert remark.evidence.kind is Kind.REFUTED
    assert remark.text == "raw(A) can overflow in binary64"
    (remark,) = found("1e30 * peek(x, -1) * 1e20", Matter.OVERFLOW)
    assert remark.text == "raw(A) can overflow in binary32"
    assert remark.witness is not None
    program = program_of(text_of("1e30 * peek(x, -1) * 1e20"))
    trial = Trial(remark.witness.history.readings, remark.witness.history.previous)
    assert math.isinf(run(program, trial, BINARY32)[0].raw["A"])
    (remark,) = found("1e30 * peek(x, -1)", Matter.OVERFLOW)
    assert remark.clear
    assert remark.evidence == PROVED


def test_an_overflow_that_ranges_alone_suggest() -> None:
    (remark,) = found("exp(1000 * (peek(x, -1) - peek(x, -1)))", Matter.OVERFLOW)
    assert remark.evidence.kind is Kind.UNKNOWN


@pytest.mark.parametrize(
    ("body", "names"),
    [
        ("p * peek(x, -1) + q", []),
        ("p * peek(x, -1)", ["q"]),
        # In a dead branch; behind a factor of zero; out of reach of the action's bounds.
        ("if peek(y, -1) < 0 then p else q", ["p"]),
        ("0 * p + peek(x, -1) * q", ["p"]),
        ("q + clip(p, 3, 3)", ["p"]),
        # Felt under another value, though not under this one.
        ("if p > 5 then q else 1", ["q"]),
    ],
)
def test_parameters_without_effect(body: str, names: list[str]) -> None:
    told = found(body, Matter.NO_EFFECT, "param p = 1\nparam q = 2")
    assert [remark.text.split()[0] for remark in told] == names
    assert all(remark.evidence == PROVED for remark in told)


def test_guards_that_rounding_can_turn() -> None:
    program = program_of(
        text_of(
            "if 0.1 * peek(x, -1) + 0.2 * peek(x, -2) > 0.3 * peek(x, -1) then 1"
            " else if peek(x, -1) > 0 then 2 else if 0.1 * peek(y, -1) < 5 then 3 else 4"
        )
    )
    # The second compares a reading with zero, exactly; the third is never near.
    (guard,) = guard_margins(program)
    assert isinstance(guard, GuardRounding)
    assert guard.text == "0.1 * peek(x, -1) + 0.2 * peek(x, -2) > 0.3 * peek(x, -1)"
    assert guard.margin64 is not None
    assert guard.margin32 is not None
    assert 1e-17 < guard.margin64 < 1e-15
    assert 1e-8 < guard.margin32 < 1e-6
    # Rounding does turn it: here the sides differ over the reals, and not in floats.
    trial = Trial({"x": (0.005, 0.005), "y": (1.0, 1.0)}, {"A": 0.0})
    real = exact_step(program, trial.readings, trial.previous)
    assert real.decisions["A"][0].answer
    assert 0 < real.decisions["A"][0].distance < guard.margin64
    assert run(program, trial)[0].raw["A"] == 2.0


def test_a_guard_without_a_bound() -> None:
    program = program_of(text_of("if 1 / peek(x, -1) > 0.5 then 1 else 0"))
    (guard,) = guard_margins(program)
    assert guard.margin64 is None
    assert guard.margin32 is None


def test_the_papers_programs() -> None:
    for name, size in (("aalborg", "0.1608"), ("g-track-1", "1.042")):
        program = program_of((EXAMPLES / "torcs" / "printed" / f"{name}.pirl").read_text())
        told = remarks(program)
        (jump,) = (r for r in told if not r.clear)
        # The leaves differ in their setpoints by 0.04: a gain of kp + 5 ki.
        assert jump.matter is Matter.JUMP
        assert jump.size is not None
        assert jump.size.value == pytest.approx(Fraction(size), abs=1e-12)
        assert len(guard_margins(program)) == 2


@pytest.mark.parametrize("name", ["aalborg", "g-track-1"])
def test_the_papers_programs_take_less_than_a_second(name: str) -> None:
    program = program_of((EXAMPLES / "torcs" / "printed" / f"{name}.pirl").read_text())
    start = time.process_time()
    assert bounds(program)
    assert remarks(program)
    assert guard_margins(program)
    assert time.process_time() - start <= 1.0


def test_planted_dead_branches_are_found() -> None:
    """A condition that cannot hold, put around the body of random programs."""
    rng = random.Random(8)
    kinds = Kinds(odd_numbers=False, depth=3, operators=(Operator.ADD, Operator.MIN, Operator.ABS))
    planted = 0
    while planted < 25:
        program = random_program(rng, kinds)
        spec, body = program.interface.actions[0], program.bodies[0]
        if not isinstance(spec.domain, Continuous):
            continue
        planted += 1
        condition = Apply(Operator.LESS, (Apply(Operator.ABS, (body,)), Literal(-0.5)))
        dead = If(condition, Literal(77.0), body)
        told = remarks(replace(program, bodies=(dead, *program.bodies[1:])))
        texts = [r.text for r in told if r.matter is Matter.DEAD_BRANCH]
        assert any(text.startswith("`77` is never reached") for text in texts)


def test_what_is_told_to_be_dead_may_be_anything() -> None:
    """Random programs act as before when another number stands where no history leads."""
    rng = random.Random(21)
    kinds = Kinds(
        odd_numbers=False,
        depth=4,
        operators=(Operator.ADD, Operator.SUBTRACT, Operator.MIN, Operator.MAX, Operator.CLIP),
    )
    dead = 0
    for _ in range(40):
        program = marked(random_program(rng, kinds))
        if program.size > 90:
            continue
        for remark in remarks(program):
            if remark.matter is not Matter.DEAD_BRANCH or remark.evidence != PROVED:
                continue
            changed = replace(
                program,
                bodies=tuple(elsewhere(body, remark.span) for body in program.bodies),
            )
            dead += 1
            for trial in some_trials(program, 20):
                before, after = (
                    exact_step(p, trial.readings, trial.previous) for p in (program, changed)
                )
                assert before.raw == after.raw
    assert dead > 5


def marked(program: Program) -> Program:
    """The same with a place of its own for every node, as if it had been read from a file."""
    count = itertools.count(1)

    def place(term: Term) -> Term:
        # Not `transform`: it keeps terms that are equal, and places do not count for that.
        number = next(count)
        below = tuple(place(child) for child in children(term))
        return replace(with_children(term, below), span=Span(number, number + 1))

    return replace(program, bodies=tuple(place(body) for body in program.bodies))


def elsewhere(term: Term, at: Span) -> Term:
    """The term with the node at a place replaced by another value of its type."""
    if term.span != at:
        return with_children(term, tuple(elsewhere(child, at) for child in children(term)))
    match type_of(term):
        case Real():
            return Apply(Operator.ADD, (term, Literal(1234.0)))
        case Bool():
            return Apply(Operator.NOT, (term,))
        case Discrete() as type_:
            return DiscreteLiteral(max(type_.values), type_)
        case _:
            return term
