"""`pirlc report`, and the commands that docs/report.md shows."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import sys

import pytest

from pirlc.cli import main
from tests.support.command_line import ROOT

TEXT = (ROOT / "docs" / "report.md").read_text(encoding="utf-8")


def test_the_commands_of_the_documentation(run, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(run, tmp_path / "runs" / "cartpole")
    for block in re.findall(r"```console\n(.*?)```", TEXT, re.DOTALL):
        first, _, shown = block.partition("\n")
        words = shlex.split(first.removeprefix("$ "))
        assert words[0] == "pirlc" and main(words[1:]) == 0
        assert capfd.readouterr() == (shown, "")
    assert (tmp_path / "runs" / "cartpole" / "report.html").is_file()


def test_the_example_of_a_figure_is_how_figures_are_shown(run, capfd):
    (example,) = re.findall(r"```html\n(.*?)\n```", TEXT, re.DOTALL)
    manifest = json.loads((run / "manifest.json").read_text())
    manifest["evaluation"]["returns"]["program"]["mean"] = 499.36
    (run / "manifest.json").write_text(json.dumps(manifest))
    assert main(["report", str(run)]) == 0
    assert example in (run / "report.html").read_text()


def test_sections_and_files_are_as_documented(full):
    documented = set(re.findall(r"`(\w+\.jsonl?)`", TEXT))
    assert {name for name in documented if not name.startswith("report")} <= {
        path.name for path in full.iterdir()
    }


def test_json(run, capfd):
    assert main(["report", str(run), "--json"]) == 0
    out, err = capfd.readouterr()
    assert err == ""
    assert json.loads(out) == {
        "diagnostics": [],
        "page": str(run / "report.html"),
        "data": str(run / "report.json"),
    }


@pytest.mark.parametrize("arguments", [["docs"], ["nowhere", "--json"]])
def test_refusals(arguments, monkeypatch, capfd):
    monkeypatch.chdir(ROOT)
    assert main(["report", *arguments]) == 1
    out, err = capfd.readouterr()
    assert "E0740" in (out if "--json" in arguments else err)
    assert not (ROOT / "docs" / "report.html").exists()


def test_a_page_needs_no_oracle_and_no_solver(full):
    """What is stored is shown; nothing is computed again."""
    code = (
        "import sys; from pirlc.cli import main; main(['report', sys.argv[1]]); "
        "print([m for m in ('torch', 'casadi', 'z3', 'control', 'gymnasium') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(full)],
        cwd=ROOT, check=True, capture_output=True, text=True,
    )  # fmt: skip
    assert done.stdout.splitlines()[-1] == "[]"
