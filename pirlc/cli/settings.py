"""`--set key=value`, the settings of a training."""

from __future__ import annotations

import json
from typing import Any

import click


def _settings(_: click.Context, __: click.Parameter, entries: tuple[str, ...]) -> dict[str, Any]:
    """``key=value`` pairs; a value is JSON where it can be read as such, else a string."""
    found: dict[str, Any] = {}
    for entry in entries:
        name, equals, value = entry.partition("=")
        if not equals or not name.isidentifier():
            raise click.BadParameter(f"write key=value, such as learning_rate=0.001; not {entry!r}")
        try:
            found[name] = json.loads(value)
        except ValueError:
            found[name] = value
    return found


settings_option = click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    callback=_settings,
    help="Another setting of the oracle's training or of its algorithm; may be repeated.",
)
