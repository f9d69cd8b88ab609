"""`pirlc analyze`: text, JSON, plots, refusals."""

from __future__ import annotations

import re
import shlex

import pytest

from tests.support.command_line import ROOT

AALBORG = str(ROOT / "examples" / "torcs" / "printed" / "aalborg.pirl")
PENDULUM = str(ROOT / "examples" / "pendulum" / "pendulum-0.pirl")
ENGINE = """name = "engine"
sample_time = 0.2
[[channels]]
input = "accel"
output = "rpm"
num = [0.01]
den = [1.0, -0.98]
[operating]
rpm = 0.44
"""


def test_the_pendulum_has_margins_and_is_compared_with_the_simulator(pirlc):
    outcome = pirlc("analyze", PENDULUM)
    assert (outcome.code, outcome.err) == (0, "")
    for line in (
        "pendulum: 0.05 s a step, no latency",
        "  plant           Pendulum-v1 (upright): linearised equations, 2 states",
        "  law             -24 Side(k) - 5 Speed(k)",
        "  phase margin    52.42 degrees at 16.85 rad/s",
        "  delay margin    1.086 steps (0.05429 s)",
    ):
        assert line in outcome.out.splitlines()
    assert "differ by" in outcome.out
    assert "Torque 1 in the simulator: " in outcome.out
    assert all(len(line) <= 100 for line in outcome.out.splitlines())


def test_json_holds_what_the_text_says(pirlc, here):
    (here / "engine.toml").write_text(ENGINE)
    outcome = pirlc(
        "analyze", AALBORG, "--plant", "engine.toml", "--latency", "1", "--no-simulate", "--json"
    )
    analysis = outcome.data["analysis"]
    assert (analysis["program"], analysis["latency"]) == ("aalborg", 1)
    assert [leaf["name"] for leaf in analysis["leaves"]] == ["steer", "accel 1", "accel 2"]
    assert [loop["leaf"] for loop in analysis["loops"]] == ["accel 1", "accel 2"]
    loop = analysis["loops"][0]
    assert loop["stable"] is True
    assert all(check["difference"] <= 1e-6 for check in loop["checks"])
    assert loop["evidence"]["kind"] == "proved for the linearisation"
    assert analysis["plant"]["origin"] == "given in a file"
    assert outcome.data["files"] == []


def test_latency_costs_delay_margin(pirlc, here):
    (here / "engine.toml").write_text(ENGINE)
    delays = [
        pirlc(
            "analyze", AALBORG, "--plant", "engine.toml", "--latency", str(steps), "--no-simulate",
            "--json",
        ).data["analysis"]["loops"][0]["margins"]["delay_samples"]
        for steps in (0, 2)
    ]  # fmt: skip
    assert delays[0] - delays[1] == pytest.approx(2.0)


def test_plots_are_written(pirlc, here):
    (here / "engine.toml").write_text(ENGINE)
    outcome = pirlc(
        "analyze", AALBORG, "--plant", "engine.toml", "--no-simulate", "-o", "plots", "--json"
    )
    names = [f"accel-{i}-{kind}" for i in (1, 2) for kind in ("bode", "nyquist", "step", "poles")]
    assert outcome.data["files"] == [f"plots/{name}.png" for name in names]
    for name in outcome.data["files"]:
        assert (here / name).read_bytes().startswith(b"\x89PNG")


def test_without_an_environment_there_are_leaves(pirlc, here):
    text = (here / "pole.pirl").read_text().replace('environment "CartPole-v1"\n', "")
    (here / "bare.pirl").write_text(text)
    outcome = pirlc("analyze", "bare.pirl")
    assert outcome.code == 0
    assert "Push: 1 if 3 * peek(Angle, -1) + peek(AngularVelocity, -1) > 0, else 0" in outcome.out
    assert "note: no plant: no loops, no margins" in outcome.out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--at", "Angle"), "error[E0924]: `--at Angle` is no operating point: it has no `=`"),
        (("--at", "angle=1"),
         "error[E0924]: `--at angle=1` is no operating point: the program has no sensor or action "
         "'angle'"),
        (("--at", "Angle=x"),
         "error[E0924]: `--at Angle=x` is no operating point: 'x' is no number"),
        (("--at", "Angle=inf"),
         "error[E0924]: `--at Angle=inf` is no operating point: 'inf' is not finite"),
        (("--at", "Angle=1", "--at", "Angle=2"),
         "error[E0924]: `--at Angle=2` is no operating point: Angle is given twice"),
        (("--plant", "nowhere.toml"), "error[E0701]"),
        (("--plant", "simulator"), "error[E0925]: `pole` names no environment to find a plant in"),
    ],
)  # fmt: skip
def test_refusals(pirlc, here, arguments, message):
    text = (here / "pole.pirl").read_text().replace('environment "CartPole-v1"\n', "")
    (here / "bare.pirl").write_text(text)
    outcome = pirlc("analyze", "bare.pirl", *arguments)
    assert outcome.code == 1
    assert outcome.err.startswith(message)


def test_a_plant_that_cannot_be_had_is_no_error_unless_asked_for(pirlc, here):
    text = (here / "pole.pirl").read_text().replace("CartPole-v1", "Nowhere-v1")
    (here / "lost.pirl").write_text(text)
    outcome = pirlc("analyze", "lost.pirl", "--json")
    assert outcome.code == 0
    assert any(note.startswith("no plant: ") for note in outcome.data["analysis"]["notes"][1:])
    assert pirlc("analyze", "lost.pirl", "--plant", "simulator").code == 1


@pytest.mark.parametrize("code", [f"E092{i}" for i in range(7)])
def test_each_mistake_is_explained(pirlc, code):
    assert pirlc("explain", code).out.startswith(f"# {code}: ")


def test_a_sketch_is_refused(pirlc):
    assert pirlc("analyze", "sketch.pirl", "--json").codes == ["E0704"]


def test_the_documentation_shows_what_happens(pirlc, here):
    (here / "examples").symlink_to(ROOT / "examples")
    text = (ROOT / "docs" / "analysis.md").read_text(encoding="utf-8")
    (given,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    (here / "engine.toml").write_text(given)
    examples: list[tuple[str, list[str]]] = []
    for block in re.findall(r"```console\n(.*?)```", text, re.DOTALL):
        for line in block.splitlines():
            if line.startswith("$ "):
                examples.append((line.removeprefix("$ "), []))
            else:
                examples[-1][1].append(line)
    assert len(examples) >= 3
    for command, shown in examples:
        words = shlex.split(command)
        outcome = pirlc(*words[1:])
        assert outcome.code == 0, outcome.err
        pattern = "".join(
            r"(?:.*\n)*?" if line == "..." else re.escape(line) + r"\n" for line in shown
        )
        assert re.fullmatch(pattern, outcome.out), f"{command} printed\n{outcome.out}"
