"""What the controller of a program keeps, computes and leaves out."""

from __future__ import annotations

from pirlc.ir.controller import (
    Branch,
    Channel,
    Declare,
    Define,
    Kind,
    Loop,
    Operation,
    Select,
    Set,
    declared,
    expressions,
    worst_path,
)
from pirlc.ir.operators import Operator
from pirlc.lower import lower
from pirlc.lower.blocks import Names
from tests.backend.helpers import NAMES, load_program, program_of


def controller(action: str, *lines: str):
    return lower(
        program_of(
            "\n".join(
                [
                    "policy small",
                    "sensor x : [0, 1] = 0",
                    "sensor y : [-2, 6] = 3 missing zero",
                    *lines,
                    f"action u : [-9, 9] safe 0 = {action}",
                ]
            )
        )
    )


def depths(action: str, *lines: str) -> list[int]:
    return [channel.depth for channel in controller(action, *lines).channels]


def test_buffers_are_as_long_as_the_program_looks_back():
    window = ("window 10",)
    assert depths("peek(x, -1)", *window) == [1, 0]
    assert depths("peek(x, -4) + peek(y, -2)", *window) == [4, 2]
    assert depths("fold(+, y)", *window) == [0, 10]
    assert depths("peek(diff(diff(x)), -2)", *window) == [4, 0]
    assert depths("peek(x, -1)", *window, "latency 3") == [4, 0]
    assert depths("fold(+, 1 - x)", *window, "latency 3") == [13, 0]


def test_what_no_action_depends_on_is_left_out():
    made = controller(
        "let a = peek(y, -5) + 1 in let s = fold(\\v acc -> acc + v * a, y, 0) in peek(x, -1)",
        "window 20",
    )
    assert declared(made.statements) == ["u"]
    assert [channel.depth for channel in made.channels] == [1, 0]


def test_what_the_state_keeps_of_a_sensor():
    hold, zero = controller("peek(x, -1) + peek(y, -1)").channels
    assert (hold.kept, hold.awaits_first, hold.initial) == (1, False, 0.5)
    assert (zero.kept, zero.awaits_first, zero.initial) == (0, True, 2.0)
    hold, zero = controller("peek(x, -2) + peek(y, -2)", "window 2").channels
    assert (hold.kept, hold.awaits_first, zero.kept, zero.awaits_first) == (2, True, 2, True)
    hold, zero = controller("peek(x, -2) + peek(y, -1)", "window 2", "fill zero").channels
    assert (hold.kept, hold.awaits_first, hold.initial) == (2, False, 0.0)
    assert (zero.kept, zero.awaits_first, zero.initial) == (0, False, 0.0)


def test_ranges_as_declared_and_as_judged():
    made = controller("peek(x, -1)").channels[1]
    assert isinstance(made, Channel)
    assert (made.index, made.lower, made.upper, made.low, made.high) == (3, -2, 6, -2, 6)


def test_short_folds_are_written_out_and_long_ones_are_one_loop():
    short = controller("fold(+, 1 - x)", "window 5").statements
    assert not any(isinstance(s, Loop) for s in short)
    made = controller("fold(+, 1 - x)", "window 50")
    assert [type(s) for s in made.statements] == [Declare, Loop, Declare]
    loop = made.statements[1]
    assert isinstance(loop, Loop) and loop.index.count == 49


def test_conditionals_become_branches():
    nested = "if peek(x, -1) > 0 then (if peek(y, -1) > 0 then 1 else 2) else 3"
    statements = controller(nested).statements
    assert [type(s) for s in statements] == [Declare, Branch]
    short = controller("1 + (if peek(x, -1) > 0 then peek(y, -1) else 2)").statements
    assert any(isinstance(e, Select) for e in expressions(short))


def test_named_values_are_computed_once():
    made = controller("let e = 0.5 - x in peek(e, -1) * peek(e, -1) + fold(+, e)", "window 3")
    names = [s.local.name for s in made.statements if isinstance(s, Define)]
    assert names == ["e_0", "e_2", "e_1"]
    differences = [
        e
        for e in expressions(made.statements)
        if isinstance(e, Operation) and e.operator is Operator.SUBTRACT
    ]
    assert len(differences) == 3


def test_names_of_names_do_not_multiply():
    chain = " ".join(f"let s{k + 1} = s{k} + s{k} in" for k in range(30))
    made = controller(f"let s0 = x * x in {chain} peek(s30, -1)", "window 2")
    assert worst_path(made.statements) == 31
    wide = "diff(" * 25 + "x" + ")" * 25
    made = controller(f"fold(+, {wide})", "window 60")
    assert worst_path(made.statements) < 60 * 400


def test_expressions_stay_low():
    made = controller(" + ".join(["peek(x, -1)"] * 150))
    tallest = max(e.height for e in expressions(made.statements) if isinstance(e, Operation))
    assert tallest <= 21


def test_previous_actions_are_kept_where_they_are_read():
    kept = {o.name: o.keeps_previous for o in lower(load_program("two_actions")).outputs}
    assert kept == {"steer": True, "gear": True}
    assert [o.keeps_previous for o in controller("peek(x, -1)").outputs] == [False]


def test_lowering_is_deterministic():
    for name in NAMES:
        assert lower(load_program(name)) == lower(load_program(name))


def loops(made) -> list[int]:
    """How many times each loop of the controller runs, outer ones first."""
    return [s.index.count for s in made.statements if isinstance(s, Loop)]


def test_folds_over_eight_elements_are_written_out_and_over_nine_are_not():
    for operator in ("+", "*", "min", "max"):
        assert loops(controller(f"fold({operator}, x)", "window 8")) == []
        assert loops(controller(f"fold({operator}, x)", "window 9")) == [8]
    own = "fold(\\v acc -> acc * 0.5 + v, x, 1)"
    assert loops(controller(own, "window 8")) == []
    assert loops(controller(own, "window 9")) == [9]
    assert loops(controller("fold(+, diff(x))", "window 9")) == []


def test_folds_in_folds_do_not_multiply():
    nested = "fold(\\v acc -> acc + v * fold(+, x), x, 1)"
    assert loops(controller(nested, "window 3")) == [3]
    assert loops(controller(nested, "window 1")) == []


def test_accumulators_bear_the_name_of_what_they_gather():
    for operator, name in (("+", "sum"), ("*", "product"), ("min", "least"), ("max", "greatest")):
        made = controller(f"fold({operator}, x)", "window 20")
        assert declared(made.statements)[:2] == [name, "i"]
    assert declared(controller("fold(min, x)", "window 3").statements) == ["least", "u"]


def test_short_conditionals_are_one_expression():
    def is_expression(consequent: str) -> bool:
        made = controller(f"if peek(x, -1) > 0 then {consequent} else 2", "window 2")
        return not any(isinstance(s, Branch) for s in made.statements)

    # Three nodes for each of the readings, one for each sum, one for the 2: twelve, and thirteen.
    readings = " + ".join(["peek(x, -1)"] * 3)
    assert is_expression(readings)
    assert not is_expression(f"abs({readings})")
    for larger in ("if peek(y, -1) > 0 then 1 else 3", "let a = 1 in a", "fold(+, x)"):
        assert not is_expression(f"({larger})")


def test_what_an_operator_mentions_twice_is_computed_once():
    for action in (
        "min(peek(x, -1) * 2, 1)",
        "sign(peek(x, -1) - 0.5)",
        "clip(0 - peek(x, -1), 0, 1)",
    ):
        made = controller(action)
        assert len(made.statements) == 2
        assert declared(made.statements) == ["part", "u"]
        assert worst_path(made.statements) == 2
    assert declared(controller("abs(peek(x, -1) - 0.5)").statements) == ["u"]


def test_parts_of_tall_expressions_have_the_kind_of_their_value():
    guard = " and ".join(f"peek(x, -1) > {k}" for k in range(30))
    made = controller(f"if {guard} then 1 else 0")
    parts = [s.local for s in made.statements if isinstance(s, Define)]
    assert parts and {part.kind for part in parts} == {Kind.BOOL}
    made = controller("let a = peek(x, -1) > 0 in if a and peek(y, -1) > 1 then 1 else 0")
    assert [s.local.kind for s in made.statements if isinstance(s, Define)] == [Kind.BOOL]
    made = controller(" + ".join(["peek(x, -1)"] * 150))
    assert {s.local.kind for s in made.statements if isinstance(s, Define)} == {Kind.REAL}
    tallest = max(e.height for e in expressions(made.statements) if isinstance(e, Operation))
    assert tallest == 21


def test_discrete_actions_and_what_they_remember_are_discrete():
    outputs = lower(load_program("two_actions")).outputs
    assert {o.name: o.raw.kind for o in outputs} == {"steer": Kind.REAL, "gear": Kind.DISCRETE}
    made = lower(
        program_of(
            """
            policy kinds
            sensor x : [0, 1] = 0
            action u : {0, 1, 2} =
                let before = previous(u) in
                let next = if peek(x, -1) > 0.5 then 1 else (if peek(x, -1) > 0.2 then 2 else 0) in
                if before == next then before else next
            """
        )
    )
    kinds = {s.local.name: s.local.kind for s in made.statements if isinstance(s, Declare)}
    assert set(kinds.values()) == {Kind.DISCRETE} and len(kinds) > 1


def test_branches_and_loops_are_left_out_with_what_they_compute():
    unused = "let a = if peek(x, -1) > 0 then fold(+, y) else fold(max, y) in "
    made = controller(unused + "peek(x, -1)", "window 20")
    assert [type(s) for s in made.statements] == [Declare]
    half = controller(
        "if peek(x, -1) > 0 then (let a = fold(+, y) in fold(max, x)) else fold(min, x)",
        "window 20",
    )
    [branch] = [s for s in half.statements if isinstance(s, Branch)]
    assert [type(s) for s in branch.consequent] == [Declare, Loop, Set]
    assert [channel.depth for channel in half.channels] == [20, 0]


def test_both_sides_of_a_conditional_compute_for_themselves():
    made = controller(
        "let e = x * 2 in if peek(y, -1) > 0 then peek(e, -1) + 1 else (let b = 1 in peek(e, -1))",
        "window 2",
    )
    [branch] = [s for s in made.statements if isinstance(s, Branch)]
    assert [s.local.name for s in branch.consequent if isinstance(s, Define)] == ["e_0"]
    assert [s.local.name for s in branch.alternative if isinstance(s, Define)] == ["e_0_2"]


def test_names_that_are_taken_are_numbered_from_two():
    names = Names(["a", "a_3"])
    assert [names.fresh("a") for _ in range(3)] == ["a_2", "a_4", "a_5"]
    assert [names.fresh("b") for _ in range(2)] == ["b", "b_2"]


def test_elements_in_loops_bear_the_name_of_their_sequence():
    made = controller("let e = 1 - x in fold(+, e * e)", "window 20")
    assert declared(made.statements) == ["e_19", "sum", "i", "e", "u"]


def test_what_was_computed_before_a_conditional_is_used_inside():
    made = controller(
        "let e = x * 2 in peek(e, -1) + (if peek(y, -1) > 0 then min(peek(e, -1) + 1, 1) else 0)"
    )
    assert [name for name in declared(made.statements) if name.startswith("e")] == ["e_0"]


def test_lets_in_values_and_in_operands():
    inner = "let b = peek(x, -1) + 1 in b * b"
    assert declared(controller(f"let a = ({inner}) in a + a").statements) == ["b", "a", "u"]
    assert declared(controller(f"2 + ({inner})").statements) == ["b", "u"]
    assert declared(controller(f"fold(\\v acc -> acc + v, x, ({inner}))").statements)[0] == "b"


def test_values_that_are_conditionals():
    long = "if peek(x, -1) > 0 then (if peek(y, -1) > 0 then 1 else 2) else 3"
    made = controller(f"let a = {long} in a * a")
    assert [type(s) for s in made.statements] == [Declare, Branch, Declare]
    assert declared(made.statements) == ["a", "u"]
    short = controller("let a = if peek(x, -1) > 0 then 1 else 2 in a * a")
    assert [type(s) for s in short.statements] == [Define, Declare]
    guard = controller("let a = peek(x, -1) > 0 in if a and peek(y, -1) > 0 or a then 1 else 0")
    [first, _] = guard.statements
    assert isinstance(first, Define) and (first.local.name, first.local.kind) == ("a", Kind.BOOL)


def test_sides_that_compute_something_first_make_a_branch_of_an_operand():
    for sides in ("min(peek(y, -1) + 1, 2) else 3", "3 else min(peek(y, -1) + 1, 2)"):
        made = controller(f"1 + (if peek(x, -1) > 0 then {sides})")
        assert [type(s) for s in made.statements] == [Declare, Branch, Declare]
        assert declared(made.statements) == ["chosen", "part", "u"]
        branch = made.statements[1]
        assert isinstance(branch, Branch)
        assert {type(branch.consequent[-1]), type(branch.alternative[-1])} == {Set}
        assert len(branch.consequent) + len(branch.alternative) == 3


def chain(operators: int) -> str:
    """An `and` of comparisons: so many operators high."""
    return " and ".join(["peek(x, -1) > 0"] * operators)


def test_conditions_are_named_above_twenty_operators():
    low = controller(f"if {chain(20)} then 1 else 0")
    assert declared(low.statements) == ["u"]
    high = controller(f"if {chain(21)} then 1 else 0")
    assert declared(high.statements) == ["holds", "u"]
    first = high.statements[0]
    assert isinstance(first, Define) and first.local.kind is Kind.BOOL


def test_conditionals_with_tall_sides_are_branches():
    tall = " + ".join(["peek(x, -1)"] * 22)
    for sides in (f"{tall} else 0", f"0 else {tall}"):
        made = controller(f"abs(if peek(y, -1) > 0 then {sides})")
        assert declared(made.statements) == ["chosen", "u"]
    made = controller(f"abs(if peek(y, -1) > 0 then {tall[:-14]} else 0)")
    [select] = [e for e in expressions(made.statements) if isinstance(e, Select)]
    assert select.height == 21


def test_a_tall_choice_of_discrete_values_is_a_discrete_part():
    made = lower(
        program_of(
            f"""
            policy tall
            sensor x : [0, 1] = 0
            action u : {{0, 1}} = if previous(u) == (if {chain(20)} then 1 else 0) then 1 else 0
            """
        )
    )
    parts = [s.local for s in made.statements if isinstance(s, Define)]
    assert [part.kind for part in parts] == [Kind.DISCRETE]
