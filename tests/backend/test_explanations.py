"""Every code of this package has its page."""

from __future__ import annotations

import re
from pathlib import Path

from pirlc.backend import problems
from pirlc.resources import explanations


def test_every_code_has_a_page():
    codes = re.findall(r'"(E\d{4})"', Path(problems.__file__).read_text(encoding="utf-8"))
    assert len(codes) == len(set(codes)) == 13
    for code in codes:
        page = (explanations() / f"{code}.md").read_text(encoding="utf-8")
        assert page.startswith(f"# {code}: ") and "## What to do" in page
