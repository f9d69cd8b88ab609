"""The numbers that would just hold, for the sides of properties' comparisons."""

from __future__ import annotations

from fractions import Fraction

import pytest

from pirlc.verify.bounds.tightening import tightened
from pirlc.verify.properties.asking import DEFAULT_LIMITS
from pirlc.verify.properties.prove import prove
from tests.verify.proving import HEAD, precision_of_replay, program_of


def ends(action: str, claim: str):
    program = program_of(f"{HEAD}action A : [-2, 2] safe 0 = {action}\nproperty p {claim}\n")
    (finding,) = tightened(program, prove(program))
    for tight in finding.tightest:
        if tight.extreme.witness is not None:
            precision_of_replay(program, tight.extreme.witness)
    return [
        (tight.text, tight.upward, tight.extreme.value, tight.extreme.attained)
        for tight in finding.tightest
    ]


def test_each_comparison_with_a_number_has_its_own():
    assert ends("2 * peek(x, -1)", "= -5 < raw(A) and raw(A) <= 1") == [
        ("raw(A)", False, Fraction(-2), True),
        ("raw(A)", True, Fraction(2), True),
    ]
    assert ends("2 * peek(x, -1)", "= 3 > abs(raw(A))") == [("abs(raw(A))", True, 2, True)]
    assert ends("2 * peek(x, -1)", "= raw(A) < peek(y, -1)") == []
    assert ends("peek(x, -1) * peek(x, -2)", "= raw(A) < 3") == []


def test_premises_count_and_strict_ones_are_not_attained():
    claim = "over 2 = abs(peek(x, -1) - peek(x, -2)) < 0.5 implies peek(A, -1) - peek(A, -2) < 3"
    assert ends("2 * peek(x, -1)", claim) == [
        ("peek(A, -1) - peek(A, -2)", True, Fraction(1), False)
    ]
    assert ends("2 * peek(x, -1)", claim.replace("< 0.5", "<= 0.5"))[0][2:] == (1, True)


def test_another_action_that_z3_knows_by_bounds_only_is_left_out():
    text = f"{HEAD}action A : [-2, 2] = peek(x, -1)\naction B : [-1, 1] = tanh(peek(x, -1))\n"
    program = program_of(f"{text}property p = A < 2\nproperty q = B < 2\n")
    first, second = tightened(program, prove(program))
    assert [t.extreme.value for t in first.tightest] == [1]
    assert first.tightest[0].extreme.witness.steps[0].applied["A"] == 1.0
    assert second.tightest == ()


@pytest.mark.parametrize(
    ("name", "most"), [("aalborg", (0.47742, 0.306)), ("g-track-1", (1.34116, 0.28476))]
)
def test_the_papers_smoothness_tightly(printed, name, most):
    program = printed(name)
    findings = tightened(program, prove(program), DEFAULT_LIMITS)
    for finding, value in zip(findings, most, strict=False):
        (tight,) = finding.tightest
        assert float(tight.extreme.value) == pytest.approx(value, abs=1e-12)
        assert not tight.extreme.attained
        steps = tight.extreme.witness.steps[-2:]
        action = next(name for name in steps[0].raw if name in finding.text)
        change = abs(steps[1].raw[action] - steps[0].raw[action])
        assert change == pytest.approx(value, abs=2e-9)
        precision_of_replay(program, tight.extreme.witness)
