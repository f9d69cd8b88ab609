"""What a mutant is, and how it is told from others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import PurePosixPath

Key = tuple[str, str, str, str, int]
"""File, place in it, the lines that were, the lines that are, and which of several such."""


@dataclass(frozen=True)
class Mutant:
    """One planted fault.

    `path` is relative to the tree; `line` counts from 1; `within` names the function around;
    `text` is the whole mutated file. `was` and `becomes` are the lines that differ, without their
    indentation: with `within` they tell mutants apart however the rest of the file changes, and
    `number` counts those that are still alike.
    """

    path: PurePosixPath
    line: int
    within: str
    fault: str
    was: str
    becomes: str
    text: str
    number: int = 1

    @property
    def key(self) -> Key:
        return (str(self.path), self.within, self.was, self.becomes, self.number)

    @staticmethod
    def of(path: PurePosixPath, within: str, fault: str, before: str, after: str) -> Mutant:
        """The mutant that makes `after` of a file's text; they must differ."""
        line, was, becomes = _changed_lines(before, after)
        return Mutant(path, line, within, fault, was, becomes, after)


def _changed_lines(before: str, after: str) -> tuple[int, str, str]:
    """The first line that differs (from 1), and the differing lines of both texts, stripped."""
    old, new = before.splitlines(), after.splitlines()
    start, shorter = 0, min(len(old), len(new))
    while start < shorter and old[start] == new[start]:
        start += 1
    end = 0
    while end < shorter - start and old[-1 - end] == new[-1 - end]:
        end += 1
    return start + 1, _stripped(old[start : len(old) - end]), _stripped(new[start : len(new) - end])


def _stripped(lines: list[str]) -> str:
    return "\n".join(line.strip() for line in lines)


def distinct(mutants: Iterable[Mutant]) -> list[Mutant]:
    """Each text once, with mutants that look alike numbered in the order of the file."""
    seen: set[str] = set()
    alike: Counter[Key] = Counter()
    result = []
    for mutant in sorted(mutants, key=lambda m: m.line):
        if mutant.text in seen:
            continue
        seen.add(mutant.text)
        alike[mutant.key] += 1
        result.append(replace(mutant, number=alike[mutant.key]))
    return result
