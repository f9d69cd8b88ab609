"""Template files to text. Templates give the shape; lines of code come ready from the printers."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING

from pirlc.resources import templates

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
    return environment


def _lines(lines: list[str], prefix: str = "") -> str:
    """The lines one under another, each after the prefix, none with blanks at its end."""
    return "\n".join((prefix + line).rstrip() for line in lines)


def render(target: str, name: str, context: Mapping[str, object]) -> str:
    """The template file `name` of a target, filled in."""
    return _environment(target).get_template(name).render(context)
