"""`pirlc explain-program`, and docs/reading.md, whose commands are run and compared."""

from __future__ import annotations

import json
import re
import shlex
import shutil

import pytest

from tests.support.command_line import ROOT

TEXT = (ROOT / "docs" / "reading.md").read_text(encoding="utf-8")

WORDS = """pole
  14 nodes, for "CartPole-v1"
  0.02 s a step, no latency
  how it settles is told for the plant CartPole-v1 (upright), linearised

sensors
    sensor           range          readings used  decides in  part of  missing
    Angle            [-0.21, 0.21]  the newest     Push        -        held
    AngularVelocity  [-3.5, 3.5]    the newest     Push        -        held
  warm-up: a sensor's first good reading fills its window (changes start at 0); before it readings
    are the middle of the range

Push one of {0, 1}
    value  that is     when
        1  push right  3 Angle + AngularVelocity > 0
        0  push left   otherwise
    boundary                       that is
    3 Angle + AngularVelocity > 0  AngularVelocity > -3 Angle
"""


def _examples() -> list[tuple[str, list[str]]]:
    """Each command after a `$`, with the lines of output that are shown below it."""
    found: list[tuple[str, list[str]]] = []
    for block in re.findall(r"```console\n(.*?)```", TEXT, re.DOTALL):
        for line in block.splitlines():
            if line.startswith("$ "):
                found.append((line.removeprefix("$ "), []))
            else:
                found[-1][1].append(line)
    return found


@pytest.mark.skipif(not shutil.which("cc"), reason="one of the commands compiles C")
def test_commands_print_what_is_shown(pirlc, here):
    (here / "examples").symlink_to(ROOT / "examples")
    (sketch,) = re.findall(r"```pirl\n(.*?)```", TEXT, re.DOTALL)
    (here / "stand.pirl").write_text(sketch)
    examples = _examples()
    assert len(examples) == 5
    for command, shown in examples:
        words = shlex.split(command)
        assert words[0] == "pirlc"
        outcome = pirlc(*words[1:])
        assert (outcome.code, outcome.err) == (0, ""), command
        pattern = "".join(
            r"(?:.*\n)*?" if line == "..." else re.escape(line) + r"\n" for line in shown
        )
        assert re.fullmatch(pattern, outcome.out), f"{command} printed\n{outcome.out}"


def test_a_program_in_words(pirlc):
    outcome = pirlc("explain-program", "pole.pirl")
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out.startswith(WORDS)


def test_without_a_plant(pirlc):
    outcome = pirlc("explain-program", "pole.pirl", "--plant", "none")
    assert (
        outcome.out
        == "\n".join(line for line in WORDS.splitlines() if "settles" not in line) + "\n"
    )


def test_shares_of_branches(pirlc):
    found = pirlc("explain-program", "pole.pirl", "--episodes", "2", "--json").data["reading"]
    assert found["simulated"]["episodes"] == 2 and found["simulated"]["first_seed"] == 1_000_000
    (push,) = found["actions"]
    assert sum(branch["taken"] for branch in push["branches"]) == pytest.approx(1.0)
    assert all(0.3 < branch["taken"] < 0.7 for branch in push["branches"])
    assert 0 < push["switches"] <= 50
    again = pirlc("explain-program", "pole.pirl", "--episodes", "2", "--json").data["reading"]
    assert again == found


def test_the_shape_of_the_data(pirlc):
    found = pirlc("explain-program", str(ROOT / "examples/pendulum/pendulum-0.pirl"), "--json")
    reading = found.data["reading"]
    assert set(reading) == {
        "program", "environment", "size", "window", "needed", "latency", "sample_time", "warm_up",
        "sensors", "actions", "plant", "simulated", "notes",
    }  # fmt: skip
    (torque,) = reading["actions"]
    first = torque["branches"][0]
    assert first["when"] == ["Height > 0.7 or Height + 0.27 |Speed| > 1.1"]
    assert first["law"]["kind"] == "linear in several sensors"
    assert [(g["sensor"], g["weights"]) for g in first["law"]["gains"]] == [
        ("Side", [-24.0]), ("Speed", [-5.0])
    ]  # fmt: skip
    assert first["settling"]["stable"] is True
    json.dumps(reading, allow_nan=False)


def test_a_plant_from_a_file(pirlc, here):
    (here / "law.pirl").write_text(
        "policy law\nsensor X : [-1, 1] = 0\nsample_time 0.1\n"
        "action A : [-1, 1] = 0.5 * (0.2 - peek(X, -1))\n"
    )
    (here / "plant.toml").write_text(
        'sample_time = 0.1\na = [[0.8]]\nb = [[0.5]]\nc = [[1.0]]\ninputs = ["A"]\n'
        'outputs = ["X"]\nstates = ["x"]\n'
    )
    outcome = pirlc("explain-program", "law.pirl", "--plant", "plant.toml", "--json")
    assert outcome.code == 0, outcome.out
    (action,) = outcome.data["reading"]["actions"]
    settling = action["branches"][0]["settling"]
    assert settling["stable"] is True
    assert settling["slowest_pole"] == pytest.approx(0.8 - 0.5 * 0.5)


def test_what_is_refused(pirlc, here):
    assert pirlc("explain-program", "sketch.pirl", "--json").codes == ["E0704"]
    assert pirlc("explain-program", "nowhere.pirl", "--json").codes == ["E0701"]
    (here / "bare.pirl").write_text(
        "policy bare\nsensor X : [-1, 1] = 0\naction A : [-1, 1] = peek(X, -1)\n"
    )
    assert pirlc("explain-program", "bare.pirl", "--json").codes == []
    assert pirlc("explain-program", "bare.pirl", "--episodes", "1", "--json").codes == ["E0513"]
