"""From text to the syntax tree, or to all syntax errors that can be told apart.

A file is read as a whole. Where that fails, the declaration at fault is blanked out (keeping every
position) and the rest is read again, so that one run reports the first mistake of each
declaration.
"""

from __future__ import annotations

import math
import re

from lark.exceptions import UnexpectedCharacters, UnexpectedEOF, UnexpectedInput, UnexpectedToken

from pirlc.diagnostics import PirlcError
from pirlc.frontend import problems_syntax as problems
from pirlc.frontend import syntax
from pirlc.frontend.build import build
from pirlc.frontend.describe import describe
from pirlc.frontend.problems import Collector
from pirlc.frontend.tables import parser
from pirlc.source import SourceText, Span

LENGTH_LIMIT = 1_000_000
DEPTH_LIMIT = 200
ERROR_LIMIT = 20

_COMMENT_OR_TEXT = r'#[^\n]*|"(?:[^"\\\n]|\\.)*"'
_DECLARATION = (
    r"\b(?:policy|environment|sensor|window|sample_time|latency|fill|param|action|rule|property)\b"
)
_LANDMARKS = re.compile(f"{_COMMENT_OR_TEXT}|{_DECLARATION}")


def parse(source: SourceText) -> syntax.SyntaxTree:
    """The syntax tree of a text. Raises `PirlcError` with E01xx diagnostics."""
    collector = Collector()
    declarations: tuple[syntax.Declaration, ...] = ()
    if len(source.text) > LENGTH_LIMIT:
        collector.add(problems.FileTooLong(len(source.text), LENGTH_LIMIT))
    else:
        declarations = _declarations(source.text, collector)
    if collector.found:
        raise PirlcError(describe(found, source) for found in collector.found)
    return syntax.SyntaxTree(declarations, _comments(source.text))


def _declarations(text: str, collector: Collector) -> tuple[syntax.Declaration, ...]:
    starts = [m.start() for m in _LANDMARKS.finditer(text) if m.group()[0] not in '#"']
    for _ in range(ERROR_LIMIT):
        try:
            tree = parser().parse(text)
        except UnexpectedInput as error:
            start, end = _at_fault(text, starts, _report(text, error, collector))
            text = text[:start] + re.sub(r"[^\n]", " ", text[start:end]) + text[end:]
        else:
            declarations, numbers = build(tree)
            _check(declarations, numbers, collector)
            return declarations
    return ()


def _report(text: str, error: UnexpectedInput, collector: Collector) -> int:
    """Add the problem for lark's error; the offset where reading stopped."""
    from pirlc.frontend.slips import explain_character, explain_token  # only mistakes pay for it

    match error:
        case UnexpectedCharacters():
            offset = error.pos_in_stream or 0
            collector.add(explain_character(text, offset))
            return offset
        case UnexpectedToken(token=token) if token.type != "$END":
            offset = token.start_pos or 0
            collector.add(explain_token(text, token, frozenset(error.accepts or error.expected)))
            return offset
        case UnexpectedToken() | UnexpectedEOF():
            accepts = frozenset(getattr(error, "accepts", None) or error.expected)
            collector.add(explain_token(text, None, accepts))
            return len(text)
        case _:
            raise error


def _at_fault(text: str, starts: list[int], offset: int) -> tuple[int, int]:
    """The extent of the declaration that reading stopped in."""
    end = next((s for s in starts if s > offset), len(text))
    if offset in starts and text[:offset].strip():
        # A declaration came too early: the one before it is not finished.
        end = offset
    start = max((s for s in starts if s < offset and text[s] != " "), default=0)
    return start, max(end, start + 1)


def _comments(text: str) -> tuple[syntax.Comment, ...]:
    found = []
    for match in re.finditer(_COMMENT_OR_TEXT, text):
        if match.group().startswith("#"):
            line_start = text.rfind("\n", 0, match.start()) + 1
            own_line = not text[line_start : match.start()].strip()
            span = Span(*match.span())
            found.append(syntax.Comment(match.group().rstrip(), own_line, span))
    return tuple(found)


def _check(
    declarations: tuple[syntax.Declaration, ...],
    numbers: tuple[syntax.Number, ...],
    collector: Collector,
) -> None:
    for number in numbers:
        if not math.isfinite(number.value):
            collector.add(problems.NotFinite(number.span, number.text))
    for declaration in declarations:
        for expression in syntax.expressions(declaration):
            _check_depth(expression, collector)


def _check_depth(expression: syntax.Expression, collector: Collector) -> None:
    # With a stack of its own: this is what protects the recursive passes after it.
    waiting = [(expression, 1)]
    while waiting:
        node, depth = waiting.pop()
        if depth > DEPTH_LIMIT:
            collector.add(problems.TooDeep(node.span, DEPTH_LIMIT))
            return
        waiting.extend((child, depth + 1) for child in syntax.children(node))
