"""The page on a diagnostic's code."""

from __future__ import annotations

import re

from pirlc import resources


def explain(code: str) -> str | None:
    """The page (Markdown) on a code such as ``E0303`` of any part of the compiler, or None."""
    # The code becomes a file name, so nothing but a code is let through.
    if not re.fullmatch(r"[eE]\d{4}", code):
        return None
    page = resources.explanations() / f"{code.upper()}.md"
    return page.read_text(encoding="utf-8") if page.is_file() else None
