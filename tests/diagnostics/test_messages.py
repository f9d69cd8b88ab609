"""Every kind of mistake: a bad file and, beside it, the exact message.

``PIRLC_UPDATE=1`` rewrites the messages; read the difference before keeping it.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from pirlc import resources
from pirlc.diagnostics import PirlcError, render
from pirlc.frontend import check
from pirlc.source import SourceText

FOLDER = Path(__file__).parent
BAD = sorted(FOLDER.glob("*.pirl"))
CODES = sorted(
    {
        code
        for file in Path("pirlc/frontend").resolve().glob("describe*.py")
        for code in re.findall(r'"(E\d{4})"', file.read_text(encoding="utf-8"))
    }
)
NEEDS_A_LONG_FILE = {"E0107"}


def diagnose(text: str, name: str) -> tuple[list[str], str]:
    """The codes and the rendered diagnostics of a text, errors or else warnings."""
    try:
        _, diagnostics = check(SourceText(name, text))
    except PirlcError as error:
        diagnostics = error.diagnostics
    return [d.code for d in diagnostics], "\n\n".join(map(render, diagnostics))


@pytest.mark.parametrize("file", BAD, ids=lambda file: file.stem)
def test_message(file: Path) -> None:
    codes, rendered = diagnose(file.read_text(encoding="utf-8"), file.name)
    expected = file.with_suffix(".txt")
    if os.environ.get("PIRLC_UPDATE"):
        expected.write_text(rendered + "\n", encoding="utf-8")
    assert rendered + "\n" == expected.read_text(encoding="utf-8")
    if file.stem.startswith("E"):
        assert file.stem[:5] in codes


def test_every_code_has_a_bad_file() -> None:
    assert len(CODES) > 40
    shown = {file.stem[:5] for file in BAD} | NEEDS_A_LONG_FILE
    assert set(CODES) - shown == set()


def test_too_long_a_file() -> None:
    codes, rendered = diagnose("# a\n" * 300_000, "long.pirl")
    assert codes == ["E0107"]
    assert rendered == (
        "error[E0107]: the file is too long: 1200000 characters, where 1000000 are allowed"
    )


@pytest.mark.parametrize("code", CODES)
def test_explanation(code: str) -> None:
    """The page's first block is wrong in just this way, and the second is right."""
    page = (resources.explanations() / f"{code}.md").read_text(encoding="utf-8")
    assert page.startswith(f"# {code}: ")
    wrong, right = re.findall(r"```pirl\n(.*?)```", page, flags=re.DOTALL)
    assert "Wrong:\n\n```pirl\n" in page
    assert "Right:\n\n```pirl\n" in page
    if code in NEEDS_A_LONG_FILE:
        wrong *= 20_000
    codes, _ = diagnose(wrong, "wrong.pirl")
    assert code in codes
    codes, rendered = diagnose(right, "right.pirl")
    assert codes == [], rendered
