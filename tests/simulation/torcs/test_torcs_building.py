"""Robots are built for TORCS, and an installation is tried by racing."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from pirlc.simulation.torcs import trial
from pirlc.simulation.torcs.building import Compiler, build_robot, find_compiler
from pirlc.simulation.torcs.installation import host_sources
from tests.support.refusals import refused


def compiler() -> Compiler:
    found = find_compiler()
    assert found is not None
    return found


@pytest.mark.parametrize("name", ["g++", "clang++"])
def test_the_host_is_built_without_a_warning(
    torcs_installation, tmp_path, monkeypatch, name
) -> None:
    if shutil.which(name) is None:
        pytest.skip(f"needs {name}")
    monkeypatch.setenv("CXX", name)
    chosen = compiler()
    assert chosen.command == (name,)
    sources = [path for path in host_sources() if path.suffix == ".cpp"]
    module = tmp_path / "pirlc.so"
    strictly = ("-Werror", "-fsyntax-only", "-Wno-unused-command-line-argument")
    build_robot(chosen, sources, torcs_installation.headers, module, *strictly)


def test_what_the_compiler_says_is_passed_on(torcs_installation, tmp_path) -> None:
    bad = tmp_path / "bad.cpp"
    bad.write_text("#include <car.h>\nint f() { return mistake; }\n")
    headers, module = torcs_installation.headers, tmp_path / "bad.so"
    message = refused(lambda: build_robot(compiler(), [bad], headers, module))
    assert message.startswith("error[E0523]: ")
    assert "mistake" in message
    assert not module.exists()


def test_another_control_interval_is_refused(torcs_installation, monkeypatch) -> None:
    monkeypatch.setattr(trial, "CONTROL_INTERVAL", 0.2)
    message = refused(lambda: trial.control_interval(torcs_installation))
    assert "it asks robots for a command every 0.02 s, where 0.2 s are needed" in message


def test_a_torcs_that_fails_is_refused(torcs_installation, tmp_path) -> None:
    ends = replace(torcs_installation, binary=Path("/bin/false"))
    message = refused(lambda: trial.control_interval(ends))
    assert "a race on g-track-1 failed: " in message
    assert "exit status 1" in message
    message = refused(lambda: trial.track_lengths(ends))
    assert "the track g-track-1 cannot be loaded: " in message
    bare = replace(torcs_installation, data=tmp_path)
    message = refused(lambda: trial.track_lengths(bare))
    assert "it has no road track called g-track-1" in message
