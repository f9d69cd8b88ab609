"""What one run of the command line prints: text for people, or one JSON object."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TextIO, TypeVar

import click

from pirlc.cli.problems import SystemRefused, error
from pirlc.diagnostics import Diagnostic, as_json, render

Command = TypeVar("Command", bound=Callable[..., Any])


class Session:
    """How this run prints. Diagnostics are kept until the end where the output is JSON."""

    def __init__(self) -> None:
        self.json = False
        self._told: list[Diagnostic] = []

    def tell(self, diagnostics: Iterable[Diagnostic]) -> None:
        """Show diagnostics: at once on stderr, or in the JSON object of the end."""
        if self.json:
            self._told.extend(diagnostics)
            return
        color = colored(sys.stderr)
        for diagnostic in diagnostics:
            print(render(diagnostic, color=color), file=sys.stderr, end="\n\n")

    def note(self, text: str) -> None:
        """A remark on the way, on stderr; nothing where the output is JSON."""
        if not self.json:
            print(text, file=sys.stderr)

    def say(self, text: str) -> None:
        """A result in words, on stdout; nothing where the output is JSON."""
        if not self.json:
            _print(text)

    def finish(self, result: Mapping[str, object]) -> None:
        """The result as data: the one JSON object on stdout, where that is asked for."""
        if self.json:
            whole = {"diagnostics": [as_json(d) for d in self._told], **result}
            _print(json.dumps(_plain(whole), indent=2, ensure_ascii=False, allow_nan=False))


def _print(text: str) -> None:
    try:
        click.echo(text)
    except BrokenPipeError:
        raise
    except OSError as e:
        raise error(SystemRefused("standard output", (e.strerror or str(e)).lower())) from None


def _plain(value: object) -> object:
    """The value without NaN and infinities, for which JSON has no words."""
    match value:
        case float() if not math.isfinite(value):
            return None
        case Mapping():
            return {str(key): _plain(entry) for key, entry in value.items()}
        case list() | tuple():
            return [_plain(entry) for entry in value]
        case _:
            return value


def colored(stream: TextIO) -> bool:
    """Whether a stream is a terminal that shows colours, and none forbade them."""
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
    return is_terminal(stream) and not plain


def is_terminal(stream: TextIO) -> bool:
    return hasattr(stream, "isatty") and stream.isatty()


def json_option(command: Command) -> Command:
    """`--json`, which every command takes."""

    def choose(context: click.Context, _: click.Parameter, given: bool) -> None:
        if given:
            context.ensure_object(Session).json = True

    return click.option(
        "--json",
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=choose,
        help="Print one JSON object instead of text.",
    )(command)


pass_session = click.make_pass_decorator(Session, ensure=True)
