"""`pirlc fmt`, `explain`, `emit`, `rollout`, `oracle`, from end to end."""

from __future__ import annotations

import re
import shutil

import pytest

from pirlc.backend import c_expressions
from tests.support.command_line import POLE, ROOT
from tests.support.planted import plant

HAS_CC = any(shutil.which(name) for name in ("cc", "gcc", "clang"))

MESSY = POLE.replace("param k = 3", "param   k=3   # the gain")


def test_fmt_in_place(pirlc, here):
    messy = here / "messy.pirl"
    messy.write_text(MESSY)
    messy.chmod(0o640)
    assert pirlc("fmt", "--check", "messy.pirl").code == 1
    assert messy.read_text() == MESSY
    outcome = pirlc("fmt", "messy.pirl", "pole.pirl")
    assert (outcome.code, outcome.out) == (0, "formatted messy.pirl\n")
    assert "param k = 3  # the gain" in messy.read_text()
    assert messy.stat().st_mode & 0o777 == 0o640
    assert pirlc("fmt", "--check", "messy.pirl").code == 0
    assert pirlc("fmt", "messy.pirl").out == ""


def test_fmt_keeps_links_and_what_it_cannot_read(pirlc, here):
    (here / "messy.pirl").write_text(MESSY)
    (here / "link.pirl").symlink_to("messy.pirl")
    (here / "wrong.pirl").write_text("policy (")
    outcome = pirlc("fmt", "wrong.pirl", "link.pirl", "nowhere.pirl", "--json")
    assert outcome.code == 1
    assert outcome.codes[-1] == "E0701"
    assert outcome.data["files"] == [{"file": "link.pirl", "changed": True}]
    assert (here / "link.pirl").is_symlink()
    assert (here / "messy.pirl").read_text() != MESSY
    assert (here / "wrong.pirl").read_text() == "policy ("


def test_fmt_of_standard_input(process):
    formatted = process("fmt", "-", input=MESSY)
    assert formatted.code == 0
    again = process("fmt", "-", input=formatted.out)
    assert again.out == formatted.out
    assert process("fmt", "--check", "-", input=MESSY).code == 1


def test_explain(pirlc):
    assert pirlc("explain", "e0303").out.startswith("# E0303: ")
    assert pirlc("explain", "E0303", "--json").data["code"] == "E0303"


def test_emit_writes_the_same_files_each_time(pirlc, here):
    outcome = pirlc("emit", "pole.pirl", "-o", "a/b")
    assert outcome.code == 0
    *lines, compared = outcome.out.splitlines()
    names = [line.removeprefix("wrote a/b/") for line in lines]
    assert names == ["pole.h", "pole.c", "pole.py"]
    assert re.fullmatch(r"emitted C = program: proved \(\d+\.\d\d s\)", compared)
    pirlc("emit", "pole.pirl", "-o", "second")
    for name in names:
        assert (here / "a" / "b" / name).read_bytes() == (here / "second" / name).read_bytes()


def test_emit_writes_no_c_that_is_not_the_program(pirlc, here, monkeypatch):
    plant(monkeypatch, c_expressions, "chosen", "{consequent.at(NEGATION)} : {last}", "0 : {last}")
    outcome = pirlc("emit", "pole.pirl", "--target", "c", "-o", "o", "--json")
    assert (outcome.code, outcome.codes) == (1, ["E0915"])
    assert not (here / "o").exists()
    # Python is another matter.
    assert pirlc("emit", "pole.pirl", "--target", "python", "-o", "o").out == "wrote o/pole.py\n"


def test_emit_of_one_target_in_float(pirlc, here):
    outcome = pirlc("emit", "pole.pirl", "--target", "c", "--real", "float", "-o", "o", "--json")
    assert outcome.data["files"] == ["o/pole.h", "o/pole.c"]
    emitted = outcome.data["emitted"]
    assert (emitted["real"], emitted["evidence"]["words"]) == ("float", "proved")
    assert emitted["differences"] == []
    assert "action Push" in emitted["compared"]
    assert "typedef float pole_real;" in (here / "o" / "pole.h").read_text()


FORMS = ["interpreter", "python", *(["c"] if HAS_CC else [])]


def test_rollout_is_the_same_in_every_form(pirlc, here):
    # A weak program: its returns differ from episode to episode.
    (here / "weak.pirl").write_text(POLE.replace("k = 3", "k = -0.5"))
    found = []
    for form in FORMS:
        outcome = pirlc("rollout", "weak.pirl", "--as", form, "--episodes", "6", "--json")
        assert outcome.code == 0
        found.append(outcome.data)
        assert found[-1]["return"] == found[0]["return"]
        assert found[-1]["steps"] == found[0]["steps"] == 6 * found[0]["return"]["mean"]
    assert found[0]["return"]["low"] < found[0]["return"]["mean"] < found[0]["return"]["high"]
    spread = pirlc("rollout", "weak.pirl", "--episodes", "6", "--workers", "2", "--json").data
    assert spread == found[1]


def test_rollout_of_one_episode_has_no_interval(pirlc):
    outcome = pirlc("rollout", "pole.pirl", "--episodes", "1", "--seed", "7")
    assert outcome.out == (
        "pole (14 nodes, emitted Python, double) in CartPole-v1\n"
        "return 500.00   no interval   1 episode, seed 7\n"
    )
    data = pirlc("rollout", "pole.pirl", "--episodes", "1", "--json").data
    assert (data["return"]["low"], data["return"]["high"]) == (None, None)
    assert data["first_seed"] == 1_000_000


def test_rollout_tells_of_readings_outside_their_ranges(pirlc, here):
    (here / "narrow.pirl").write_text(POLE.replace("[-0.21, 0.21]", "[-0.001, 0.001]"))
    outcome = pirlc("rollout", "narrow.pirl", "--episodes", "2")
    assert "of 1,000 steps with a reading outside its range" in outcome.out


def test_rollout_in_the_environment_of_another_file(pirlc, here):
    (here / "bare.pirl").write_text(POLE.replace('environment "CartPole-v1"\n', ""))
    assert pirlc("rollout", "bare.pirl", "--json").codes == ["E0513"]
    outcome = pirlc("rollout", "bare.pirl", "--environment-from", "sketch.pirl", "--episodes", "2")
    assert (outcome.code, outcome.err) == (0, "")


@pytest.mark.skipif(not HAS_CC, reason="needs a C compiler")
def test_rollout_of_an_emitted_c_file(pirlc, here):
    pirlc("emit", "pole.pirl", "--target", "c", "--real", "float", "-o", "o")
    few = ("--episodes", "2", "--json")
    assert pirlc("rollout", "o/pole.c", *few).codes == ["E0708"]
    outcome = pirlc("rollout", "o/pole.c", "--sketch", "pole.pirl", *few)
    assert outcome.data["return"]["mean"] == 500.0
    assert outcome.data["policy"] == "pole (o/pole.c, float)"
    # It is this very file that runs: pushing always left ends soon.
    c = here / "o" / "pole.c"
    text = c.read_text()
    changed = text.replace("out->Push = ", "out->Push = 0 * ")
    assert changed != text
    c.write_text(changed)
    assert pirlc("rollout", "o/pole.c", "--sketch", "pole.pirl", *few).codes == ["E0709"]
    trusted = pirlc("rollout", "o/pole.c", "--sketch", "pole.pirl", "--trust", *few)
    assert trusted.data["return"]["mean"] < 20
    c.write_text("int main(void) { return 0; }\n")
    refused = pirlc("rollout", "o/pole.c", "--sketch", "pole.pirl", "--trust", *few)
    assert refused.codes == ["E0805"]
    assert refused.data["diagnostics"][0]["help"] == "was o/pole.c emitted from pole.pirl?"


@pytest.fixture
def own_cache(here, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(here / "cache"))


QUICK = ("--algorithm", "dqn", "--steps", "300", "--set", "learning_starts=50")


def test_oracle_trained_listed_and_run(pirlc, here, own_cache):
    assert pirlc("oracle", "list").out.startswith("no oracles in ")
    trained = pirlc(
        "oracle", "train", "sketch.pirl", *QUICK, "--set", "attempts=1", "-o", "oracle", "--json"
    )
    assert (trained.code, trained.err) == (0, "")
    assert trained.data["trained"] is True
    again = pirlc("oracle", "train", "sketch.pirl", *QUICK, "--set", "attempts=1")
    assert again.out.startswith("CartPole-v1: dqn, seed 0, 304 steps\nreturn ")
    assert "trained before, in " in again.out
    listed = pirlc("oracle", "list", "--json").data["oracles"]
    assert [entry["algorithm"] for entry in listed] == ["dqn"]
    for sketch in ((), ("--sketch", "pole.pirl")):
        run = pirlc("rollout", "oracle", *sketch, "--episodes", "3", "--seed", "5", "--json")
        assert run.data["policy"] == "oracle oracle (dqn, seed 0)"
        assert run.data["steps_with"] is None
    (here / "car.pirl").write_text((ROOT / "examples/mountain_car/mountain_car.pirl").read_text())
    assert pirlc("rollout", "oracle", "--sketch", "car.pirl", "--json").codes == ["E0605"]


def test_oracle_settings_that_make_no_sense(pirlc, here, own_cache):
    assert pirlc("oracle", "train", "pole.pirl", "--set", "gamma").code == 2
    train = ("oracle", "train", "pole.pirl", "--json")
    assert pirlc(*train, "--algorithm", "dqm").codes == ["E0611"]
    assert pirlc(*train, "--algorithm", "sac").codes == ["E0612"]
    assert pirlc(*train, "--set", "patience=no").codes == ["E0613"]
    (here / "full").mkdir()
    (here / "full" / "mine.txt").write_text("not an oracle")
    assert pirlc(*train, "-o", "full").codes == ["E0615"]
    assert pirlc(*train, "-o", "pole.pirl/oracle").codes == ["E0615"]
    (here / "other.pirl").write_text(POLE.replace("{0, 1}", "{0, 1, 7}"))
    assert pirlc("oracle", "train", "other.pirl", "--json").codes == ["E0510"]
    assert not (here / "cache").joinpath("pirlc", "oracles").exists()
