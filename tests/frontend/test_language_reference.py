"""The language reference says what the compiler does."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pirlc.frontend import check, explain
from pirlc.frontend.declare import DISCRETE_LIMIT, NAME_LIMIT, WINDOW_LIMIT
from pirlc.frontend.instances import INSTANCE_LIMIT
from pirlc.frontend.parse import DEPTH_LIMIT, LENGTH_LIMIT
from pirlc.frontend.scope import FUNCTIONS
from pirlc.frontend.slips import KEYWORDS
from pirlc.frontend.tables import parser
from pirlc.source import SourceText

PAGE = (Path(__file__).parents[2] / "docs" / "language.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```pirl\n(.*?)```", PAGE, flags=re.DOTALL)


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.split("policy ")[1].split()[0])
def test_examples_check_without_a_warning(block: str) -> None:
    assert check(SourceText("language.md", block))[1] == ()


def test_there_are_examples() -> None:
    assert len(BLOCKS) >= 7


def test_keywords_are_all_listed() -> None:
    listed = re.search(r"cannot be names:\n\n((?:    .*\n)+)", PAGE)
    assert listed is not None
    assert set(listed.group(1).split()) == KEYWORDS
    in_grammar = {
        str(t.pattern.value) for t in parser().terminals if t.pattern.value.isidentifier()
    }
    assert in_grammar == KEYWORDS


def test_functions_are_all_listed() -> None:
    listed = re.search(r"built-in functions: `([a-z ]+)`", PAGE)
    assert listed is not None
    assert set(listed.group(1).split()) == FUNCTIONS


def test_limits() -> None:
    for limit in (LENGTH_LIMIT, NAME_LIMIT, WINDOW_LIMIT, DEPTH_LIMIT, INSTANCE_LIMIT):
        assert f"| {limit:,} " in PAGE or f"| {limit:,} |" in PAGE
    assert str(DISCRETE_LIMIT) in PAGE


def test_explain() -> None:
    assert (explain("E0303") or "").startswith("# E0303: ")
    assert explain("e0303") == explain("E0303")
    assert explain("E9999") is None
    assert explain("../../README") is None
