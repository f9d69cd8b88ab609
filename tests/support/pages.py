"""A page taken apart: what it shows, and where in the JSON it says that this stands."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from html.parser import HTMLParser
from typing import Any

SECTIONS = [
    "program", "reading", "returns", "front", "proofs", "traces", "analysis", "search", "resources",
    "sketch",
]  # fmt: skip
"""Of a page on which nothing is missing, in their order."""

_VOID = {"meta", "link", "br", "img", "hr", "path", "use", "rect"}


@dataclass
class Shown:
    """An element with `data-json`: its pointer, its `value` attribute, its whole text."""

    pointer: str
    value: str | None
    text: str = ""
    tag: str = ""


@dataclass
class Page(HTMLParser):
    """`shown` are the elements with a place in the JSON, `keys` those that show an object's key,
    `stray` the texts outside of both, `tags` all elements with their attributes."""

    source: str
    shown: list[Shown] = field(default_factory=list)
    keys: list[Shown] = field(default_factory=list)
    stray: list[str] = field(default_factory=list)
    tags: list[tuple[str, dict[str, str | None]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self._open: list[tuple[str, Shown | None]] = []
        self.feed(self.source)
        self.close()
        assert not self._open, f"left open: {self._open}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.tags.append((tag, given))
        found: Shown | None = None
        if "data-json" in given:
            found = Shown(given["data-json"] or "", given.get("value"), tag=tag)
            self.shown.append(found)
        elif "data-json-key" in given:
            found = Shown(given["data-json-key"] or "", None, tag=tag)
            self.keys.append(found)
        if tag not in _VOID:
            self._open.append((tag, found))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self._open and self._open[-1][0] == tag, f"</{tag}> closes {self._open[-1:]}"
        self._open.pop()

    def handle_data(self, data: str) -> None:
        around = [found for _, found in self._open if found is not None]
        for found in around:
            found.text += data
        if not around and not any(tag in ("style", "title") for tag, _ in self._open):
            self.stray.append(data)


def resolved(data: Any, pointer: str) -> Any:
    """What a JSON pointer (RFC 6901) leads to."""
    for token in pointer.split("/")[1:]:
        token = token.replace("~1", "/").replace("~0", "~")
        data = data[int(token)] if isinstance(data, list) else data[token]
    return data


def agrees(text: str, value: float) -> bool:
    """Whether a number as it is shown is the value, rounded to the digits that are shown."""
    plain = text.replace(",", "").replace("\N{MINUS SIGN}", "-")
    digits, _, exponent = plain.partition("e")
    places = len(digits.partition(".")[2]) - int(exponent or 0)
    return abs(float(plain) - value) <= 0.5000001 * 10.0**-places


def figures_in(text: str) -> list[str]:
    """The numbers in a text, but for those that are part of a name."""
    return re.findall(r"\d+", re.sub(r"SHA-256|binary(64|32)|Algorithm 1\b", "", text))


HOSTILE = (
    "x</code></pre><script>alert(1)</script><img src=x onerror=alert(2)> & \" ' $x$ {{ 7*7 }} ]]>"
    " `<b>` \\ </title></svg>"
)
"""A text that nobody should trust."""


_MAPS = ("readings", "raw", "applied", "previous", "operating", "outputs", "predicted", "simulated",
         "error", "fit", "others", "pieces")  # fmt: skip


def hostile(value: object, named: bool = False) -> object:
    """The data with every text made hostile, but for the words that pirlc itself decides by.

    `named`: it is an object whose keys are names of the run's own.
    """
    match value:
        case dict():
            kept = ("kind", "exact", "real", "stage", "program_sha256")
            tail = HOSTILE if named else ""
            return {k + tail: v if k in kept else hostile(v, k in _MAPS) for k, v in value.items()}
        case list():
            return [hostile(entry) for entry in value]
        case str() if value not in ("inf", "-inf"):
            return value + HOSTILE
        case _:
            return value
