"""Faults put into the functions and templates that emitted C is made by."""

from __future__ import annotations

import inspect
import shutil
import textwrap
from pathlib import Path
from typing import Any

import pytest

from pirlc.backend import rendering
from pirlc.resources import templates


def plant(monkeypatch: pytest.MonkeyPatch, owners: Any, name: str, old: str, new: str) -> None:
    """Changes a function's source text, once, in the modules or classes that hold it."""
    owners = owners if isinstance(owners, tuple) else (owners,)
    function = getattr(owners[0], name)
    source = textwrap.dedent(inspect.getsource(function))
    assert source.count(old) == 1, f"{name} has {source.count(old)} times {old!r}"
    changed = "from __future__ import annotations\n" + source.replace(old, new)
    made: dict[str, Any] = {}
    exec(compile(changed, f"<{name}, changed>", "exec"), function.__globals__, made)
    for owner in owners:
        assert getattr(owner, name) is function
        monkeypatch.setattr(owner, name, made[name])


def plant_in_template(
    monkeypatch: pytest.MonkeyPatch, folder: Path, name: str, old: str, new: str
) -> None:
    """Changes the text of a template of C, once, for as long as the patch lasts."""
    shutil.copytree(templates("c"), folder / "c")
    text = (folder / "c" / name).read_text()
    assert text.count(old) == 1, f"{name} has {text.count(old)} times {old!r}"
    (folder / "c" / name).write_text(text.replace(old, new))
    fresh = rendering._environment.__wrapped__
    monkeypatch.setattr(rendering, "_environment", fresh)
    monkeypatch.setattr(rendering, "templates", lambda target: folder / target)
