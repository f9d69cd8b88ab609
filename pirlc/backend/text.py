"""What the printers of all targets share: texts with their precedence, comment-safe text."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from dataclasses import dataclass

from pirlc.ir.operators import Operator


@dataclass(frozen=True, slots=True)
class Text:
    """Printed code and how tightly it binds; both C and Python are printed with these levels."""

    code: str
    level: int

    def at(self, level: int) -> str:
        """The code as an operand that must bind at least as tightly."""
        return self.code if self.level >= level else f"({self.code})"


SELECT, OR, AND, NOT, COMPARE, SUM, PRODUCT, NEGATION, PRIMARY = range(1, 10)

INFIX_LEVELS: dict[Operator, int] = {
    Operator.LESS: COMPARE,
    Operator.LESS_EQUAL: COMPARE,
    Operator.GREATER: COMPARE,
    Operator.GREATER_EQUAL: COMPARE,
    Operator.EQUAL: COMPARE,
    Operator.NOT_EQUAL: COMPARE,
    Operator.ADD: SUM,
    Operator.SUBTRACT: SUM,
    Operator.MULTIPLY: PRODUCT,
    Operator.DIVIDE: PRODUCT,
}
"""Operators that C and Python write alike, grouping from the left as the language does."""


def infix(operator: Operator, left: Text, right: Text) -> Text:
    """`left op right`. Comparisons never chain, so their operands bind tighter."""
    level = INFIX_LEVELS[operator]
    first = left.at(level + 1 if level == COMPARE else level)
    return Text(f"{first} {operator.value} {right.at(level + 1)}", level)


def number(code: str) -> Text:
    return Text(code, NEGATION if code.startswith("-") else PRIMARY)


def negated(operand: Text) -> Text:
    code = operand.at(NEGATION)
    return Text(f"-({code})" if code.startswith("-") else f"-{code}", NEGATION)


def comment_lines(text: str) -> list[str]:
    """The text as lines that are safe in a comment of C or Python.

    Only printable ASCII is left; what would end a C comment, open another, join lines or spell a
    trigraph is broken up. A program's text holds strings from elsewhere.
    """
    lines = []
    for line in text.split("\n"):
        printable = "".join(
            c if " " <= c <= "~" else "    " if c == "\t" else c.encode("unicode_escape").decode()
            for c in line
        )
        for found, broken in (("*/", "* /"), ("/*", "/ *"), ("??", "? ?")):
            while found in printable:
                printable = printable.replace(found, broken)
        printable = printable.rstrip()
        lines.append(f"{printable} ." if printable.endswith("\\") else printable)
    while lines and not lines[-1]:
        lines.pop()
    return lines


WIDTH = 100
"""Columns of emitted code; a single long word may stand out."""


def wrapped_c(line: str) -> list[str]:
    """A line of C on as many lines as it takes; C lets any blank be a line end."""
    indent = line[: len(line) - len(line.lstrip())]
    return _wrapped(line, indent, indent + "    ")


def wrapped_python(line: str) -> list[str]:
    """A statement of Python on as many lines as it takes, in parentheses where they are needed.

    Wraps the heads of `if` and `elif`, assignments to one name or from one, and `return`.
    """
    if len(line) <= WIDTH:
        return [line]
    indent = line[: len(line) - len(line.lstrip())]
    word, _, rest = line.strip().partition(" ")
    target, equals, value = line.strip().partition(" = ")
    if word in ("if", "elif"):
        assert rest.endswith(":")
        first, inside, last = f"{word} (", rest[:-1], "):"
    elif word == "return":
        first, inside, last = "return (", rest, ")"
    elif equals and value.startswith("self."):
        first, inside, last = "(", target, f") = {value}"
    elif equals:
        first, inside, last = f"{target} = (", value, ")"
    else:
        return [line]
    deeper = indent + "    "
    return [indent + first, *_wrapped(inside, deeper, deeper), indent + last]


def _wrapped(text: str, first: str, rest: str) -> list[str]:
    return textwrap.wrap(
        text.strip(),
        WIDTH,
        initial_indent=first,
        subsequent_indent=rest,
        break_long_words=False,
        break_on_hyphens=False,
    )


def indented(lines: Iterable[str], levels: int = 1) -> list[str]:
    return ["    " * levels + line if line else line for line in lines]
