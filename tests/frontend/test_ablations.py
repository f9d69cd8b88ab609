"""NoSketch and NoIF as text, and what is said where they make no sense."""

from __future__ import annotations

import pytest

from pirlc import resources
from pirlc.diagnostics import PirlcError, render
from pirlc.frontend import check, format_source
from pirlc.frontend.ablations import without_if, without_sketch
from pirlc.ir.expansion import expand
from pirlc.ir.policy import Choice, ProgramTemplate, Sketch
from pirlc.ir.terms import Apply, ParameterRef, PreviousAction, SensorRef, subterms
from pirlc.search.enumeration import Enumeration
from pirlc.source import SourceText

TWO = """policy two

environment "Two-v0" { gain = 0.5 }

sensor S : [-1, 1] = 3 missing hold 10 then fail
sensor T : [-2, 2] = 1
window 2
latency 1

param limit in [0, 1]
param unread in [0, 1]

action Steer : [-1, 1] = 1 safe 0.25 = limit * PID(S)
action Gear : {1, 2, 3} = 0 safe 2 = if PID(T) > unread then 3 else previous(Gear)

rule PID(h) = ?kp * peek(h, -1)

property Real = Steer < limit
property still over 3 = let Signal = 2 in fold(min, Steer) < Signal
"""

GRAMMAR = """# The language's own grammar over the sensors of two: what `--no-sketch`
# searches in place of the sketch's own expressions and rules.

policy two

environment "Two-v0" { gain = 0.5 }

sensor S : [-1, 1] = 3 missing hold 10 then fail
sensor T : [-2, 2] = 1
window 2
latency 1

param limit in [0, 1]

action Steer : [-1, 1] = 1 safe 0.25 = Real_2

action Gear : {1, 2, 3} = 0 safe 2 = Value

rule Value = 1
           | 2
           | 3
           | previous(Gear)
           | if Condition then Value else Value

rule Real_2 = ?c | Signal_2

rule Signal_2 = peek(Reading, -1)
              | peek(Reading, -2)
              | fold(+, Reading)
              | fold(*, Reading)
              | fold(min, Reading)
              | fold(max, Reading)
              | Signal_2 + Real_2
              | Signal_2 - Real_2
              | Real_2 - Signal_2
              | Signal_2 * Real_2
              | Signal_2 / Real_2
              | Real_2 / Signal_2
              | if Condition then Real_2 else Real_2
              | min(Signal_2, Real_2)
              | max(Signal_2, Real_2)
              | abs(Signal_2)
              | sqrt(Signal_2)
              | exp(Signal_2)
              | tanh(Signal_2)
              | sign(Signal_2)

rule Condition = previous(Gear) == 1
               | previous(Gear) == 2
               | previous(Gear) == 3
               | Signal_2 > Real_2
               | Signal_2 < Real_2
               | Condition and Condition
               | Condition or Condition

rule Reading = S | T

property Real = Steer < limit

property still over 3 = let Signal = 2 in fold(min, Steer) < Signal
"""


def grammar_of(text: str) -> tuple[SourceText, Sketch]:
    source = SourceText("two.pirl", text)
    made = without_sketch(source, check(source)[0])
    sketch, warnings = check(made)
    assert not warnings
    assert format_source(made) == made.text
    return made, sketch


def shortest(sketch: Sketch, largest: int) -> list[ProgramTemplate]:
    found = Enumeration(sketch).shortest_first(largest)
    return [expand(sketch, derivations).template for derivations in found]


def test_the_languages_own_grammar() -> None:
    made, sketch = grammar_of(TWO)
    assert made.text == GRAMMAR
    given = check(SourceText("two.pirl", TWO))[0]
    assert sketch.interface == given.interface
    assert sketch.properties == given.properties
    assert made.name == "two.pirl (without its rules)"


def test_its_programs() -> None:
    _, sketch = grammar_of(TWO)
    count = 0
    for template in shortest(sketch, 6):
        count += 1
        for body in template.bodies:
            for sub in subterms(body):
                if isinstance(sub, Apply) and sub.arguments:
                    below = [s for a in sub.arguments for s in subterms(a)]
                    assert any(isinstance(s, SensorRef | PreviousAction) for s in below)
    assert count > 40


def test_previous_of_a_real_action_is_read_where_the_sketch_reads_it() -> None:
    text = """policy p
        sensor S : [-1, 1] = 0
        action A : [0, 1] = R
        action B : [0, 1] = 0.5
        rule R = previous(A) + ?k * peek(S, -1)
    """
    made, sketch = grammar_of(text)
    assert "| previous(A)\n" in made.text and "previous(B)" not in made.text
    assert "fold" not in made.text and "peek(Reading, -2)" not in made.text
    # `safe` as it would be without being written.
    assert [spec.safe for spec in sketch.interface.actions] == [0.0, 0.0]


@pytest.mark.parametrize(
    ("action", "rules"),
    [
        ("A : [-1, 1] = 0.5", "rule Real = ?c"),
        ("A : {0, 2} = 2", "rule Value = 0 | 2"),
    ],
)
def test_without_anything_to_read(action: str, rules: str) -> None:
    made, sketch = grammar_of(f"policy p\naction {action}\n")
    assert made.text.rstrip().endswith(rules)
    discrete = isinstance(sketch.interface.actions[0].domain, Choice)
    assert len(shortest(sketch, 12)) == (2 if discrete else 1)


def test_every_action_has_its_own_values() -> None:
    text = """policy p
        sensor S : [-1, 1] = 0
        action A : {0, 1} = if peek(S, -1) > 0 then 1 else 0
        action B : {0, 1} = if peek(S, -1) > 0 then previous(B) else 0
    """
    made, _ = grammar_of(text)
    assert "action A : {0, 1} = Value\n" in made.text
    assert "action B : {0, 1} = Value_2\n" in made.text
    value = "rule Value = 0\n           | 1\n           | if Condition then Value else Value\n"
    assert value in made.text


def test_parameters_of_the_grammar_have_the_default_bounds() -> None:
    _, sketch = grammar_of("policy p\nsensor S : [-1, 1] = 0\naction A : [0, 1] = 1\n")
    for template in shortest(sketch, 6):
        assert all((p.lower, p.upper, p.guess) == (-100, 100, None) for p in template.free)
        names = {
            s.name for b in template.bodies for s in subterms(b) if isinstance(s, ParameterRef)
        }
        assert names == {p.name for p in template.free}


# NoIF.

LAW = """policy p
sensor S : [-1, 1] = 0
action A : [-1, 1] = Law
rule Law = ?k * peek(S, -1) | if Guard then Law else Law
rule Guard = peek(S, -1) > ?c
"""


def test_no_if_is_text_as_well() -> None:
    source = SourceText("p.pirl", LAW)
    made, remarks = without_if(source, check(source)[0])
    assert made.text == (
        "# The programs of p that have no `if`: what `--no-if` searches.\n\n"
        "policy p\n\nsensor S : [-1, 1] = 0\nwindow 1\n\naction A : [-1, 1] = Law\n\n"
        "rule Law = ?k * peek(S, -1)\n"
    )
    assert made.name == "p.pirl (without `if`)"
    assert remarks == ()
    again, remarks = without_if(made, check(made)[0])
    assert again.text == made.text
    assert [render(remark) for remark in remarks] == [
        "warning[E0436]: the sketch has no `if`: `--no-if` leaves nothing out"
    ]


REFUSED = [
    (
        "action A : {0, 1} = Law\nrule Law = if peek(S, -1) > ?c then 1 else 0",
        "error[E0435]: without `if` no program is left for the action `A`\n"
        " --> p.pirl:3:21\n"
        "  |\n"
        "3 | action A : {0, 1} = Law\n"
        "  |                     ^^^ every program that this allows has an `if`\n"
        "  |\n"
        "  = help: add an alternative without `if`, or leave out `--no-if`",
    ),
    (
        "action A : [0, 1] = 1 - (if peek(S, -1) > ?c then 1 else 0)",
        "error[E0435]: without `if` no program is left for the action `A`\n"
        " --> p.pirl:3:26\n"
        "  |\n"
        "3 | action A : [0, 1] = 1 - (if peek(S, -1) > ?c then 1 else 0)\n"
        "  |                          ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^ this `if` is part of every "
        "program\n"
        "  |\n"
        "  = help: add an alternative without `if`, or leave out `--no-if`",
    ),
]


@pytest.mark.parametrize(("text", "message"), REFUSED)
def test_nothing_left_without_if(text: str, message: str) -> None:
    source = SourceText("p.pirl", f"policy p\nsensor S : [-1, 1] = 0\n{text}\n")
    with pytest.raises(PirlcError) as caught:
        without_if(source, check(source)[0])
    assert [render(found) for found in caught.value.diagnostics] == [message]


def test_all_actions_without_a_program_are_told() -> None:
    text = "policy p\naction A : {0, 1} = if 1 > 2 then 0 else 1\naction B : [0, 1] = 1\n"
    source = SourceText("p.pirl", text + "action C : [0, 1] = if 1 > 2 then 0 else 1\n")
    with pytest.raises(PirlcError) as caught:
        without_if(source, check(source)[0])
    messages = [found.message for found in caught.value.diagnostics]
    assert [message[-3:] for message in messages] == ["`A`", "`C`"]


@pytest.mark.parametrize("code", ["E0435", "E0436"])
def test_the_codes_have_pages(code: str) -> None:
    text = (resources.explanations() / f"{code}.md").read_text(encoding="utf-8")
    assert text.startswith(f"# {code}: ") and "## What to do\n" in text


def test_the_page_of_e0435_shows_what_it_says() -> None:
    text = (resources.explanations() / "E0435.md").read_text(encoding="utf-8")
    wrong, right = (
        SourceText("example", part.split("```")[0]) for part in text.split("```pirl\n")[1:]
    )
    with pytest.raises(PirlcError):
        without_if(wrong, check(wrong)[0])
    assert without_if(right, check(right)[0])[1] == ()
