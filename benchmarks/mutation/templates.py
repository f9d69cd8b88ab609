"""Mutants of a template: lines and blocks lost, conditions turned, code changed.

Of comments only the lines that tell something of the program are touched.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import PurePosixPath

from benchmarks.mutation.code_text import Language, faults
from benchmarks.mutation.mutants import Mutant, distinct

_TAG = re.compile(r"{%\s*(\w+)\s*(.*?)\s*%}")
_EXPRESSION = re.compile(r"{{\s*(.*?)\s*}}")
_INLINE_CHOICE = re.compile(r"( if )([^{}]*?)( else )")


def template_mutants(path: PurePosixPath, text: str, language: Language) -> list[Mutant]:
    """Every mutant, in the order of the file."""
    lines = text.splitlines(keepends=True)
    comments = _comments(lines, language)
    made: list[Mutant] = []

    def add(fault: str, first: int, last: int, *new: str) -> None:
        """Lines first to last (the last not included) replaced."""
        mutated = "".join([*lines[:first], *new, *lines[last:]])
        if mutated != text:
            made.append(Mutant.of(path, _within(lines, first), fault, text, mutated))

    values = [m[1] for line in lines for m in _EXPRESSION.finditer(line) if m[1] != "name"]
    for number, line in enumerate(lines):
        tag = _TAG.search(line)
        if tag and line.strip() == tag[0]:
            for fault, last, new in _tag_faults(lines, number, tag):
                add(fault, number, last, *new)
            continue
        told = any(m[1] != "name" for m in _EXPRESSION.finditer(line))
        if not line.strip() or (comments[number] and not told):
            continue
        add("line lost", number, number + 1)
        if comments[number]:
            continue
        for fault, new_line in [*_inline_faults(line, values), *faults(line, language)]:
            add(fault, number, number + 1, new_line)
    return distinct(made)


def _tag_faults(
    lines: list[str], number: int, tag: re.Match[str]
) -> Iterator[tuple[str, int, list[str]]]:
    """The fault, the line after the last that it replaces, and the new lines."""
    word, rest = tag[1], tag[2]
    if word == "if":
        yield "block lost", _end(lines, number) + 1, []
        for new in (f"not ({rest})", "true", "false"):
            changed = lines[number].replace(tag[0], f"{{% if {new} %}}")
            yield "condition", number + 1, [changed]
    elif word == "for":
        yield "block lost", _end(lines, number) + 1, []
        for new in ("[1:]", "[:-1]", " | reverse"):
            changed = lines[number].replace(tag[0], f"{{% for {rest}{new} %}}")
            yield "loop", number + 1, [changed]


def _end(lines: list[str], start: int) -> int:
    """The line that ends the block which begins on a line."""
    depth = 0
    for number in range(start, len(lines)):
        tag = _TAG.search(lines[number])
        if tag and tag[1] in ("if", "for"):
            depth += 1
        elif tag and tag[1] in ("endif", "endfor"):
            depth -= 1
            if depth == 0:
                return number
    raise ValueError(f"the block on line {start + 1} has no end")


def _inline_faults(line: str, values: list[str]) -> Iterator[tuple[str, str]]:
    for match in _EXPRESSION.finditer(line):
        inside = match[1]

        def with_expression(new: str, span: tuple[int, int] = match.span(1)) -> str:
            return line[: span[0]] + new + line[span[1] :]

        if inside in values:
            others = [value for value in values if value != inside]
            following = values[values.index(inside) + 1 :]
            new = next((value for value in following if value != inside), others[0])
            yield "another value", with_expression(new)
        if "loop.index0" in inside:
            yield "index", with_expression(inside.replace("loop.index0", "loop.index"))
            yield "index", with_expression("0")
        for choice in _INLINE_CHOICE.finditer(inside):
            before, after = inside[: choice.start()], inside[choice.end() :]
            yield "condition", with_expression(f"{before} if not ({choice[2]}) else {after}")


def _comments(lines: list[str], language: Language) -> list[bool]:
    """For each line, whether it is a comment, or part of a docstring, as a whole."""
    result, inside = [], False
    for line in lines:
        code = line.strip()
        if language == "c":
            opens, closes = code.rfind("/*"), code.rfind("*/")
            whole = code.startswith("/*") and (closes < 0 or code.endswith("*/"))
            result.append(inside or whole)
            if opens != closes:
                inside = opens > closes
        else:
            quotes = code.count('"""')
            result.append(inside or bool(quotes) or code.startswith("#"))
            inside = inside != (quotes == 1)
    return result


def _within(lines: list[str], number: int) -> str:
    """The nearest line before, or this one, that begins a function or a declaration."""
    for line in reversed(lines[: number + 1]):
        if line.startswith(("BRIDGE", "unsigned", "void", "typedef", "const", "class")) or (
            line.strip().startswith("def ")
        ):
            words = re.sub(r"{{\s*name\s*}}_?", "", line).partition("(")[0].split()
            return words[-1].strip("*:;{=") if words else ""
    return ""
