"""`pirlc synth` from end to end, on an environment whose episodes are short."""

from __future__ import annotations

import json
import re
import resource
import signal
import time

import pytest

from tests.support.command_line import ROOT
from tests.support.point import EXPERT, GUIDED, SKETCH, SYNTH
from tests.support.processes import started


def test_everything_asked_for_is_in_the_folder(pirlc, point):
    outcome = pirlc(*SYNTH, *EXPERT, "-o", "run")
    assert outcome.code == 0
    assert outcome.out.startswith("a program of ")
    assert "return over 20 unseen episodes\n  program " in outcome.out
    made = {p.relative_to(point / "run").as_posix() for p in (point / "run").rglob("*.*")}
    assert made >= {
        "manifest.json", "sketch.pirl", "journal.jsonl", "candidates.jsonl", "search.png",
        "point.pirl", "c/point.c", "c/point.h", "python/point.py",
    }  # fmt: skip
    # What it leaves is a program, and reaches what was said.
    returns = json.loads((point / "run" / "manifest.json").read_text())["evaluation"]["returns"]
    assert set(returns) == {"program", "emitted C", "oracle", "without refinement"}
    run = ("rollout", "run/point.pirl", "--trust", "--episodes", "20", "--json")
    assert pirlc(*run).data["return"]["mean"] == returns["program"]["mean"]
    assert returns["emitted C"] == returns["program"]
    assert returns["program"]["mean"] > -4
    # The same command finds everything done, and says the same again.
    began = time.monotonic()
    again = pirlc(*SYNTH, *EXPERT, "-o", "run", "--json")
    assert time.monotonic() - began < 10
    assert again.data["program"].splitlines()[-1] in outcome.out
    assert again.data["returns"] == {
        name: {key: found[key] for key in ("mean", "low", "high", "std", "episodes")}
        for name, found in returns.items()
    }
    # Another one may not.
    assert pirlc(*SYNTH, *EXPERT, "-o", "run", "--seed", "3", "--json").codes == ["E0723"]


def test_without_oracle_and_refinement(pirlc, point):
    outcome = pirlc(*SYNTH, "--no-oracle", "--no-refine", "-o", "run", "--json")
    assert outcome.code == 0
    assert set(outcome.data["returns"]) == {"program", "emitted C"}
    assert outcome.data["ending"] == "finished"


def test_what_is_refused_before_anything_is_written(pirlc, point):
    wrong = {
        "E0502": ("synth", "point.pirl", "-o", "run"),
        "E0601": (*SYNTH, "--oracle", "nowhere", "-o", "run"),
        "E0701": ("synth", "nowhere.pirl", "-o", "run"),
        "E0712": (*SYNTH, *EXPERT, "-o", "point.pirl"),
    }
    for code, arguments in wrong.items():
        assert pirlc(*arguments, "--json").codes == [code]
    (point / "other.pirl").write_text(SKETCH.replace("= 1\n", "= 2\n"))
    other = ("synth", "other.pirl", "--trust", *EXPERT, "-o", "run", "--json")
    assert pirlc(*other).codes == ["E0507"]
    (point / "full").mkdir()
    (point / "full" / "mine.txt").write_text("of another kind")
    assert pirlc(*SYNTH, *EXPERT, "-o", "full", "--json").codes == ["E0722"]


@pytest.mark.parametrize(("fault", "code"), [("raises", "E0514"), ("nan", "E0515")])
@pytest.mark.parametrize("workers", ["1", "2"])
def test_a_simulator_that_fails(pirlc, point, fault, code, workers):
    named = '"point_environment:Point-v0"'
    (point / "point.pirl").write_text(SKETCH.replace(named, f'{named} {{ fault = "{fault}" }}'))
    outcome = pirlc(*SYNTH[:-1], workers, *EXPERT, "-o", "run", "--json")
    assert (outcome.code, outcome.codes) == (1, [code])


def test_a_disk_that_fills_up_loses_nothing(pirlc, process, point):
    def little_room() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (6_000, 6_000))

    command = (*SYNTH, *EXPERT, "-o", "run", "--json")
    full = process(*command, preexec_fn=little_room)
    assert full.code == 1
    assert full.codes in (["E0705"], ["E0711"])
    assert "file too large" in full.data["diagnostics"][0]["message"]
    assert pirlc(*command).data["ending"] == "finished"


@pytest.mark.parametrize(
    "options", [("--no-oracle", "--oracle", "x"), ("--no-oracle", "--oracle-steps", "5")]
)
def test_options_that_contradict_each_other(pirlc, point, options):
    assert pirlc(*SYNTH, *options, "-o", "run").code == 2
    assert not (point / "run").exists()


def test_interrupted_and_resumed(pirlc, point):
    command = [*SYNTH, *EXPERT, "-o", "run", "--json"]
    candidates = point / "run" / "candidates.jsonl"
    with started("-m", "pirlc", *command) as running:
        deadline = time.monotonic() + 60
        # From the first candidate that was simulated on, there is something to lose.
        while time.monotonic() < deadline and running.poll() is None:
            if candidates.is_file() and '"episodes": 100' in candidates.read_text():
                break
            time.sleep(0.02)
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=60)
    assert (running.returncode, err) == (130, "")
    assert json.loads(out)["interrupted"] is True
    assert pirlc("check", "run/point.pirl", "--json").data["closed"] is True
    assert pirlc(*command).data["ending"] == "finished"


# The optimiser.


def test_the_optimiser_that_was_chosen_is_told(pirlc, point):
    auto = (*SYNTH, *GUIDED, "--trials", "10", "--no-refine", "-o", "run")
    outcome = pirlc(*auto)
    assert outcome.code == 0
    noted = json.loads((point / "run" / "manifest.json").read_text())["optimizer"]
    means = noted["mean_distances"]
    assert set(means) == set(noted["seconds"]) == {"casadi", "smt", "bayes"}
    shown = ", ".join(f"{name} {mean:.4f}" for name, mean in means.items())
    assert outcome.err.splitlines()[-1] == (
        f"optimizer: {noted['chosen']}, {noted['why']} (mean distance over 2 templates: {shown})"
    )
    assert [found["parameters"] for found in noted["templates"]] == [1, 2]
    assert means[noted["chosen"]] <= min(means.values()) + 0.05
    # Nothing is measured again.
    assert pirlc(*auto, "--json").data["optimizer"] == {**noted, "seconds": {}}


def test_the_optimiser_that_is_asked_for_is_used(pirlc, point):
    asked = (*SYNTH, *GUIDED, "--optimizer", "bayes", "--trials", "12", "--no-refine", "-o", "run")
    outcome = pirlc(*asked, "--json")
    assert outcome.code == 0
    assert outcome.data["optimizer"] == {
        "chosen": "bayes",
        "why": "asked for",
        "mean_distances": {},
        "templates": [],
        "seconds": {},
    }
    manifest = json.loads((point / "run" / "manifest.json").read_text())
    assert manifest["optimizer"] == outcome.data["optimizer"]
    assert manifest["asked"]["settings"]["optimizer"] == "bayes"
    assert manifest["asked"]["settings"]["tuning"]["trials"] == 12
    assert outcome.data["returns"]["program"]["mean"] > -6
    # Other budgets are another run.
    assert pirlc(*(word.replace("12", "13") for word in asked), "--json").codes == ["E0723"]


def test_an_optimiser_that_cannot_take_the_sketch_is_refused_at_once(pirlc, point):
    terms = " + ".join(f"?k{i} * peek(Place, -{i + 1})" for i in range(31))
    text = f"""policy point
environment "point_environment:Point-v0"
sensor Place : [-2, 2] = 0
window 31
action Push : [-1, 1] safe 0 = {terms}
"""
    (point / "point.pirl").write_text(text)
    size = ("--max-size", "400")
    outcome = pirlc(*SYNTH, *GUIDED, *size, "--optimizer", "bayes", "-o", "run")
    assert outcome.code == 1
    assert outcome.err == (
        "error[E0430]: `bayes` can take none of the sketch's 1 shortest templates\n"
        "  = note: 1 with more than 30 parameters\n"
        "  = help: `--optimizer casadi` takes every template; `--optimizer auto` takes the best "
        "that can\n\n"
    )
    assert not (point / "run").exists()


def test_an_optimiser_makes_no_sense_without_an_oracle(pirlc, point):
    options = ("--trials", "--tune-seconds", "--effort", "--tolerance")
    for option in (("--optimizer", "bayes"), *((name, "1") for name in options)):
        outcome = pirlc(*SYNTH, "--no-oracle", *option, "-o", "run")
        assert outcome.code == 2
        assert "make no sense with --no-oracle" in outcome.err.replace("\n", " ")


def test_the_command_of_the_documentation_says_what_is_done(pirlc, point):
    text = (ROOT / "docs" / "search.md").read_text(encoding="utf-8")
    section = text.split("## Tuning a template\n")[1].split("\n## ")[0]
    ((command, sketch, options),) = re.findall(r"(pirlc synth) (\S+) (.*) -o runs/bayes", section)
    assert command and (ROOT / sketch).is_file()
    small = ("--trials", "10", "--pool", "2", "--no-refine", "--json")
    outcome = pirlc(*SYNTH, *GUIDED, *options.split(), *small, "-o", "runs/bayes")
    assert outcome.code == 0
    assert outcome.data["optimizer"]["chosen"] == "bayes"
