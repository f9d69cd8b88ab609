"""What the tools report and is left as it is, with the reason: the table of docs/assurance.md.

A report that no row allows is a finding. Rules of MISRA C:2012 are given by their number and in
words of our own; their texts are not part of cppcheck.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Report:
    """What a tool says about a place: `line` is the text there, `column` counts from 1.

    `statement` is the text from there to the next semicolon.
    """

    rule: str
    line: str
    column: int
    statement: str = ""


@dataclass(frozen=True)
class Deviation:
    """`random_only`: no example needs it, and none may. `where` narrows it down to some places."""

    tool: str
    rule: str
    says: str
    reason: str
    random_only: bool = False
    where: Callable[[Report], bool] = lambda _: True


def _at_choice(report: Report) -> bool:
    return report.line[report.column - 1 : report.column] in ("?", ":")


def _of_status_bit(report: Report) -> bool:
    return bool(re.match(r"#define \w+_(MISSING|OUT_OF_RANGE|SAFE_USED) ", report.line))


def _of_clipping(report: Report) -> bool:
    return "} else if (" in report.line


_CHOSEN_NUMBER = re.compile(r"\?\s-?\d+L*\s:\s-?\d+L*\s*;")

_ODD = "the random program says so, and the C keeps to its text"

DEVIATIONS = (
    Deviation(
        "cppcheck MISRA",
        "12.1",
        "precedence shown by parentheses",
        "false reports: every operand of `?:` is in parentheses, but cppcheck drops some before "
        "the add-on looks. Allowed at `?` and `:` only",
        where=_at_choice,
    ),
    Deviation(
        "cppcheck MISRA",
        "2.5",
        "a macro that is not used",
        "the names of the status bits are for the caller; not every controller sets every bit",
        where=_of_status_bit,
    ),
    Deviation(
        "cppcheck MISRA",
        "10.6",
        "a composite expression assigned to a wider type",
        "`condition ? 2 : 0` for a discrete action: both numbers are constants of type `int`, and "
        "so is the action; the add-on takes them for 8 bits wide",
        where=lambda report: bool(_CHOSEN_NUMBER.search(report.statement)),
    ),
    Deviation(
        "cppcheck MISRA",
        "10.4",
        "operands of one essential type",
        f"a comparison of two constants: {_ODD}",
        random_only=True,
    ),
    Deviation(
        "cppcheck",
        "multiCondition",
        "the second condition is always true",
        "the clipping of an action tells NaN, for which both comparisons are false; cppcheck "
        "leaves NaN out of account",
        where=_of_clipping,
    ),
    *(
        Deviation("cppcheck", rule, says, _ODD, random_only=True)
        for rule, says in (
            ("duplicateExpression", "an expression compared with, or taken from, itself"),
            ("duplicateExpressionTernary", "both sides of a choice are alike"),
            ("duplicateValueTernary", "both sides of a choice have one value"),
            ("oppositeExpression", "an expression compared with its negative"),
            ("duplicateBranch", "both sides of an `if` are alike"),
            ("knownConditionTrueFalse", "a condition that is always true or false"),
            ("invalidFunctionArg", "the root of a negative constant, which is NaN"),
        )
    ),
    Deviation(
        "clang-tidy",
        "misc-redundant-expression",
        "an expression compared with itself",
        _ODD,
        random_only=True,
    ),
    Deviation(
        "clang-tidy",
        "clang-analyzer-deadcode.DeadStores",
        "a value that is never read, since a condition always holds",
        _ODD,
        random_only=True,
    ),
    Deviation(
        "clang-tidy",
        "bugprone-branch-clone",
        "both sides of a choice alike",
        _ODD,
        random_only=True,
    ),
)

TIDY_OFF = (
    ("readability-magic-numbers", "ranges, window lengths and literals are the program's numbers"),
    ("readability-identifier-length", "`p`, `s`, `in`, `out` are the contract's names; `k` counts"),
    ("readability-uppercase-literal-suffix", "`u` and `f` cannot be taken for digits"),
    (
        "readability-function-cognitive-complexity",
        "a step is as complex as its program, whose size `pirlc check` tells",
    ),
)
"""Checks of clang-tidy's groups that are switched off, and why."""

_BY_RULE: dict[tuple[str, str], Deviation] = {(d.tool, d.rule): d for d in DEVIATIONS}


def allowed(tool: str, report: Report, is_example: bool) -> Deviation | None:
    """The row that allows the report."""
    deviation = _BY_RULE.get((tool, report.rule))
    if deviation is None or (deviation.random_only and is_example) or not deviation.where(report):
        return None
    return deviation
