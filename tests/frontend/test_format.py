"""`pirlc fmt`: one layout, comments kept, the meaning unchanged, nothing left to do twice."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest

from pirlc.frontend import check, format_source
from pirlc.frontend.format import _clean
from pirlc.source import SourceText

SAMPLES = sorted((Path(__file__).parent / "samples").glob("*.pirl"))
TOKEN = re.compile(
    r'#[^\n]*\n|"(?:[^"\\\n]|\\.)*"|[^\W\d]\w*|[\d.]+(?:[eE][+-]?\d+)?|[<>=!]=|->|\S'
)


def comments(text: str) -> list[str]:
    found = [token for token in TOKEN.findall(text + "\n") if token.startswith("#")]
    return sorted(word for comment in found for word in _clean(comment).split())


@pytest.mark.parametrize("file", SAMPLES, ids=lambda file: file.stem)
def test_samples(file: Path) -> None:
    source = SourceText(file.name, file.read_text(encoding="utf-8"))
    formatted = SourceText(file.name, format_source(source))
    assert format_source(formatted) == formatted.text
    assert check(formatted)[0] == check(source)[0]
    assert comments(formatted.text) == comments(source.text)
    assert max(map(len, formatted.text.split("\n"))) <= 110


@pytest.mark.parametrize("file", SAMPLES, ids=lambda file: file.stem)
def test_whatever_the_spacing_and_the_comments(file: Path) -> None:
    """Between any two words may be a space, a line end, or a comment."""
    tokens = TOKEN.findall(file.read_text(encoding="utf-8"))
    rng = random.Random(0)
    for round_ in range(20):
        text = "".join(
            token
            if token.startswith("#")
            else token + rng.choice((" ", " ", "\n", "\n\n", f" # c{i}\n", f"\n# o{i}\n"))
            for i, token in enumerate(tokens)
        )
        source = SourceText(f"{file.stem}-{round_}", text)
        once = SourceText("once", format_source(source))
        assert format_source(once) == once.text
        assert check(once)[0] == check(source)[0]
        assert comments(once.text) == comments(text)


def test_layout() -> None:
    source = """#title
policy   p   # name


sensor a : [ -1,1 ] = 0   # first
sensor long_name : [0, 100] = 1

sensor b : [0,1]=2
action A:[-1,1] safe 0 = if peek(a,-1)>0 # up
   then 1
   # level
   else if peek(b,-1)>0 then 2 else 0
rule R=|1 # one
 |R+R
action B : [-1,1] = 1 = ( R )
"""
    assert (
        format_source(SourceText("t", source))
        == """# title
policy p  # name

sensor a         : [-1, 1]  = 0  # first
sensor long_name : [0, 100] = 1

sensor b : [0, 1] = 2
action A : [-1, 1] safe 0 = if peek(a, -1) > 0  # up
                            then 1
                            # level
                            else if peek(b, -1) > 0 then 2
                            else 0
rule R = 1  # one
       | R + R
action B : [-1, 1] = 1 = (R)
"""
    )


def test_only_comments_and_nothing() -> None:
    assert format_source(SourceText("t", "")) == ""
    assert format_source(SourceText("t", "\n\n#a\n\n\n#b")) == "# a\n\n# b\n"
