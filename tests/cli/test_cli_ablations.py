"""The paper's ablations, and timeouts, from end to end."""

from __future__ import annotations

import json
import re
import shlex

import pytest

from pirlc import resources
from pirlc.diagnostics import render
from pirlc.report.problems import NothingFound, describe
from tests.support.command_line import ROOT
from tests.support.point import EXPERT, SKETCH, SYNTH

SWITCHED = SKETCH.replace("rule Term(x)", "rule Guard = Term(Speed) > ?c\n\nrule Term(x)").replace(
    "| Term(Place) + Term(Speed)", "| if Guard then Law else Law"
)

QUICK = (*SYNTH, "--pool", "6", "--no-refine")
IMITATE = (*EXPERT, "--optimizer", "casadi")


def manifest_in(folder) -> dict:
    return json.loads((folder / "run" / "manifest.json").read_text())


def test_no_sketch(pirlc, point):
    command = (*QUICK, *IMITATE, "--no-sketch", "-o", "run", "--json")
    outcome = pirlc(*command)
    assert (outcome.code, outcome.data["ending"]) == (0, "finished")
    assert outcome.data["left_out"] == ["--no-sketch", "--no-refine"]
    run = point / "run"
    assert (run / "sketch.given.pirl").read_text() == SKETCH
    searched = (run / "sketch.pirl").read_text()
    assert searched.startswith("# The language's own grammar over the sensors of point")
    assert "rule Reading = Place | Speed\n" in searched
    asked = manifest_in(point)["asked"]
    assert asked["plan"] == {"augment": True, "refine": False, "sketch": False, "branches": True}
    text = (run / "point.pirl").read_text()
    assert "# With --no-sketch --no-refine.\n" in text
    assert "Term" not in text
    page = json.loads((run / "report.json").read_text())
    assert page["head"]["left_out"] == ["--no-sketch", "--no-refine"]
    assert page["sketch"] == searched
    assert page["program"]["text"] == manifest_in(point)["program"]["text"]
    # It is resumed, and the folder is of this search alone.
    assert pirlc(*command).data["program"] == outcome.data["program"]
    without = [word for word in command if word != "--no-sketch"]
    assert pirlc(*without).codes == ["E0723"]
    # What was searched is a sketch like any other.
    assert pirlc("fmt", "--check", "run/sketch.pirl").code == 0
    same = (*QUICK[:1], "run/sketch.pirl", *QUICK[2:], *IMITATE, "-o", "again", "--json")
    assert pirlc(*same).data["program"] == outcome.data["program"]


def test_no_if(pirlc, point):
    (point / "point.pirl").write_text(SWITCHED)
    outcome = pirlc(*QUICK, *IMITATE, "--no-if", "-o", "run", "--json")
    assert (outcome.code, outcome.codes) == (0, [])
    assert outcome.data["left_out"] == ["--no-if", "--no-refine"]
    assert (point / "run" / "sketch.given.pirl").read_text() == SWITCHED
    searched = (point / "run" / "sketch.pirl").read_text()
    assert "rule Law = Term(Place)\n" in searched and "Guard" not in searched
    plain = SKETCH.replace("         | Term(Place) + Term(Speed)\n", "")
    (point / "point.pirl").write_text(plain)
    same = pirlc(*QUICK, *IMITATE, "-o", "plain", "--json").data
    assert same["program"] == outcome.data["program"]
    assert same["left_out"] == ["--no-refine"]
    assert not (point / "plain" / "sketch.given.pirl").exists()
    warned = pirlc(*QUICK, *IMITATE, "--no-if", "-o", "warned", "--json")
    assert (warned.code, warned.codes) == (0, ["E0436"])
    assert warned.data["program"] == same["program"]


def test_no_if_where_nothing_is_left(pirlc, here):
    sketch = str(ROOT / "examples" / "cartpole.pirl")
    outcome = pirlc("synth", sketch, "--no-if", "-o", "run")
    assert outcome.code == 1
    assert outcome.err.startswith(
        "error[E0435]: without `if` no program is left for the action `Push`\n"
    )
    assert not (here / "run").exists()


def test_all_ablations_that_go_together(pirlc, point):
    options = ("--no-oracle", "--no-sketch", "--no-if", "--no-refine")
    outcome = pirlc(*SYNTH, "--pool", "2", *options, "-o", "run", "--budget", "40", "--json")
    assert outcome.code == 0
    assert outcome.data["left_out"] == list(options)
    assert "rule Condition" not in (point / "run" / "sketch.pirl").read_text()
    assert "by return alone" in (point / "run" / "point.pirl").read_text()


def test_those_that_do_not(pirlc, point):
    outcome = pirlc(*SYNTH, "--no-oracle", "--no-augment", "-o", "run")
    assert outcome.code == 2
    assert outcome.err.rstrip().endswith(
        "Error: --no-augment makes no sense with --no-oracle: nobody says what to do in new "
        "histories."
    )
    assert not (point / "run").exists()


# Timeouts.


@pytest.mark.parametrize(
    "search", [IMITATE, pytest.param(("--no-oracle",), marks=pytest.mark.slow)]
)
def test_a_timeout(pirlc, point, search):
    command = (*QUICK, *search, "-o", "run", "--json")
    outcome = pirlc(*command, "--time", "1e-9")
    assert (outcome.code, outcome.codes) == (3, ["E0725"])
    data = outcome.data
    assert (data["ending"], data["interrupted"]) == ("timeout", False)
    assert (data["program"], data["size"], data["returns"], data["files"]) == (None, None, {}, [])
    manifest = manifest_in(point)
    assert manifest["state"] == "timeout"
    assert manifest["calls_of_search"] == 0
    assert "program" not in manifest
    # There is a page of it, too.
    assert pirlc("report", "run").code == 0
    head = json.loads((point / "run" / "report.json").read_text())["head"]
    assert head["state_words"].startswith("The search used up its budget before it had any program")
    # With more time it goes on, and back again nothing is lost.
    finished = pirlc(*command)
    assert (finished.code, finished.data["ending"]) == (0, "finished")
    journal = (point / "run" / "journal.jsonl").read_bytes()
    assert pirlc(*command, "--time", "1e-9").code == 3
    assert (point / "run" / "journal.jsonl").read_bytes() == journal
    assert pirlc(*command).data["program"] == finished.data["program"]


def test_a_timeout_in_words(pirlc, point):
    outcome = pirlc(*QUICK, *IMITATE, "-o", "run", "--time", "1e-9")
    assert (outcome.code, outcome.out) == (3, "")
    assert outcome.err.endswith(
        "error[E0725]: timeout: the search used up its budget before it had any program\n"
        "  = help: the same command with a larger `--time` or `--budget` goes on from here\n\n"
    )


def test_interrupted_before_there_was_a_program():
    assert render(describe(NothingFound(interrupted=True))) == (
        "error[E0725]: interrupted before the search had any program\n"
        "  = help: the same command goes on from here"
    )
    page = resources.explanations() / "E0725.md"
    assert page.read_text(encoding="utf-8").startswith("# E0725: ")


# Documentation.


def test_the_commands_of_the_documentation(pirlc, here, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(here / "cache"))
    (here / "examples").mkdir()
    for name in ("pendulum", "torcs"):
        (here / "examples" / name).symlink_to(ROOT / "examples" / name)
    section = (ROOT / "docs" / "search.md").read_text(encoding="utf-8").split("## Ablations\n")[1]
    (block,) = re.findall(r"```sh\n(.*?)```", section, re.DOTALL)
    first, second = (shlex.split(line)[1:] for line in block.splitlines())
    # Without the training of an oracle, and without waiting for a result.
    assert pirlc(*first, "--no-oracle", "--budget", "1").code == 3
    assert pirlc(*second).code == 0
    options = re.findall(r"^\| `(--no-[a-z]+)` \|", section, re.MULTILINE)
    assert len(options) == 5
    shown = pirlc("synth", "--help").out
    assert all(option in shown for option in options)
