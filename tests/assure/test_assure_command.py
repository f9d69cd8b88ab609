"""`python -m benchmarks.assure`, and the page that it writes."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from benchmarks.assure import __main__ as command
from benchmarks.assure import page, tools
from benchmarks.assure.driving import CORTEX_M3, CORTEX_M4F, HOST, PPC64, S390X
from benchmarks.assure.subjects import EXAMPLES, example_programs
from benchmarks.assure.tools import Tool

EVERY_TOOL = {
    tool
    for name in (*command.CHECKS, *command.MEASUREMENTS)
    for tool in (
        command.CHECKS[name].tools if name in command.CHECKS else command.MEASUREMENTS[name]
    )
}
MISSING = sorted(tool.package for tool in EVERY_TOOL if not tool.installed)


def test_every_closed_program_of_the_examples_is_a_subject():
    labels = [label for label, _ in example_programs()]
    assert len(labels) >= 21
    assert {
        "acrobot/acrobot-0",
        "cartpole/cartpole-0",
        "mountain_car/mountain_car-0",
        "pendulum/pendulum-0",
        "torcs/printed/aalborg",
        "torcs/printed/g-track-1",
    } <= set(labels)
    synthesised = EXAMPLES / "torcs" / "synthesised"
    stored = {f"torcs/synthesised/{path.stem}" for path in synthesised.glob("*.pirl")}
    assert {label for label in labels if "synthesised" in label} == stored


@pytest.mark.parametrize("name", ["acrobot", "cartpole", "mountain_car", "pendulum"])
def test_the_stored_programs_are_those_that_the_readmes_show(name):
    readme = (EXAMPLES / name / "README.md").read_text(encoding="utf-8")
    shown = readme.split("```text\n")[1].split("```")[0].strip()
    assert shown in (EXAMPLES / name / f"{name}-0.pirl").read_text(encoding="utf-8")


def test_a_tool_that_is_not_installed_is_named_with_its_package(monkeypatch, capsys):
    absent = Tool("no-such-checker", "some-package")
    check = command.CHECKS["warnings"]
    monkeypatch.setitem(command.CHECKS, "warnings", command.Check(check.run, (absent,)))
    assert command.main(["--only", "warnings"]) == 2
    assert capsys.readouterr().err == "not installed: no-such-checker\n  apt install some-package\n"
    monkeypatch.setenv("CI", "1")
    assert command.main(["--only", "warnings", "--skip-missing"]) == 2


@pytest.mark.skipif(not tools.GCC.installed, reason="needs gcc")
def test_findings_are_the_exit_code(monkeypatch, capsys):
    monkeypatch.setattr(command, "example_programs", lambda: iter(()))
    assert command.main(["--only", "gcc-analyzer", "--random", "2"]) == 0
    said = capsys.readouterr().out
    assert "0 examples and 2 random programs, each in double and in float" in said
    assert "no findings" in said

    broken = command.Check(
        lambda subject, _: command.Outcome((f"{subject.stem} is wrong",)), (tools.GCC,)
    )
    monkeypatch.setitem(command.CHECKS, "gcc-analyzer", broken)
    assert command.main(["--only", "gcc-analyzer", "--random", "1", "--json"]) == 1
    entry = json.loads(capsys.readouterr().out)["checks"]["gcc-analyzer"]
    assert entry["findings"] == [
        "random000 (double): random000 is wrong",
        "random000 (float): random000 is wrong",
    ]


def test_the_page_shows_the_record():
    record = json.loads(command.RESULTS.read_text(encoding="utf-8"))
    text = command.PAGE.read_text(encoding="utf-8")
    assert page.filled(text, record) == text
    assert all(not entry["findings"] for entry in record["checks"].values())
    assert record["programs"] == {"examples": len(list(example_programs())), "random": 200}


def test_the_commands_on_the_page_are_there():
    text = command.PAGE.read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line.startswith("$ ")]
    assert lines[0] == "$ make assure"
    makefile = (command.REPOSITORY / "Makefile").read_text(encoding="utf-8")
    assert "\nassure: $(VENV)/installed-dev\n\t@$(BIN)/python -m benchmarks.assure\n" in makefile
    others = [line.removeprefix("$ python -m benchmarks.assure ") for line in lines[1:]]
    assert [command._options(other.split()).only for other in others] == [["cppcheck", "targets"]]
    for name in (*command.CHECKS, *command.MEASUREMENTS):
        assert f"| `{name}` |" in text


@pytest.mark.skipif(bool(MISSING), reason=f"needs {', '.join(MISSING)}")
def test_exp_and_tanh_are_within_the_bound(tmp_path, monkeypatch):
    from benchmarks.assure import functions

    monkeypatch.setattr(functions, "POINTS", 200)
    distances, findings = functions.check(tmp_path)
    assert findings == []
    machines = [machine.name for machine in (HOST, CORTEX_M3, CORTEX_M4F, S390X, PPC64)]
    assert {distance.machine for distance in distances} == set(machines)
    monkeypatch.setattr(functions, "BOUND", 0.3)
    assert len(functions.check(tmp_path)[1]) == len(distances)


@pytest.mark.slow
@pytest.mark.skipif(bool(MISSING), reason=f"needs {', '.join(MISSING)}")
def test_all_of_it_is_clean():
    found = subprocess.run(
        [sys.executable, "-m", "benchmarks.assure"],
        capture_output=True,
        text=True,
        timeout=1800,
    )
    assert found.returncode == 0, found.stdout + found.stderr
    assert "no findings" in found.stdout
