"""Where the resource folders and the user's cache are.

The folders `grammars/`, `templates/` and `runtime/` stand beside the package in a checkout (and in
an editable install); the wheel carries them inside the package, under `pirlc/_resources/`.
"""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def _folder(name: str) -> Path:
    for base in (_PACKAGE / "_resources", _PACKAGE.parent):
        if (base / name).is_dir():
            return base / name
    raise FileNotFoundError(f"this installation of pirlc lacks its folder {name}/: reinstall it")


def grammar(name: str) -> Path:
    """A grammar file, such as ``pirl.lark``."""
    return _folder("grammars") / name


def templates(target: str) -> Path:
    """The folder of jinja2 files of a target."""
    return _folder("templates") / target


def runtime(target: str) -> Path:
    """The folder of support code that emitted code of a target may include or copy."""
    return _folder("runtime") / target


def explanations() -> Path:
    """The folder with one Markdown page for each diagnostic code."""
    return _PACKAGE / "explanations"


def user_cache() -> Path:
    """The folder of what pirlc keeps for this user, and can make again."""
    from platformdirs import user_cache_dir

    return Path(user_cache_dir("pirlc", appauthor=False))
