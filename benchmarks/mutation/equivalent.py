"""Mutants that no test can tell from the original, by hand and with the reason.

equivalent.toml has them by their content; one that matches no mutant any more is an error, so that
the list cannot outlive what it is about.
"""

from __future__ import annotations

import tomllib
from collections.abc import Collection
from pathlib import Path

from benchmarks.mutation.mutants import Key

PLACE = Path(__file__).with_name("equivalent.toml")


def equivalents(place: Path = PLACE) -> dict[Key, str]:
    """The reason why each is equivalent."""
    listed = tomllib.loads(place.read_text(encoding="utf-8")).get("mutant", [])
    return {
        (m["file"], m["within"], m["was"], m["becomes"], m.get("number", 1)): m["because"]
        for m in listed
    }


def stale(listed: Collection[Key], made: Collection[Key]) -> list[Key]:
    """Those that are listed, but are no mutants."""
    return [key for key in listed if key not in made]
