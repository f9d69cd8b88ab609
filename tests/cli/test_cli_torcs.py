"""`pirlc torcs install` and `pirlc torcs doctor`."""

from __future__ import annotations

import sys


def test_install_says_what_there_is(torcs_installation, pirlc) -> None:
    outcome = pirlc("torcs", "install")
    assert (outcome.code, outcome.err) == (0, "")
    lines = outcome.out.splitlines()
    assert lines[0].startswith("TORCS ")
    assert lines[0].endswith(": a command every 0.02 s")
    assert lines[1] == (
        "g-track-1 2,058 m, g-track-2 3,186 m, eroad 3,260 m, aalborg 2,588 m, alpine-2 3,774 m, "
        "ruudskogen 3,274 m"
    )
    assert lines[2].startswith("nothing to do: prepared before, in ")
    data = pirlc("torcs", "install", "--json").data
    assert data["changed"] is False
    assert data["torcs"]["control_interval"] == 0.02
    assert len(data["torcs"]["tracks"]) == 6


def test_doctor_finds_everything_well(torcs_installation, pirlc) -> None:
    outcome = pirlc("torcs", "doctor")
    assert outcome.code == 0, outcome.out
    assert [line[:5] for line in outcome.out.splitlines()] == ["ok   "] * 7
    assert "ok    control interval  0.02 s\n" in outcome.out
    data = pirlc("torcs", "doctor", "--json").data
    assert data["ok"] is True
    assert {check["name"] for check in data["checks"]} >= {"TORCS", "host robot", "tracks"}


def test_doctor_of_an_empty_cache(here, pirlc, monkeypatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(here / "cache"))
    outcome = pirlc("torcs", "doctor", "--json")
    assert outcome.code == 1
    assert outcome.data["ok"] is False
    found = {check["name"]: check for check in outcome.data["checks"]}
    assert not found["host robot"]["ok"]
    assert not found["tracks"]["ok"]
    outcome = pirlc("torcs", "doctor")
    assert outcome.code == 1
    assert "WRONG host robot" in outcome.out
    assert not (here / "cache").exists()


def test_a_cache_that_is_no_folder(torcs_installation, here, pirlc, monkeypatch) -> None:
    (here / "cache").write_text("mine")
    monkeypatch.setenv("XDG_CACHE_HOME", str(here / "cache"))
    outcome = pirlc("torcs", "install", "--source", torcs_installation.headers)
    assert outcome.code == 1
    assert outcome.err.startswith("error[E0526]: TORCS cannot be prepared in ")
    assert pirlc("torcs", "install", "--json").codes == ["E0526"]


def test_programs_that_need_torcs_say_how_to_get_it(here, pirlc, monkeypatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(here / "cache"))
    (here / "drive.pirl").write_text(
        'policy drive\nenvironment "pirlc/Torcs-v0"\nsensor TrackPos : [-1, 1] = 2\n'
        "action Steer : [-1, 1] = 0 - peek(TrackPos, -1)\naction Accel : [0, 1] safe 0 = 0.5\n"
    )
    outcome = pirlc("rollout", "drive.pirl", "--episodes", "1")
    assert outcome.code == 1
    assert "pirlc torcs install" in outcome.err
    assert outcome.err.startswith(("error[E0520]", "error[E0524]"))


def test_a_call_that_has_nothing_to_do_loads_nothing_heavy(torcs_installation, process) -> None:
    import subprocess

    code = (
        "import sys; from pirlc.cli import main; main(['torcs', 'install'])\n"
        "print([m for m in ('numpy', 'gymnasium', 'torch', 'casadi') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True,
                          cwd=__file__.partition("tests")[0])  # fmt: skip
    assert done.stdout.splitlines()[-1] == "[]"
