"""What the printers of all targets share: texts with their precedence, comment-safe text."""

from __future__ import annotations

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


def indented(lines: Iterable[str], levels: int = 1) -> list[str]:
    return ["    " * levels + line if line else line for line in lines]
