"""Template files to text. Templates give the shape; lines of code come ready from the printers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from typing import TYPE_CHECKING

from pirlc.backend.text import wrapped_c, wrapped_python
from pirlc.resources import runtime, templates

if TYPE_CHECKING:
    from jinja2 import Environment


@lru_cache(maxsize=8)
def _environment(target: str) -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(templates(target)),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    environment.filters["lines"] = _lines
    wrap = wrapped_python if target == "python" else wrapped_c
    environment.filters["code"] = partial(_code, wrap)
    return environment


def _lines(lines: list[str], prefix: str = "") -> str:
    """The lines one under another, each after the prefix, none with blanks at its end."""
    return "\n".join((prefix + line).rstrip() for line in lines)


def _code(wrap: Callable[[str], list[str]], lines: list[str], prefix: str = "") -> str:
    """Lines of code one under another, each after the prefix, long ones wrapped."""
    return "\n".join(part for line in lines for part in (wrap(prefix + line) if line else [""]))


def runtime_text(target: str, name: str) -> str:
    """Hand-written support code that goes into emitted files as it is, without a final newline."""
    return (runtime(target) / name).read_text(encoding="utf-8").rstrip("\n")


@lru_cache(maxsize=1)
def python_helpers() -> dict[str, str]:
    """The functions of runtime/python/arithmetic.py, by name, in the order of that file."""
    parts = runtime_text("python", "arithmetic.py").split("\n\n\n")
    return {
        part.removeprefix("def ").partition("(")[0]: part
        for part in parts
        if part.startswith("def ")
    }


def render(target: str, name: str, context: Mapping[str, object]) -> str:
    """The template file `name` of a target, filled in."""
    return _environment(target).get_template(name).render(context)
