"""Properties: each kind of answer for each kind of expression, replays, obligations."""

from __future__ import annotations

import pytest

from pirlc.ir.evidence import Kind
from pirlc.semantics.precision import BINARY32, BINARY64
from pirlc.verify.model import Perturbation
from pirlc.verify.properties.asking import Limits
from pirlc.verify.properties.prove import prove, prove_perturbed
from tests.verify.proving import HEAD, PROVED, REFUTED, kinds, program_of, proved

X, Y = "peek(x, -1)", "peek(y, -1)"


# One expression, its least upper bound on raw(A): with room proved, 1e-6 tighter refuted.
@pytest.mark.parametrize(
    ("action", "most"),
    [
        (f"2 * {X} - {Y}", 1.5),
        ("fold(+, x) + fold(max, y)", 6.0),
        ("fold(min, y) - fold(*, 0.5 * y)", (8 / 3) ** 0.5 * 2 / 3),
        (f"if {X} > 0 then {Y} else 5 * {X}", 3.0),
        (f"if {X} > 0.25 and not ({Y} > 1) then 4 * {X} else {X}", 4.0),
        (f"if {X} < -0.5 or {Y} <= 0.75 then 1 - {X} else 0", 2.0),
        (f"min({X}, 0.5) + max({Y}, 1)", 3.5),
        (f"abs({X} - {Y})", 4.0),
        (f"clip(3 * {X}, -0.5, {Y})", 3.0),
        (f"sign({X}) * {Y}", 3.0),
        ("peek(abs(diff(x)), -1) + peek(abs(diff(x)), -2)", 4.0),
        (r"fold(\v acc -> 0.5 * acc + v, x, 0)", 1.75),
        (r"fold(\v acc -> if v > acc then v else 0.5 * acc, x, 0)", 1.0),
        ("let e = 0.5 - x in peek(e, -1) + 0.1 * fold(+, e)", 1.95),
        (f"0.5 * previous(A) + {X}", 2.0),
        (f"{X} / {Y}", 2.0),
        (f"{X} * {Y}", 3.0),
        (f"sqrt({Y} + 1)", 2.0),
        (f"{X} + 0 * previous(A)", 1.0),
    ],
)  # fmt: skip
def test_a_bound_is_proved_and_a_tighter_one_refuted(action, most):
    assert kinds(proved(action, f"= raw(A) <= {most + 1e-4}")) == PROVED
    finding = proved(action, f"= raw(A) < {most - 1e-6}")
    assert kinds(finding) == REFUTED
    (step,) = finding.counterexample.steps
    assert most - 1e-6 <= step.raw["A"] <= most + 1e-6


@pytest.mark.parametrize(
    ("action", "claim"),
    [
        (f"tanh(3 * {X})", "= abs(raw(A)) < 1"),
        (f"tanh({X})", "= abs(raw(A)) < 0.7616"),
        (f"tanh({X}) - tanh(peek(x, -2))", "= peek(x, -1) >= peek(x, -2) implies raw(A) > -0.001"),
        (f"exp({X})", "= 0.3678 < raw(A) and raw(A) < 2.7183"),
        (f"exp({X}) * {Y}", "= raw(A) > 0"),
        ("exp(1) + tanh(0.5)", "= 3.1803 < raw(A) and raw(A) < 3.1805"),
    ],
)
def test_functions_are_proved_by_their_axioms(action, claim):
    assert kinds(proved(action, claim)) == PROVED


@pytest.mark.parametrize(
    ("action", "claim"),
    [
        (f"tanh(3 * {X})", "= abs(raw(A)) < 0.9949"),
        (f"exp({X})", "= raw(A) < 2.7182"),
        ("exp(1) + tanh(0.5)", "= raw(A) < 3.1803"),
        (f"sqrt({Y})", "= raw(A) < 1.73205"),
    ],
)
def test_functions_are_refuted_where_the_interpreter_says_so(action, claim):
    assert kinds(proved(action, claim)) == REFUTED


def test_the_applied_action_is_clipped_and_the_raw_one_is_not():
    assert kinds(proved(f"5 * {X}", "= -2 <= A and A <= 2")) == PROVED
    assert kinds(proved(f"5 * {X}", "= raw(A) <= 2")) == REFUTED


def test_a_supremum_attained_only_at_a_corner_refutes_the_strict_claim():
    finding = proved("fold(+, x)", "= raw(A) < 3")
    assert kinds(finding) == REFUTED
    assert finding.counterexample.history.readings["x"] == (1.0, 1.0, 1.0)
    assert kinds(proved("fold(+, x)", "= raw(A) <= 3")) == PROVED


def test_a_claim_that_only_rounding_breaks():
    # 1 + 1e-20 is 1 in floats.
    finding = proved(f"({Y} + 0.00000000000000000001) - {Y}", "= raw(A) > 0")
    assert kinds(finding) == ("proved", "refuted", "refuted")
    assert str(finding.binary64) == "refuted (by rounding alone: it holds over the reals)"
    assert finding.counterexample.steps[0].raw["A"] == 0.0


def test_ranges_are_widened_to_binary32():
    head = "policy example\nsensor z : [0, 0.1] = 0\n"
    # The binary32 number next to 0.1 is 0.100000001490116.
    finding = proved("peek(z, -1)", "= raw(A) <= 0.1", head)
    assert kinds(finding) == REFUTED
    assert finding.counterexample.history.readings["z"] == (0.10000000149011612,)
    assert kinds(proved("peek(z, -1)", "= raw(A) <= 0.1000000015", head)) == PROVED


# Division by zero and roots of negative numbers.


def test_division_by_zero_is_not_left_free():
    finding = proved(f"1 / {X}", "= abs(raw(A)) < 1000000000000000000000000000000000000000000")
    assert finding.evidence.kind is Kind.REFUTED
    assert abs(finding.counterexample.steps[0].raw["A"]) == float("inf")
    assert kinds(proved(f"1 / {X}", "= abs(A) <= 2")) == PROVED
    assert kinds(proved(f"sqrt({X})", "= raw(A) >= 0")) == REFUTED
    assert kinds(proved(f"sqrt({X})", "= 0 <= A")) == ("unknown",) * 3
    assert kinds(proved(f"sqrt({X})", "= -2 <= A and A <= 2")) == PROVED


def test_what_is_not_taken_need_not_be_defined():
    finding = proved(f"if {X} > 0.5 then 1 / {X} else 0", "= raw(A) < 2")
    assert finding.evidence.kind is Kind.PROVED
    finding = proved(f"if {X} > -0.5 then 1 / {X} else 0", "= raw(A) < 1000")
    assert finding.evidence.kind is Kind.REFUTED


def test_undefined_everywhere_is_unknown_with_the_reason():
    finding = proved(f"1 / ({X} - {X})", "= raw(A) != 1")
    assert kinds(finding) == ("unknown",) * 3
    assert finding.evidence.reason == (
        "a division by zero or the root of a negative number is possible; "
        "not violated on 10,000 histories"
    )


# Several steps.


def test_a_rate_limit_holds_of_the_applied_action():
    action = f"clip(previous(A) + clip({X}, -0.125, 0.125), -1, 1)"
    # The first step may come from anywhere in [-2, 2], whence the premise.
    claim = "over 4 = abs(peek(A, -4)) <= 1 implies fold(max, abs(diff(A))) <= 0.125"
    # In floats -1 + 0.125 - 1e-17 may be off by an ulp.
    assert kinds(proved(action, claim)) == ("proved", "unknown", "unknown")
    assert kinds(proved(action, claim.replace("<= 0.125", "<= 0.12501"))) == PROVED
    finding = proved(action, claim.replace("<= 0.125", "<= 0.12"))
    assert kinds(finding) == REFUTED
    assert len(finding.counterexample.steps) == 4


def test_previous_in_a_property_is_the_step_before():
    assert kinds(proved(X, "over 3 = peek(previous(A), -1) == peek(A, -2)")) == PROVED
    assert kinds(proved(X, "over 3 = peek(previous(A), -1) == peek(A, -1)")) == REFUTED
    assert kinds(proved(f"previous(A) + {X}", "= abs(raw(A) - previous(A)) <= 1.01")) == PROVED


@pytest.mark.parametrize("steps", [1, 2, 3, 7])
@pytest.mark.parametrize("window", [1, 3, 5])
def test_fewer_and_more_steps_than_the_window(steps, window):
    head = f"policy example\nsensor x : [-1, 1] = 0\nwindow {window}\n"
    bound = 2 if steps > 1 else 1
    claim = f"over {steps} = fold(max, raw(A)) - fold(min, raw(A)) <= {{}}"
    if steps == 1:
        claim = f"over {steps} = fold(max, raw(A)) <= {{}}"
    assert kinds(proved(X, claim.format(bound), head)) == PROVED
    assert kinds(proved(X, claim.format(bound - 0.01), head)) == REFUTED


def test_sensors_over_n_are_their_last_n_readings():
    claim = "over 2 = peek(raw(A), -1) == peek(x, -1) and peek(raw(A), -2) == peek(x, -2)"
    assert kinds(proved(X, claim)) == PROVED
    # Without `over`, a sensor is its window.
    assert kinds(proved("peek(x, -3)", "= raw(A) == peek(x, -3)")) == PROVED


def test_latency_delays_the_replay_too():
    head = HEAD + "latency 2\n"
    assert kinds(proved(X, "= raw(A) < 0.5", head)) == REFUTED
    assert kinds(proved(X, "over 3 = peek(raw(A), -2) == peek(x, -2)", head)) == PROVED


DISCRETE = """policy example
sensor x : [-1, 1] = 0
action A : {0, 1, 2} = if peek(x, -1) > 0.5 then 2
                       else if peek(x, -1) < -0.5 then 0 else previous(A)
"""


def discrete(claim: str):
    program = program_of(f"{DISCRETE}property p {claim}\n")
    return prove(program)[0]


def test_discrete_actions_with_hysteresis():
    assert kinds(discrete("= peek(x, -1) > 0.5 implies A == 2")) == PROVED
    assert kinds(discrete("= A != 1 or previous(A) == 1")) == PROVED
    finding = discrete("= A != 1")
    assert kinds(finding) == REFUTED
    assert finding.counterexample.history.previous == {"A": 1.0}
    over = "over 3 = abs(peek(x, -1)) <= 0.5 implies peek(A, -1) == peek(A, -2)"
    assert kinds(discrete(over)) == PROVED


def test_several_actions_see_each_others_previous():
    text = HEAD + (
        "action A : [-1, 1] = previous(B) + peek(x, -1)\n"
        "action B : [0, 1] = previous(A)\n"
        "property p over 2 = peek(B, -1) == clip(peek(A, -2), 0, 1)\n"
        "property q over 2 = peek(B, -1) == peek(A, -2)\n"
    )
    first, second = prove(program_of(text))
    assert kinds(first) == PROVED
    assert kinds(second) == REFUTED


# Guards and rounding.


def test_a_guard_that_rounding_may_turn_leaves_the_property_unproved_in_floats():
    # The sum of three readings of 0.1 passes 0.3 in some order of rounding only.
    action = "if fold(+, x) - 3 * peek(x, -1) > 0 then 1 else 0"
    claim = "= peek(x, -1) == peek(x, -2) and peek(x, -2) == peek(x, -3) implies raw(A) == 0"
    finding = proved(action, claim)
    assert finding.evidence.kind is Kind.PROVED
    assert finding.binary64.kind is not Kind.PROVED


def test_perturbed_by_nothing_is_the_plain_question():
    program = program_of(HEAD + f"action A : [-2, 2] = {X}\nproperty p = raw(A) <= 1\n")
    (claim,) = program.properties
    from pirlc.verify.properties.asking import Found, Never

    exactly = Perturbation(BINARY64, {"A": 0}, {})
    assert isinstance(prove_perturbed(program, claim, exactly), Never)
    assert not isinstance(prove_perturbed(program, claim, Perturbation(BINARY32, {}, {})), Found)


# Limits.


def test_a_limit_is_told():
    text = HEAD + (
        "action A : [-9, 9] = peek(x, -1) * peek(x, -2) * peek(y, -1) + peek(x, -3) * peek(y, -2)\n"
        "property p over 3 = fold(+, raw(A) * raw(A) * raw(A)) + fold(*, x + y) != 7.25\n"
    )
    program = program_of(text)
    (finding,) = prove(program, Limits(work=2_000, tests=1_000))
    assert finding.evidence.kind is Kind.UNKNOWN
    assert finding.evidence.reason == (
        "z3's limit of 2,000 units of work reached; not violated on 1,000 histories"
    )
    (again,) = prove(program, Limits(work=2_000, tests=1_000))
    assert again.evidence == finding.evidence


def test_a_program_too_large_is_told():
    text = "policy example\nsensor x : [-1, 1] = 0\nwindow 9000\n" + (
        "action A : [-1, 1] = fold(+, x)\nproperty p over 9000 = peek(A, -1) <= 1\n"
    )
    (finding,) = prove(program_of(text), Limits(tests=0))
    assert str(finding.evidence).startswith("unknown (too large for z3: ")


def test_random_histories_find_what_z3_gives_up_on():
    text = HEAD + f"action A : [-2, 2] = {X} * {Y} * peek(x, -2)\nproperty p = raw(A) < 1\n"
    (finding,) = prove(program_of(text), Limits(work=1))
    assert kinds(finding) == REFUTED


# Obligations.


def obligations(finding) -> dict[str, str]:
    return {o.name: str(o.evidence) for o in finding.obligations}


def test_warm_up_of_one_step_is_covered():
    told = obligations(proved(X, "= raw(A) <= 1"))
    assert told == {
        "warm-up": "proved (a window of one reading over again, or of the middle of the range, "
        "is a history)"
    }


def test_a_late_first_reading_fills_the_window_at_one_go():
    # The oldest reading of a window is not the middle one of the window before.
    claim = "over 2 = peek(raw(A), -1) == peek(x, -2)"
    finding = proved("peek(x, -2)", claim)
    assert kinds(finding) == PROVED
    (warm_up,) = finding.obligations
    assert warm_up.evidence.kind is Kind.REFUTED
    assert warm_up.counterexample.steps[0].raw["A"] == 0.0
    # A bound does not care.
    (warm_up,) = proved("peek(x, -2)", "over 2 = fold(max, raw(A)) <= 1").obligations
    assert warm_up.evidence.kind is Kind.PROVED


def test_windows_filled_with_zeros_outside_the_range():
    finding = proved("fold(+, y)", "= raw(A) >= 1.5", HEAD + "fill zero\n")
    assert kinds(finding) == PROVED
    (warm_up,) = finding.obligations
    assert warm_up.evidence.kind is Kind.REFUTED
    assert 0.0 in warm_up.counterexample.history.readings["y"]
    assert obligations(proved("fold(+, x)", "= raw(A) >= -3", HEAD + "fill zero\n")) == {
        "warm-up": "proved"
    }
    head = "policy example\nsensor x : [-1, 1] = 0\nfill zero\n"
    assert obligations(proved(X, "= raw(A) >= -3", head)) == {
        "warm-up": "proved (zero is a reading in the range)"
    }


def test_missing_readings_that_become_zeros():
    head = (
        "policy example\nsensor x : [-1, 1] = 0\nsensor y : [0.5, 3] = 1 missing zero\nwindow 2\n"
    )
    finding = proved(Y, "= raw(A) >= 0.5", head)
    assert kinds(finding) == PROVED
    missing = finding.obligations[1]
    assert (missing.name, missing.evidence.kind) == ("missing readings", Kind.REFUTED)
    assert missing.counterexample.steps[0].raw["A"] == 0.0
    assert obligations(proved(Y, "= raw(A) >= 0", head))["missing readings"] == "proved"


def test_safe_values_where_a_sensor_may_fail():
    head = "policy example\nsensor y : [0.5, 3] = 0 missing fail\nwindow 2\n"
    finding = proved(Y, "= A >= 0.5", head)
    assert kinds(finding) == PROVED
    safe = finding.obligations[-1]
    assert (safe.name, safe.evidence.kind) == ("safe values", Kind.REFUTED)
    assert safe.counterexample.steps[0].applied["A"] == 0.0
    assert obligations(proved(Y, "= A >= 0", head))["safe values"] == "proved"
    late = head.replace("missing fail", "missing hold 3 then fail")
    assert proved(Y, "= A >= 0.5", late).obligations[-1].evidence.kind is Kind.REFUTED


def test_obligations_of_what_does_not_hold_are_left_open():
    assert obligations(proved(X, "= raw(A) < 0")) == {
        "warm-up": "unknown (the property is refuted without it)"
    }


def test_what_may_be_is_allowed_together():
    # Safe while the first reading is late, then a window filled at one go: neither alone does it.
    head = "policy example\nsensor y : [0.5, 3] = 0 missing fail\nwindow 2\n"
    claim = "over 2 = peek(A, -2) > 0 or peek(raw(A), -1) == peek(y, -2) or peek(y, -1) == 1.75"
    finding = proved("peek(y, -2)", claim, head)
    told = {o.name: o.evidence.kind for o in finding.obligations}
    assert finding.evidence.kind is Kind.PROVED
    assert told == {"warm-up": Kind.PROVED, "safe values": Kind.REFUTED}
    shown = finding.obligations[-1].counterexample
    assert shown.steps[0].applied["A"] == 0.0
    assert shown.steps[1].raw["A"] != 1.75
