"""E01xx in words: the text does not follow the grammar."""

from __future__ import annotations

from typing import assert_never

from pirlc.diagnostics import Diagnostic, Label
from pirlc.frontend import problems_syntax as problems
from pirlc.frontend.problems_syntax import SyntaxProblem
from pirlc.source import SourceText

_CLOSING = {"(": ")", "[": "]", "{": "}"}


def describe_syntax(problem: SyntaxProblem, source: SourceText) -> Diagnostic:
    match problem:
        case problems.UnknownCharacter(span, character):
            shown = character if character.isprintable() else f"U+{ord(character):04X}"
            advice = {
                ";": "declarations need nothing between them",
                "%": "there is no remainder operator",
                "@": "a name begins with a letter",
                "$": "a name begins with a letter",
            }.get(character)
            return Diagnostic(
                "E0101",
                f"the character `{shown}` has no meaning here",
                source,
                Label(span, "not part of the language"),
                help=advice,
            )
        case problems.Unexpected(span, found, expected, inside, help_):
            wanted = _listed(expected)
            where = f" in this `{inside}`" if inside else ""
            return Diagnostic(
                "E0102",
                f"expected {wanted}, found {found}" if wanted else f"{found} has no place here",
                source,
                Label(span, f"not expected{where}"),
                help=help_,
            )
        case problems.UnclosedText(span):
            return Diagnostic(
                "E0103",
                "the text in quotes does not end",
                source,
                Label(span, "begins here and runs to the end of the line"),
                help='close it with `"` on the same line',
            )
        case problems.UnclosedBracket(span, bracket, end):
            closing = _CLOSING[bracket]
            return Diagnostic(
                "E0104",
                f"`{bracket}` is not closed",
                source,
                Label(span, "opened here"),
                (Label(end, f"`{closing}` is missing before or at this place"),),
            )
        case problems.TooDeep(span, limit):
            return Diagnostic(
                "E0105",
                f"the expression is nested more than {limit} levels deep",
                source,
                Label(span, "the limit is passed here"),
                notes=("every operator of a chain such as `a + b + c` is a level",),
                help="split it with `let` or into rules; use `fold` for long sums",
            )
        case problems.NotFinite(span, text):
            shown = text if len(text) <= 24 else text[:21] + "..."
            return Diagnostic(
                "E0106",
                f"the number {shown} is too large",
                source,
                Label(span, "not finite in binary64"),
            )
        case problems.FileTooLong(length, limit):
            return Diagnostic(
                "E0107",
                f"the file is too long: {length} characters, where {limit} are allowed",
                source,
            )
        case problems.ForeignSpelling(span, written, meant):
            return Diagnostic(
                "E0108",
                f"`{written}` is not written so in this language",
                source,
                Label(span, f"write `{meant}`"),
                help=_spelling_help(written),
            )
        case problems.ChainedComparison(span, operator):
            return Diagnostic(
                "E0109",
                "comparisons cannot be chained",
                source,
                Label(span, "a second comparison"),
                help=f"write `a {operator} b and b {source.text[span.start : span.end]} c`",
            )
        case problems.IncompleteConditional(span, missing, opening):
            return Diagnostic(
                "E0110",
                f"this `if` has no `{missing}`",
                source,
                Label(span, f"expected `{missing}` here or before"),
                (Label(opening, "the `if`"),),
                help="write `if condition then value else value`: both branches are needed",
            )
        case _:
            assert_never(problem)


def _spelling_help(written: str) -> str | None:
    match written:
        case "=":
            return "`=` defines; `==` compares"
        case "//":
            return "a comment begins with `#`; one `/` divides"
        case "**" | "^":
            return "there is no power operator: multiply"
        case _:
            return None


def _listed(words: tuple[str, ...]) -> str:
    if len(words) <= 1:
        return "".join(words)
    return f"{', '.join(words[:-1])} or {words[-1]}"
