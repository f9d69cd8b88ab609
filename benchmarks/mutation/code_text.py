"""Faults in emitted code, as text: in a line of a template, or in a printer's string.

Emitted code writes its operators between blanks, which is what these rules go by. Comments and
quoted words are left alone: a fault in them changes no behaviour.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Literal

Language = Literal["c", "python", "both"]

_ORDERS = {"<": ("<=", ">"), "<=": ("<", ">="), ">": (">=", "<"), ">=": (">", "<=")}
_SWAPS: dict[str, tuple[str, ...]] = {
    **_ORDERS,
    "==": ("!=",),
    "!=": ("==",),
    "&&": ("||",),
    "||": ("&&",),
    "and": ("or",),
    "or": ("and",),
    "+": ("-",),
    "-": ("+",),
    "*": ("+",),
    "&": ("|",),
    ">>": ("<<",),
    "|=": ("=", "&="),
    "+=": ("-=", "="),
    "if": ("if not",),
    "elif": ("elif not",),
    "not": ("",),
}
_PYTHON_ONLY = ("if", "elif", "not", "and", "or")
_BETWEEN_BLANKS = re.compile(r"(?<!\S)(\S+)(?!\S)")
_NUMBER = re.compile(r"(?<![\w.])(\d+)(?=(\.\d+)?(u|f)?\b)")
_WORDS = (
    (re.compile(r"MISSING\b"), "SAFE_USED"),
    (re.compile(r"OUT_OF_RANGE\b"), "MISSING"),
    (re.compile(r"SAFE_USED\b"), "MISSING"),
    (re.compile(r"\bTrue\b"), "False"),
    (re.compile(r"\bFalse\b"), "True"),
    (re.compile(r"\bNone\b"), "0"),
    (re.compile(r"\bdouble\b"), "float"),
    (re.compile(r"!(?!=)"), ""),
    (re.compile(r"(?<![\w\s)\]}]) ?-(?![ >=])"), ""),
)
_KEPT: dict[Language, re.Pattern[str]] = {
    "c": re.compile(r'/\*.*?(\*/|$)|"[^"]*"|#include.*'),
    "python": re.compile(r"""#.*|"[^"]*"|'[^']*'"""),
    "both": re.compile(r'/\*.*?(\*/|$)|"[^"]*"'),
}


def faults(text: str, language: Language) -> Iterator[tuple[str, str]]:
    """What the fault is, and the text with it."""
    kept = [range(*match.span()) for match in _KEPT[language].finditer(text)]

    def replaced(span: tuple[int, int], new: str) -> Iterator[str]:
        if not any(span[0] in part for part in kept):
            yield text[: span[0]] + new + text[span[1] :]

    for match in _BETWEEN_BLANKS.finditer(text):
        word = match[1]
        if language == "c" and word in _PYTHON_ONLY:
            continue
        for new in _SWAPS.get(word, ()):
            for result in replaced(match.span(1), new):
                yield f"{word} for {new}" if new else f"without {word}", result
    for match in _NUMBER.finditer(text):
        value = int(match[1])
        for other in (value + 1, value - 1):
            if other >= 0:
                for result in replaced(match.span(1), str(other)):
                    yield f"{value} for {other}", result
    for pattern, new in _WORDS:
        for match in pattern.finditer(text):
            for result in replaced(match.span(), new):
                yield f"{match[0].strip()} for {new}" if new else f"without {match[0]}", result
