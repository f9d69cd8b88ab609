"""`--argument KEY=VALUE`: other arguments for the environment that a file names."""

from __future__ import annotations

import json
import re

import click

from pirlc.cli.problems import NotAnArgument, error
from pirlc.ir.policy import Scalar

Arguments = tuple[tuple[str, Scalar], ...]

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
_INTEGER = re.compile(r"-?[0-9]+")
_NUMBER = re.compile(r"-?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_TRUTH = {"true": True, "false": False}


def parse_arguments(entries: tuple[str, ...]) -> Arguments:
    """The pairs that ``key=value`` texts say. Raises PirlcError E0541.

    A value is a number, `true` or `false` as in a .pirl file; anything else is a string, whose
    quotes may be left out.
    """
    found: dict[str, Scalar] = {}
    for entry in entries:
        name, equals, text = entry.partition("=")
        if not equals:
            raise error(NotAnArgument(entry, "it has no `=`"))
        if not _NAME.fullmatch(name):
            raise error(NotAnArgument(entry, f"`{name}` is no name"))
        if name in found:
            raise error(NotAnArgument(entry, f"`{name}` is given twice"))
        found[name] = _value(entry, text)
    return tuple(found.items())


def _value(entry: str, text: str) -> Scalar:
    if text in _TRUTH:
        return _TRUTH[text]
    if _INTEGER.fullmatch(text):
        return int(text)
    if _NUMBER.fullmatch(text):
        value = float(text)
        if abs(value) == float("inf"):
            raise error(NotAnArgument(entry, "the number is too large"))
        return value
    if text.startswith('"'):
        try:
            read = json.loads(text)
        except ValueError:
            raise error(NotAnArgument(entry, "the text does not end with its quote")) from None
        assert isinstance(read, str)
        return read
    return text


def _given(_: click.Context, __: click.Parameter, entries: tuple[str, ...]) -> Arguments:
    return parse_arguments(entries)


argument_option = click.option(
    "--argument",
    "arguments",
    multiple=True,
    metavar="KEY=VALUE",
    callback=_given,
    help="An argument of the environment, instead of the file's or beside it; may be repeated.",
)
