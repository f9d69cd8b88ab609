"""A sketch without its branches allows exactly those of its programs that have no `if`."""

from __future__ import annotations

from itertools import islice

import pytest

from pirlc.frontend import parse_sketch
from pirlc.ir.ablation import bound_to_branch, has_branches, without_branches
from pirlc.ir.expansion import expand
from pirlc.ir.policy import ProgramTemplate, Sketch
from pirlc.ir.printer import program_text, sketch_text
from pirlc.ir.terms import If, subterms
from pirlc.search.enumeration import Enumeration
from pirlc.source import SourceText
from tests.search.sketches import CLASHES, SHAPES, sketch_of


def templates(sketch: Sketch, largest: int) -> list[ProgramTemplate]:
    found = Enumeration(sketch).shortest_first(largest)
    return [expand(sketch, derivations).template for derivations in found]


def has_if(template: ProgramTemplate) -> bool:
    return any(isinstance(sub, If) for body in template.bodies for sub in subterms(body))


MIXED = """
    action A : [-1, 1] = Law
    rule Law = peek(S, -1)
             | if Guard then Law else Law
             | Law + Switched
             | Circle * ?k
             | Law - Plain(if Guard then 1 else 2)
             | Plain(Law)
    rule Plain(x) = ?k * x | if x > 0 then x else ?k
    rule Switched = if Guard then Law else Law | Switched + Law
    rule Circle = Circle + 1 | if Guard then 1 else 2
    rule Guard = peek(T, -1) > ?c | Guard and Guard
"""


@pytest.mark.parametrize(
    ("text", "largest"),
    [(MIXED, 12), (CLASHES["numbers and bounds"], 12), (CLASHES["nested lets"], 32)],
)
def test_what_is_left_are_the_programs_without_if(text: str, largest: int) -> None:
    sketch = sketch_of(text)
    allowed = [program_text(t) for t in templates(sketch, largest) if not has_if(t)]
    left = [program_text(t) for t in templates(without_branches(sketch), largest)]
    assert len(left) > 2
    assert left == allowed


def test_rules_that_cannot_end_any_more_are_gone_and_so_is_what_needs_them() -> None:
    left = without_branches(sketch_of(MIXED))
    assert [rule.key for rule in left.rules] == ["Law", "Plain"]
    assert [len(rule.alternatives) for rule in left.rules] == [2, 1]
    assert has_branches(sketch_of(MIXED)) and not has_branches(left)
    assert without_branches(left) == left


def test_actions_without_a_program() -> None:
    text = """
        action A : [-1, 1] = if peek(S, -1) > 0 then 1 else ?k
        action B : [-1, 1] = R
        action C : [-1, 1] = peek(S, -1) + Q
        rule R = if peek(S, -1) > ?c then Q else Q | R + R
        rule Q = ?k | if peek(S, -1) > 0 then 1 else Q
    """
    assert [action.name for action in bound_to_branch(sketch_of(text))] == ["A", "B"]


# The text of a sketch.


@pytest.mark.parametrize("text", [MIXED, *SHAPES.values(), *CLASHES.values()])
def test_the_text_of_a_sketch_reads_back_as_the_same_sketch(text: str) -> None:
    sketch = sketch_of(text)
    printed = sketch_text(sketch, ("what this is",))
    assert printed.startswith("# what this is\n\npolicy p\n")
    again = parse_sketch(SourceText("printed", printed))
    assert sketch_text(again, ("what this is",)) == printed
    assert again.interface == sketch.interface
    assert again.parameters == sketch.parameters
    assert again.properties == sketch.properties
    assert _some(again) == _some(sketch)


def _some(sketch: Sketch) -> list[str]:
    found = islice(Enumeration(sketch).shortest_first(32), 60)
    return [program_text(expand(sketch, derivations).template) for derivations in found]


def test_a_rule_used_with_several_types_is_several_rules() -> None:
    text = """
        action A : [-1, 1] = R(S) + R(peek(S, -1)) + R_2
        rule R(x) = ?k * Q(x)
        rule Q(R_3) = fold(+, R_3 * S)
        rule R_2 = ?k
    """
    assert sketch_text(sketch_of(text)).split("\n\n")[2:] == [
        "action A : [-1, 1] = R(S) + R_4(peek(S, -1)) + R_2",
        "rule R(x) = ?k * Q(x)",
        "rule R_4(x) = ?k * Q_2(x)",
        "rule Q(R_3) = fold(+, R_3 * S)",
        "rule Q_2(R_3) = fold(+, R_3 * S)",
        "rule R_2 = ?k\n",
    ]


def test_holes_are_written_as_short_as_they_can_be() -> None:
    text = """
        action A : [-1, 1] = ?a + ?(b = 2) * ?(c in [0, 1]) - ?(d in [-100, 100] = 0.5) + ?(e in [-1, 5] = 1)
    """  # noqa: E501
    assert "?a + ?(b = 2) * ?(c in [0, 1]) - ?(d = 0.5) + ?(e in [-1, 5] = 1)" in sketch_text(
        sketch_of(text)
    )
