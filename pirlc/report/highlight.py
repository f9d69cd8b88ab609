"""Text of the language in colour: spans around its words, and nothing else changed.

Works on any text, also on one that does not parse: what is no token stays plain.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from markupsafe import Markup, escape

from pirlc.frontend.slips import KEYWORDS

_TOKEN = re.compile(
    r"(?P<comment>#[^\n]*)"
    r'|(?P<text>"(?:[^"\\\n]|\\.)*")'
    r"|(?P<number>(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)"
    r"|(?P<name>[^\W\d]\w*)"
)
_DECLARED = re.compile(r"\b(?P<role>sensor|param|action|rule)\s+(?P<name>[^\W\d]\w*)")
_OPERATORS = frozenset(
    {
        "peek", "fold", "diff", "raw", "previous", "abs", "min", "max", "clip", "sqrt", "exp",
        "tanh", "sign",
    }
)  # fmt: skip


def highlighted(text: str) -> Markup:
    """The text with each word in a span whose class says what it is."""
    roles = {found["name"]: found["role"] for found in _DECLARED.finditer(text)}
    return Markup("").join(_pieces(text, roles))


def _pieces(text: str, roles: dict[str, str]) -> Iterator[Markup]:
    end = 0
    for token in _TOKEN.finditer(text):
        yield escape(text[end : token.start()])
        end = token.end()
        kind = _kind(token, roles)
        word = escape(token.group())
        yield word if kind is None else Markup('<span class="{}">{}</span>').format(kind, word)
    yield escape(text[end:])


def _kind(token: re.Match[str], roles: dict[str, str]) -> str | None:
    if token.lastgroup != "name":
        return token.lastgroup
    word = token.group()
    if word in KEYWORDS:
        return "keyword"
    if word in _OPERATORS:
        return "operator"
    return roles.get(word)
