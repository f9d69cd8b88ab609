"""`pirlc verify`: what it prints, its exit codes, its JSON, and that its page tells the truth."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys

import pytest

from tests.support.command_line import POLE, ROOT, SKETCH

TEXT = (ROOT / "docs" / "verification.md").read_text(encoding="utf-8")

PROGRAM = """policy example

sensor Angle : [-0.2, 0.2] = 0
sensor Other : [0, 1]      = 1
window 2

action Push : [-1, 1] = 6 * peek(Angle, -1) + peek(Angle, -2)
action Pull : [0, 1]  = peek(Other, -1)

property gentle = raw(Push) < 1.4
property clipped = Push <= 1 and Pull <= 1
"""

STATUS = """gentle   refuted
           binary64: refuted
           binary32: refuted
clipped  proved
           binary64: proved
           binary32: proved
           warm-up: proved (a window of one reading over again, or of the middle of the range, is"""

SHOWN = """
error[E0901]: the property gentle does not hold
  --> example.pirl:10:19
   |
10 | property gentle = raw(Push) < 1.4
   |                   ^^^^^^^^^^^^^^^ false on the history below

      Angle           raw(Push)  Push
  -2    0.2
  -1    0.2  1.4000000208616257     1
"""


@pytest.fixture
def verify(pirlc, here):
    def run(text: str, *options: str):
        (here / "example.pirl").write_text(text, encoding="utf-8")
        return pirlc("verify", "example.pirl", *options)

    return run


def test_a_refuted_property_is_shown_where_it_stands(verify):
    outcome = verify(PROGRAM)
    assert (outcome.code, outcome.err) == (1, "")
    assert outcome.out.startswith(STATUS)
    assert SHOWN in outcome.out


def test_all_proved(verify):
    outcome = verify(PROGRAM.replace("1.4", "1.5"))
    assert (outcome.code, outcome.err) == (0, "")
    assert "E0901" not in outcome.out


def test_undecided_is_two(verify):
    text = PROGRAM.replace("= peek(Other, -1)", "safe 0 = 1 / (peek(Other, -1) - peek(Other, -1))")
    outcome = verify(
        text.replace("Push <= 1 and Pull <= 1", "raw(Pull) != 3").replace("1.4", "1.5")
    )
    assert (outcome.code, outcome.err) == (2, "")
    assert (
        "warning[E0902]: the property clipped is neither proved nor refuted\n"
        "  --> example.pirl:11:10\n"
    ) in outcome.out


def test_no_properties_is_said_kindly(verify):
    outcome = verify(PROGRAM.split("property")[0])
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out.startswith("example has no properties; `property NAME = ...` states one\n")


def test_a_sketch_is_refused_with_what_it_leaves_open(verify):
    outcome = verify(SKETCH)
    assert (outcome.code, outcome.out) == (1, "")
    assert "error[E0704]: this is a sketch" in outcome.err


def test_json_has_everything(verify):
    outcome = verify(PROGRAM, "--bounds", "--json")
    assert outcome.code == 1
    data = outcome.data
    assert outcome.codes == ["E0901"]
    assert (data["exit_code"], data["program"]) == (1, "example")
    gentle, clipped = data["properties"]
    assert gentle["evidence"] == {"kind": "refuted", "words": "refuted", "cases": 0}
    history = gentle["counterexample"]["history"]
    assert len(history["readings"]["Angle"]) == 2
    assert abs(gentle["counterexample"]["steps"][0]["raw"]["Push"]) >= 1.4
    (tight,) = gentle["tightest"]
    assert tight["extreme"]["attained"]
    assert tight["extreme"]["value"]["decimal"] == pytest.approx(1.4, abs=1e-7)
    assert clipped["evidence"]["kind"] == "proved"
    assert clipped["counterexample"] is None


def test_tightest_values_are_printed_with_the_bounds(verify):
    out = verify(PROGRAM, "--bounds").out
    assert "           raw(Push) goes up to 1.40000002086, attained\n" in out


def test_a_time_limit_is_a_number_above_zero(verify):
    assert verify(PROGRAM.replace("1.4", "1.5"), "--timeout", "20").code == 0
    assert verify(PROGRAM, "--timeout", "0").code == 2


def test_discrete_programs_show_their_actions(verify):
    text = POLE + "\nproperty right = Push == 1\n"
    outcome = verify(text)
    assert outcome.code == 1
    assert re.search(r"\n      Angle  AngularVelocity  Push\n  -1 .* 0\n", outcome.out)


def test_previous_actions_are_told_before_the_history(verify):
    text = PROGRAM.split("property")[0].replace("= peek(Other, -1)", "= 0.5 * previous(Pull)")
    outcome = verify(text + "property low over 2 = peek(Pull, -2) < 0.25\n")
    assert outcome.code == 1
    assert re.search(r"\n  before: Pull [\d.]+\n +raw\(Pull\) +Pull\n  -3\n  -2 ", outcome.out)


# docs/verification.md says what happens.


def _examples() -> list[tuple[str, list[str]]]:
    found: list[tuple[str, list[str]]] = []
    for block in re.findall(r"```console\n(.*?)```", TEXT, re.DOTALL):
        for line in block.splitlines():
            if line.startswith("$ "):
                found.append((line.removeprefix("$ "), []))
            else:
                found[-1][1].append(line)
    return found


def test_commands_print_what_is_shown(pirlc, here):
    (here / "examples").symlink_to(ROOT / "examples")
    assert len(_examples()) >= 2
    for command, shown in _examples():
        words = shlex.split(command)
        assert words[0] == "pirlc"
        outcome = pirlc(*words[1:])
        assert outcome.err == "", command
        pattern = "".join(
            r"(?:.*\n)*?" if line == "..." else re.escape(line) + r"\n" for line in shown
        )
        assert re.fullmatch(pattern, outcome.out), f"{command} printed\n{outcome.out}"


def test_progress_is_shown_on_a_terminal_alone(pirlc):
    program = ROOT / "examples" / "cartpole" / "cartpole-0.pirl"
    assert pirlc("verify", program).err == ""
    ours, theirs = os.openpty()
    command = [sys.executable, "-m", "pirlc", "verify", program, "--bounds", "--emitted"]
    environment = {**os.environ, "TERM": "xterm"}
    done = subprocess.run(
        command, stdout=subprocess.PIPE, stderr=theirs, check=True, env=environment, cwd=ROOT
    )
    os.close(theirs)
    assert b"comparing the emitted C" in os.read(ours, 65536)  # The last stage is always shown.
    os.close(ours)
    assert b"comparing" not in done.stdout
