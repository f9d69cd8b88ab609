"""`--argument`: other arguments for the environment that a file names."""

from __future__ import annotations

import json

import pytest

from pirlc.cli.arguments import parse_arguments
from pirlc.diagnostics import PirlcError
from pirlc.frontend import parse_sketch
from pirlc.source import SourceText
from tests.support.oracles import save_balancer


def test_values_are_typed_as_in_the_language():
    texts = ("a=1", "b=-2.5", "c=1e3", "d=true", "e=false", "f=aalborg", 'g="3"', "h=x=y", "i=")
    assert parse_arguments(texts) == (
        ("a", 1), ("b", -2.5), ("c", 1000.0), ("d", True), ("e", False), ("f", "aalborg"),
        ("g", "3"), ("h", "x=y"), ("i", ""),
    )  # fmt: skip
    assert [type(value) for _, value in parse_arguments(texts)[:4]] == [int, float, float, bool]


@pytest.mark.parametrize(
    ("entries", "reason"),
    [
        (("track",), "it has no `=`"),
        (("=3",), "`` is no name"),
        (("3=3",), "`3` is no name"),
        (("a b=3",), "`a b` is no name"),
        (("a=1", "a=2"), "`a` is given twice"),
        (("a=1e999",), "the number is too large"),
        (('a="x',), "the text does not end with its quote"),
    ],
)
def test_what_is_no_argument(entries, reason):
    with pytest.raises(PirlcError) as caught:
        parse_arguments(entries)
    (found,) = caught.value.diagnostics
    assert found.code == "E0541"
    assert found.message.endswith(f": {reason}")


def test_a_rollout_in_a_shorter_environment(pirlc):
    plain = pirlc("rollout", "pole.pirl", "--episodes", "2", "--json").data
    short = pirlc(
        "rollout", "pole.pirl", "--episodes", "2", "--json", "--argument", "max_episode_steps=7"
    ).data
    assert plain["return"]["mean"] > 7.0
    assert (short["return"]["mean"], short["steps"], short["deterministic"]) == (7.0, 14, False)


def test_an_oracle_in_a_shorter_environment(pirlc, here):
    save_balancer(here / "oracle")
    asked = ("rollout", "oracle", "--episodes", "2", "--argument", "max_episode_steps=9", "--json")
    assert pirlc(*asked).data["return"]["mean"] == 9.0


@pytest.mark.parametrize(
    "command",
    [("rollout", "pole.pirl"), ("check", "pole.pirl", "--environment"),
     ("synth", "sketch.pirl", "-o", "run", "--no-oracle"), ("oracle", "train", "sketch.pirl")],
    ids=" ".join,
)  # fmt: skip
def test_arguments_that_the_environment_does_not_take(pirlc, here, command):
    outcome = pirlc(*command, "--argument", "colour=red", "--json")
    assert (outcome.code, outcome.codes) == (1, ["E0503"])
    assert pirlc(*command, "--argument", "colour", "--json").codes == ["E0541"]
    assert not (here / "run").exists()


def test_arguments_for_a_file_without_an_environment(pirlc, here):
    text = (here / "pole.pirl").read_text()
    without = "\n".join(line for line in text.split("\n") if not line.startswith("environment"))
    (here / "bare.pirl").write_text(without)
    assert pirlc("check", "bare.pirl", "--argument", "track=aalborg", "--json").codes == ["E0513"]


SKETCH = """policy pole
environment "CartPole-v1" { max_episode_steps = 30 }
sensor Angle           : [-0.21, 0.21] = 2
sensor AngularVelocity : [-3.5, 3.5]   = 3
window 1
action Push : {0, 1} = if ?a * peek(Angle, -1) + ?b * peek(AngularVelocity, -1) > 0 then 1 else 0
"""


def test_an_oracle_beside_the_sketch_is_used_and_the_arguments_are_recorded(pirlc, here):
    folder = here / "examples"
    folder.mkdir()
    (folder / "small.pirl").write_text(SKETCH)
    save_balancer(folder / "oracles" / "balancer")
    asked = (
        "synth", "examples/small.pirl", "-o", "run", "--optimizer", "casadi", "--no-refine",
        "--episodes", "5",
    )  # fmt: skip
    outcome = pirlc(*asked, "--argument", "max_episode_steps=40")
    assert outcome.code == 0, outcome.err
    assert outcome.err.startswith("oracle: examples/oracles/balancer (written by hand, seed ")
    manifest = json.loads((here / "run" / "manifest.json").read_text())
    assert manifest["oracle_from"] == "examples/oracles/balancer"
    assert len(manifest["oracle"]["weights_sha256"]) == 64
    assert manifest["asked"]["arguments"] == {"max_episode_steps": 40}
    assert manifest["environment"]["arguments"] == {"max_episode_steps": 40}
    text = (here / "run" / "pole.pirl").read_text()
    environment = parse_sketch(SourceText("p", text)).interface.environment
    assert environment is not None
    assert environment.arguments == (("max_episode_steps", 40),)
    assert manifest["evaluation"]["returns"]["program"]["mean"] == 40.0
    # Other arguments are another run; none of the training's wishes may be disregarded.
    other = pirlc(*asked, "--argument", "max_episode_steps=41", "--json")
    assert other.codes == ["E0723"]
    assert "differs in: arguments" in other.data["diagnostics"][0]["notes"]
    again = pirlc(*asked, "--argument", "max_episode_steps=40", "--json")
    assert again.data["oracle"] == "examples/oracles/balancer"


@pytest.mark.parametrize("wish", [("--oracle", "train"), ("--oracle-seed", "3")], ids=" ".join)
def test_a_training_that_is_asked_for_is_not_replaced(pirlc, here, wish, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(here / "cache"))
    (here / "small.pirl").write_text(SKETCH)
    save_balancer(here / "oracles" / "balancer")
    outcome = pirlc(
        "synth", "small.pirl", "-o", "run", *wish, "--oracle-steps", "64", "--optimizer", "casadi",
        "--no-refine", "--episodes", "5", "--budget", "1",
    )  # fmt: skip
    assert outcome.code == 0, outcome.err
    assert outcome.err.startswith("oracle: trained (")
