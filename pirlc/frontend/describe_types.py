"""E03xx in words: types."""

from __future__ import annotations

from typing import assert_never

from pirlc.diagnostics import Diagnostic, Label
from pirlc.frontend import problems_types as problems
from pirlc.frontend.problems_types import TypeProblem
from pirlc.source import SourceText


def describe_type(problem: TypeProblem, source: SourceText) -> Diagnostic:
    match problem:
        case problems.TypeMismatch(span, expected, found, role, help_):
            return Diagnostic(
                "E0301",
                f"{role} must be {_article(expected)}",
                source,
                Label(span, f"this is {_article(found)}"),
                help=help_,
            )
        case problems.LengthMismatch(span, left, left_length, right, right_length):
            return Diagnostic(
                "E0302",
                f"sequences of {left_length} and of {right_length} cannot be combined",
                source,
                Label(span, "element by element, so the lengths must be equal"),
                (
                    Label(left, f"sequence of {left_length}"),
                    Label(right, f"sequence of {right_length}"),
                ),
            )
        case problems.IndexOutside(span, index, length, sequence):
            advice = "-1 is the most recent element, -2 the one before"
            if index < 0:
                advice = f"use {-length} to -1, or declare a longer `window`"
            return Diagnostic(
                "E0303",
                f"the index {index} is outside a sequence of {length}",
                source,
                Label(span, f"must be from {-length} to -1"),
                (Label(sequence, f"sequence of {length}"),),
                help=advice,
            )
        case problems.IndexNotLiteral(span):
            return Diagnostic(
                "E0304",
                "the index of `peek` must be a whole number",
                source,
                Label(span, "written out, such as -1"),
            )
        case problems.NotAValue(span, text, values):
            listed = ", ".join(map(str, values))
            return Diagnostic(
                "E0305",
                f"{text} is not one of the action's values",
                source,
                Label(span, f"must be one of {listed}"),
            )
        case problems.BranchNotAtom(span, found):
            return Diagnostic(
                "E0306",
                f"an `if` cannot choose between values of type {found}",
                source,
                Label(span, "its branches must be single values"),
                help="choose after `peek` or `fold`, inside which sequences become single values",
            )
        case problems.NotFoldable(span, text):
            shown = text if text == "an expression" else f"`{text}`"
            return Diagnostic(
                "E0307",
                f"`fold` does not take {shown}",
                source,
                Label(span, "must be `+`, `*`, `min`, `max` or a lambda"),
                help="any other: `fold(\\v acc -> expression, sequence, initial)`",
            )
        case problems.DiffTooShort(span):
            return Diagnostic(
                "E0308",
                "`diff` needs at least two elements",
                source,
                Label(span, "of a sequence of 1"),
                help="declare a longer `window`",
            )
        case problems.Incomparable(span, left, left_type, right, right_type):
            return Diagnostic(
                "E0309",
                "values of different types cannot be equal",
                source,
                Label(span),
                (Label(left, left_type), Label(right, right_type)),
            )
        case problems.RawOfDiscrete(span, name):
            return Diagnostic(
                "E0310",
                f"the discrete action `{name}` has no raw value",
                source,
                Label(span, "only continuous actions are clipped"),
                help=f"write `{name}`",
            )
        case _:
            assert_never(problem)


def _article(type_: str) -> str:
    return type_ if type_.startswith("one of") else f"a {type_}"
