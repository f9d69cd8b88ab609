"""`pirlc verify --bounds`, and the remarks and guards that it tells in any case."""

from __future__ import annotations

import re
from fractions import Fraction

from tests.support.command_line import ROOT

PROGRAM = """policy p

sensor x : [-1, 1] = 0
sensor y : [0, 2]  = 1

param idle = 3

action A : [-2, 2] safe 0 = if 0.1 * peek(x, -1) > 0.05 then 3 * peek(x, -1)
                            else if peek(y, -1) < 0 then 7 else 1 / peek(y, -1)
action B : [0, 1] = if peek(x, -1) < 0.5 then peek(x, -1) else 0
action C : {0, 1, 2} = if peek(x, -1) >= 0 then 1 else 0
"""


def test_a_table_of_bounds(pirlc, here):
    (here / "p.pirl").write_text(PROGRAM)
    outcome = pirlc("verify", "p.pirl", "--bounds")
    assert outcome.code == 0
    table = outcome.out.split("bounds\n")[1].split("\n\n")[0].splitlines()
    rows = {re.split(r"  +", line.strip())[0]: line for line in table}
    assert re.search(r" -1 +attained$", rows["raw(B) least"])
    assert re.search(r" 0\.5 +not attained", rows["raw(B) most"])
    assert re.search(r" 1\.5 +not attained", rows["raw(B) change in a step"])
    assert re.search(r" 2 +attained$", rows["A most"])
    assert "unknown" in rows["raw(A) most"]
    assert "a division by zero" in rows["raw(A) most"]
    assert "no bound" in rows["raw(A) in binary64"]
    assert "exact beside guards" in rows["raw(B) in binary32"]
    assert re.search(r" 0, 1 +never 2$", rows["C"])
    assert "; elsewhere it is 0.5" in rows["raw(A) least"]


def test_remarks_and_guards_are_told_with_their_places(pirlc, here):
    (here / "p.pirl").write_text(PROGRAM)
    outcome = pirlc("verify", "p.pirl")
    lines = outcome.out.splitlines()
    for line in (
        "  9:58   `7` is never reached: `peek(y, -1) < 0` never holds (proved)",
        "  6:7    idle has no effect on any action (proved)",
        "  9:65   `peek(y, -1)` can be zero (refuted)",
    ):
        place, _, words = line.strip().partition(" ")
        assert any(re.match(rf" +{place} +{re.escape(words.strip())}", found) for found in lines), (
            line
        )
    assert "bounds" not in lines
    at = next(i for i, line in enumerate(lines) if line.startswith("guards that rounding turns"))
    assert lines[at + 1].split() == ["binary64", "binary32"]
    place, double, single, text = lines[at + 2].split(maxsplit=3)
    assert place == "8:32"
    assert text == "0.1 * peek(x, -1) > 0.05"
    assert 0 < float(double) < 1e-15 < float(single) < 1e-7


def test_everything_is_in_the_json(pirlc, here):
    (here / "p.pirl").write_text(PROGRAM)
    data = pirlc("verify", "p.pirl", "--bounds", "--json").data
    b = data["bounds"][1]
    assert b["action"] == "B"
    assert b["raw_upper"]["value"] == {"exact": "1/2", "decimal": 0.5}
    assert b["raw_upper"]["attained"] is False
    (step,) = b["raw_upper"]["witness"]["steps"]
    assert 0.5 - 1e-9 < step["raw"]["B"] < 0.5
    assert (b["rounding64"], b["rounding32"]) == (0.0, 0.0)
    matters = {remark["matter"] for remark in data["remarks"]}
    assert "branch that no history reaches" in matters
    dead = next(r for r in data["remarks"] if r["matter"] == "branch that no history reaches")
    assert (dead["line"], dead["column"], dead["clear"]) == (9, 58, False)
    (guard,) = (g for g in data["guards"] if g["margin64"])
    assert guard["line"] == 8
    jump = next(r for r in data["remarks"] if r["text"].startswith("raw(B) jumps"))
    assert Fraction(jump["size"]["value"]["exact"]) == Fraction(1, 2)
    assert pirlc("verify", "p.pirl", "--json").data["bounds"] == []


def test_the_documents_say_what_is_printed(pirlc, here):
    """The blocks of docs/verification.md under Bounds and Rounding."""
    (here / "examples").symlink_to(ROOT / "examples")
    text = (ROOT / "docs" / "verification.md").read_text(encoding="utf-8")
    shown = 0
    for block in re.findall(r"```console\n(.*?)```", text.split("\n## Bounds\n")[1], re.DOTALL):
        command, *lines = block.splitlines()
        printed = pirlc(*command.removeprefix("$ pirlc ").split()).out.splitlines()
        for line in lines:
            if line != "...":
                assert line in printed
                shown += 1
    assert shown >= 7
