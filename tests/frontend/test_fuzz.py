"""Whatever the text: a sketch, or diagnostics. Nothing else ever comes out."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pirlc.diagnostics import PirlcError, as_json, render
from pirlc.frontend import check, format_source
from pirlc.source import SourceText

SAMPLES = [
    file.read_text(encoding="utf-8")
    for folder in (Path(__file__).parent / "samples", Path(__file__).parents[1] / "diagnostics")
    for file in sorted(folder.glob("*.pirl"))
    if file.stat().st_size < 3_000
]
WORDS = sorted({word for text in SAMPLES for word in re.findall(r"\w+|[^\w\s]", text)})
TOKEN = re.compile(
    r'#[^\n]*|"(?:[^"\\\n]|\\.)*"|[^\W\d]\w*|[\d.]+(?:[eE][+-]?\d+)?|[<>=!]=|->|\S|\s+'
)


def survive(text: str) -> None:
    source = SourceText("fuzz.pirl", text)
    try:
        sketch, warnings = check(source)
    except PirlcError as error:
        found = error.diagnostics
    else:
        formatted = SourceText("formatted", format_source(source))
        assert check(formatted)[0] == sketch
        assert format_source(formatted) == formatted.text
        found = warnings
    for diagnostic in found:
        assert re.fullmatch(r"E0[1-4]\d\d", diagnostic.code)
        shown = render(diagnostic)
        assert all(c == "\n" or c.isprintable() for c in shown)
        as_json(diagnostic)


def mutated(text: str, rng: random.Random) -> str:
    """A few words left out, doubled, exchanged, replaced or cut, or a character changed."""
    tokens = TOKEN.findall(text)
    for _ in range(rng.randint(1, 4)):
        if not tokens:
            break
        i, j = rng.randrange(len(tokens)), rng.randrange(len(tokens))
        match rng.randrange(6):
            case 0:
                del tokens[i]
            case 1:
                tokens.insert(j, tokens[i])
            case 2:
                tokens[i], tokens[j] = tokens[j], tokens[i]
            case 3:
                tokens[i] = rng.choice(WORDS)
            case 4:
                tokens = tokens[:i]
            case 5:
                tokens[i] = tokens[i][:-1] + chr(
                    rng.choice((0, 9, 34, 92, 127, 233, 0x2028, 0x1F600))
                )
    return "".join(tokens)


@given(st.text(max_size=200))
@settings(max_examples=60, deadline=None)
def test_any_characters(text: str) -> None:
    survive(text)


@given(st.binary(max_size=200))
@settings(max_examples=40, deadline=None)
def test_any_bytes(data: bytes) -> None:
    survive(data.decode("utf-8", errors="replace"))
    survive(data.decode("latin-1"))


@given(st.lists(st.sampled_from(WORDS), max_size=60))
@settings(max_examples=100, deadline=None)
def test_any_words(words: list[str]) -> None:
    survive("policy p\naction A : [0, 1] = " + " ".join(words))


@given(st.sampled_from(SAMPLES), st.randoms(use_true_random=False))
@settings(max_examples=150, deadline=None)
def test_mutated_files(text: str, rng: random.Random) -> None:
    survive(mutated(text, rng))


@pytest.mark.slow
def test_many_mutated_files() -> None:
    for seed in range(15_000):
        rng = random.Random(seed)
        survive(mutated(rng.choice(SAMPLES), rng))


@pytest.mark.parametrize(
    "name",
    [
        'x; system("rm -rf /")',
        'x"); //',
        "../../etc",
        "naïve",
        "__init__",
        "a\nb",
        "a\x00b",
        "x" * 65,
        "π",
    ],
)
def test_names_shaped_like_attacks(name: str) -> None:
    with pytest.raises(PirlcError):
        check(SourceText("t", f"policy {name}\naction A : [0, 1] = 1\n"))
    survive(f"policy p\nparam {name} = 1\naction {name} : [0, 1] = {name}\n")
