"""Laying out expressions as text: line breaks, indentation, parentheses.

A small document language (after Wadler's "A prettier printer") and, on top of it, one combinator
for each kind of expression. The printer of terms and the formatter of files both build their text
with these, so there is one layout.

::

    Document = Text | Remark | Line | Together of Document* | Group of Document
             | Align of Document | Indent of Document
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import assert_never

from pirlc.ir.operators import SIGNATURES, Operator

WIDTH = 100
"""The longest line, in characters, where a line can be broken at all."""


@dataclass(frozen=True, slots=True)
class Text:
    """Text without a line end; `at` is its offset in the source, where comments may belong."""

    text: str
    at: int | None = None


@dataclass(frozen=True, slots=True)
class Remark:
    """A comment: on a line of its own, or ending the line that it stands on."""

    text: str
    own_line: bool


@dataclass(frozen=True, slots=True)
class Line:
    """A space (or nothing), or a line end where the group around it does not fit on a line."""

    flat: str = " "


@dataclass(frozen=True, slots=True)
class Together:
    parts: tuple[Document, ...]


@dataclass(frozen=True, slots=True)
class Group:
    """Broken at all its own lines or at none."""

    inner: Document


@dataclass(frozen=True, slots=True)
class Align:
    """Lines inside start at the column where this starts."""

    inner: Document


@dataclass(frozen=True, slots=True)
class Indent:
    """Lines inside start at a column counted from the left margin."""

    inner: Document
    column: int


Document = Text | Remark | Line | Together | Group | Align | Indent


def together(*parts: Document | str) -> Together:
    return Together(tuple(Text(part) if isinstance(part, str) else part for part in parts))


def render(
    document: Document, *, width: int = WIDTH, remarks: Sequence[tuple[int, Remark]] = ()
) -> str:
    """The document as text, without a final line end, in lines of at most `width` if possible.

    `remarks` are comments and their offsets, in the order of the source: each is put before the
    first text that came after it, or at the end.
    """
    out: list[str] = []
    comments = list(remarks)[::-1]
    column = 0
    must_break = False
    # Frames: the column that lines start at, whether the group around is flat, the document.
    stack: list[tuple[int, bool, Document]] = [(0, False, document)]

    def newline(indent: int) -> None:
        nonlocal column, must_break
        if out and out[-1] == " ":
            out.pop()
        out.append("\n" + " " * indent)
        column, must_break = indent, False

    while stack:
        indent, flat, current = stack.pop()
        match current:
            case Text(_, at) if at is not None and comments and comments[-1][0] < at:
                stack.append((indent, flat, current))
                stack.append((indent, flat, comments.pop()[1]))
            case Text(text):
                if must_break and text:
                    newline(indent)
                    text = text.lstrip()
                out.append(text)
                column += len(text)
            case Remark(text, own_line):
                while out and out[-1] == " ":
                    out.pop()
                broken = bool(out) and out[-1].startswith("\n")
                if broken and not own_line and not must_break and len(out) > 1:
                    # The line was ended too early: the comment belongs to the words before.
                    end = out.pop()
                    out.extend(("  ", text, end))
                    continue
                if must_break or (own_line and out and not broken):
                    newline(indent)
                elif not own_line and out:
                    out[-1] = out[-1].rstrip(" ")
                    out.append("  ")
                out.append(text)
                must_break = True
            case Line(between):
                if flat and not must_break:
                    out.append(between)
                    column += len(between)
                else:
                    newline(indent)
            case Together(parts):
                stack.extend((indent, flat, part) for part in reversed(parts))
            case Group(inner):
                offset = comments[-1][0] if comments else None
                fits = flat or _fits(inner, stack, width - column, offset)
                stack.append((indent, fits, inner))
            case Align(inner):
                stack.append((column, flat, inner))
            case Indent(inner, start):
                stack.append((start, flat, inner))
            case _:
                assert_never(current)
        if not stack and comments:
            stack.append((0, False, comments.pop()[1]))
    return "\n".join(line.rstrip() for line in "".join(out).split("\n"))


def _fits(
    document: Document,
    rest: Sequence[tuple[int, bool, Document]],
    room: int,
    comment: int | None,
) -> bool:
    """Whether `document`, flat, and what follows it up to the next line end fit in `room`.

    `comment` is the offset of the next comment. It ends its line: a group with one inside has to
    be broken.
    """
    waiting: list[tuple[bool, Document]] = [(True, document)]
    following = len(rest)
    while room >= 0:
        if not waiting:
            if following == 0:
                return True
            following -= 1
            # What follows an unbroken group belongs to groups that are broken.
            waiting.append((False, rest[following][2]))
        flat, current = waiting.pop()
        match current:
            case Text(text, at):
                if comment is not None and at is not None and comment < at:
                    return following < len(rest)
                room -= len(text)
            case Remark():
                return following < len(rest)
            case Line(between):
                if not flat:
                    return True
                room -= len(between)
            case Together(parts):
                waiting.extend((flat, part) for part in reversed(parts))
            case Group(inner) | Align(inner) | Indent(inner):
                waiting.append((flat, inner))
            case _:
                assert_never(current)
    return False


# Expressions.


@dataclass(frozen=True)
class Piece:
    """An expression's document and what it takes to stand beside operators.

    `precedence` is that of its outermost operator (`SIGNATURES`; 0 for what extends as far right
    as it can, 9 for what needs no parentheses ever). `continued` is the document without its own
    alignment, for a longer chain of operators of one precedence or of `else if`s.
    """

    document: Document
    precedence: int = 9
    continued: Document | None = None


def word(text: str, at: int | None = None) -> Piece:
    """A name or a number; a negative number stands as a negation does."""
    return Piece(Text(text, at), SIGNATURES[Operator.NEGATE].precedence if text[0] == "-" else 9)


def grouped(piece: Piece, at: int | None = None) -> Piece:
    """The expression in parentheses."""
    return Piece(together(Text("(", at), piece.document, ")"))


def _operand(piece: Piece, least: int) -> Document:
    return piece.document if piece.precedence >= least else grouped(piece).document


def infix(operator: Operator, left: Piece, right: Piece, at: int | None = None) -> Piece:
    """`left operator right`, broken before the operator."""
    precedence = SIGNATURES[operator].precedence
    comparison = SIGNATURES[Operator.LESS].precedence
    to_right = operator is Operator.IMPLIES
    least_left = precedence + (to_right or precedence == comparison)
    least_right = precedence + (not to_right)
    chained = left.precedence == precedence and left.continued is not None and not to_right
    first = left.continued if chained and left.continued else _operand(left, least_left)
    tail = right.continued if to_right and right.precedence == precedence else None
    last = Group(
        together(Line(), Text(operator.value, at), " ", tail or _operand(right, least_right))
    )
    body = together(first, last)
    return Piece(Align(body), precedence, body)


def prefix(operator: Operator, operand: Piece, at: int | None = None) -> Piece:
    """`not x` or `-x`; a number under `-` keeps parentheses, or it would be a literal."""
    precedence = SIGNATURES[operator].precedence
    if operator is Operator.NOT:
        return Piece(together(Text("not", at), " ", _operand(operand, precedence)), precedence)
    return Piece(together(Text("-", at), _operand(operand, precedence)), precedence)


def call(name: str, arguments: Iterable[Piece], at: int | None = None) -> Piece:
    """`name(argument, ...)`."""
    parts: list[Document] = []
    for argument in arguments:
        if parts:
            parts.extend((Text(","), Line()))
        parts.append(argument.document)
    return Piece(together(Text(name, at), "(", Group(Align(Together(tuple(parts)))), ")"))


def conditional(
    condition: Piece,
    consequent: Piece,
    alternative: Piece,
    at: tuple[int | None, int | None, int | None] = (None, None, None),
) -> Piece:
    """`if`, `then` and `else` (at offsets `at`) on one line, or each `else` on one of its own."""
    another = alternative.precedence == 0 and alternative.continued is not None
    body = together(
        Group(
            together(
                Text("if", at[0]),
                " ",
                Align(condition.document),
                Line(),
                Text("then", at[1]),
                " ",
                Align(consequent.document),
            )
        ),
        Line(),
        Text("else", at[2]),
        " ",
        alternative.continued if another and alternative.continued else alternative.document,
    )
    return Piece(Align(Group(body)), 0, body)


def binding(
    name: str,
    value: Piece,
    body: Piece,
    at: tuple[int | None, int | None] = (None, None),
) -> Piece:
    """`let name = value in body`; `at` are the offsets of `let` and the name."""
    head = together(
        Text("let", at[0]),
        " ",
        Text(name, at[1]),
        " = ",
        Align(value.document),
        " ",
        "in",
    )
    return Piece(Align(Group(together(head, Line(), body.document))), 0)


def lambda_(element: str, accumulator: str, body: Piece, at: int | None = None) -> Piece:
    r"""`\element accumulator -> body`."""
    return Piece(together(Text(f"\\{element} {accumulator} -> ", at), Align(body.document)), 0)


HEAD_LIMIT = 40
"""After a longer head than this, an expression that does not fit starts on the next line."""

ALTERNATIVES_LIMIT = 40
"""Alternatives share a line if it is no longer than this."""


def definition(head: str, bodies: Sequence[Piece], starts: Sequence[int] = ()) -> Document:
    """`head = body`, or `head = body | body | ...`; `starts` are the bodies' offsets, if known."""
    if len(bodies) == 1 and len(head) > HEAD_LIMIT:
        return Group(Indent(together(head, " =", Line(), bodies[0].document), 4))
    # A chain of operators continues below the `=`, so that its operands are aligned.
    first, *others = [
        body.continued if body.continued and body.precedence > 0 else body.document
        for body in bodies
    ]
    parts: list[Document] = [Text("= "), first]
    for start, other in zip_longest(starts[1:], others):
        parts.extend((Line(), Text("| ", start), other))
    all_bodies = Together(tuple(parts))
    if len(head) > HEAD_LIMIT:
        return Indent(together(head, Line(), all_bodies), 4)
    flat = render(Group(all_bodies), width=10 * WIDTH)
    short = len(head) + 1 + len(flat) <= (ALTERNATIVES_LIMIT if others else WIDTH)
    return together(head, " ", Align(Group(all_bodies) if short else all_bodies))


def braces(head: str, entries: Sequence[Document]) -> Document:
    """`head { entry, ... }`, or one entry a line."""
    if not entries:
        return Text(head)
    parts: list[Document] = [Line(), entries[0]]
    for entry in entries[1:]:
        parts.extend((Text(","), Line(), entry))
    return Group(together(head, " {", Indent(Together(tuple(parts)), 4), Line(), "}"))


def table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows of cells as lines whose columns are aligned."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        " ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def number_text(value: float) -> str:
    """The shortest text that reads back as the same (finite) number."""
    text = repr(value)
    return text.removesuffix(".0").replace("e+", "e").replace("e-0", "e-")
