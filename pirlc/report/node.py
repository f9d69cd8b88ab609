"""Values on their way from the data to the page, each with its place in the data.

Templates see nothing but nodes, so whatever a page shows says where it stands in the JSON: as an
element with `data-json`, a JSON pointer (RFC 6901). Numbers are `<data>` elements that also carry
the whole value.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Any

from markupsafe import Markup, escape

from pirlc.report.highlight import highlighted

NOTHING = "\N{EM DASH}"

_MARKS = {
    "proved": ("\N{CHECK MARK}", "proved"),
    "proved for the linearisation": ("\N{ALMOST EQUAL TO}", "linearised"),
    "tested": ("\N{BLACK CIRCLE}", "tested"),
    "refuted": ("\N{BALLOT X}", "refuted"),
    "unknown": ("?", "unknown"),
}


class Node:
    """A value, and the JSON pointer that leads to it.

    It has no public attribute, so that in a template `node.name` is always the child of that name.
    """

    __slots__ = ("_pointer", "_value")

    def __init__(self, value: Any, pointer: str = "") -> None:
        self._value, self._pointer = value, pointer

    def __getitem__(self, key: str | int) -> Node:
        token = str(key).replace("~", "~0").replace("/", "~1")
        return Node(self._value[key], f"{self._pointer}/{token}")

    def __iter__(self) -> Iterator[Node]:
        """The elements of a list; the values of an object."""
        keys = self._value if isinstance(self._value, dict) else range(len(self._value))
        return (self[key] for key in keys)

    def __len__(self) -> int:
        return len(self._value)

    def __bool__(self) -> bool:
        """Whether there is something: a zero is, an empty list, an empty text and null are not."""
        return self._value not in (None, "", False) and self._value != [] and self._value != {}

    def __contains__(self, key: object) -> bool:
        return key in self._value

    def __html__(self) -> Markup:
        return shown(self)


def plain(node: Node) -> Any:
    """The value itself, to decide by; not to be put out."""
    return node._value


def pointer(node: Node) -> str:
    return node._pointer


def shown(node: Node, digits: int = 6) -> Markup:
    """The value as an element, reals to so many significant digits."""
    match node._value:
        case None:
            return _element(node, NOTHING)
        case bool() as truth:
            return _element(node, "yes" if truth else "no")
        case int() | float() as number:
            return Markup('<data data-json="{}" value="{}">{}</data>').format(
                node._pointer, json.dumps(number), _number_words(number, digits)
            )
        case "inf":
            return _element(node, "unlimited")
        case "-inf":
            return _element(node, "unlimited below")
        case str() as text:
            return _element(node, _prose(text))
        case _:
            raise TypeError(f"{node._pointer} is no single value")


def coloured(node: Node) -> Markup:
    """A text of the language, in colour."""
    return Markup('<code data-json="{}">{}</code>').format(node._pointer, highlighted(node._value))


def key(node: Node) -> Markup:
    """The name under which an object holds the value."""
    token = node._pointer.rpartition("/")[2].replace("~1", "/").replace("~0", "~")
    return Markup('<span data-json-key="{}">{}</span>').format(node._pointer, token)


def evidence(node: Node) -> Markup:
    """Evidence as its words, with a mark and a colour that say the same."""
    mark, kind = _MARKS[node._value["kind"]]
    return Markup('<span class="evidence {}"><span class="mark">{}</span>\u00a0{}</span>').format(
        kind, mark, node["words"]
    )


def _prose(text: str) -> Markup:
    """What stands between backticks as code, without them."""
    parts = text.split("`")
    if len(parts) % 2 == 0:
        return escape(text)
    code = Markup("<code>{}</code>")
    return Markup("").join(
        code.format(part) if odd % 2 else escape(part) for odd, part in enumerate(parts)
    )


def _element(node: Node, text: str | Markup) -> Markup:
    return Markup('<span data-json="{}">{}</span>').format(node._pointer, text)


def _number_words(value: float, digits: int) -> str:
    """A number to read: whole ones in full with their thousands apart, others to some digits."""
    if isinstance(value, int) or (value.is_integer() and abs(value) < 1e9):
        text = f"{int(value):,}"
    elif not math.isfinite(value):
        text = str(value)
    elif 10.0**digits <= abs(value) < 1e9:
        text = f"{value:,.0f}"
    else:
        text = f"{value:.{digits}g}"
    return text.replace("-", "\N{MINUS SIGN}")
