"""What is said of properties that are not proved, word for word; every code has its page."""

from __future__ import annotations

import re
from pathlib import Path

from pirlc.diagnostics import render
from pirlc.resources import explanations
from pirlc.source import SourceText
from pirlc.verify import problems
from pirlc.verify.properties.prove import prove
from tests.verify.proving import HEAD, program_of

BODY = HEAD + "action A : [-2, 2] safe 0 = {action}\nproperty p = {claim}\n"


def said(action: str, claim: str) -> list[str]:
    text = BODY.format(action=action, claim=claim)
    findings = prove(program_of(text))
    return [render(d) for d in problems.problems_of(SourceText("example.pirl", text), findings)]


def test_e0901_violated():
    assert said("2 * peek(x, -1)", "raw(A) >= -2 and (peek(x, -1) > 0 implies raw(A) < 1)") == [
        "error[E0901]: the property p does not hold\n"
        " --> example.pirl:6:56\n"
        "  |\n"
        "6 | property p = raw(A) >= -2 and (peek(x, -1) > 0 implies raw(A) < 1)\n"
        "  |                                                        ^^^^^^^^^^ false on the "
        "history below"
    ]


def test_e0901_by_rounding():
    action = "(peek(y, -1) + 0.00000000000000000001) - peek(y, -1)"
    assert said(action, "raw(A) > 0") == [
        "error[E0901]: the property p does not hold\n"
        " --> example.pirl:6:14\n"
        "  |\n"
        "6 | property p = raw(A) > 0\n"
        "  |              ^^^^^^^^^^ false by rounding\n"
        "  |\n"
        "  = note: over the reals it is proved; the history below violates it as computed"
    ]


def test_e0902_undecided():
    assert said("1 / (peek(x, -1) - peek(x, -1))", "raw(A) != 1") == [
        "warning[E0902]: the property p is neither proved nor refuted\n"
        " --> example.pirl:6:10\n"
        "  |\n"
        "6 | property p = raw(A) != 1\n"
        "  |          ^\n"
        "  |\n"
        "  = note: a division by zero or the root of a negative number is possible; not violated "
        "on 10,000 histories"
    ]


def test_nothing_is_said_of_what_is_proved():
    assert said("peek(x, -1)", "raw(A) <= 1") == []


def test_every_code_has_a_page_whose_examples_are_judged_as_it_says():
    codes = re.findall(r'"(E\d{4})"', Path(problems.__file__).read_text(encoding="utf-8"))
    assert codes == ["E0901", "E0902"]
    for code in codes:
        page = (explanations() / f"{code}.md").read_text(encoding="utf-8")
        assert page.startswith(f"# {code}: ") and "## What to do" in page
        wrong, right = re.findall(r"```pirl\n(.*?)```", page, re.DOTALL)
        source = SourceText("page.pirl", wrong)
        (found,) = problems.problems_of(source, prove(program_of(wrong)))
        assert found.code == code
        assert problems.problems_of(source, prove(program_of(right))) == ()
