"""What a syntax error is in words, with the common slips recognised.

lark says where reading stopped and which tokens it could have gone on with; here that becomes
what the writer most likely meant.
"""

from __future__ import annotations

import re

from lark import Token

from pirlc.diagnostics import suggestion
from pirlc.frontend import problems_syntax as problems
from pirlc.frontend.problems_syntax import SyntaxProblem
from pirlc.source import Span

KEYWORDS = frozenset(
    {
        "policy", "environment", "sensor", "missing", "window", "sample_time", "latency", "fill",
        "param", "action", "safe", "rule", "property", "over", "if", "then", "else", "let", "in",
        "and", "or", "not", "implies", "true", "false",
    }
)  # fmt: skip

_VALUE_START = frozenset({"NUMBER", "NAME", "LPAR", "QMARK"})
_INFIX = frozenset({"PLUS", "MINUS", "STAR", "SLASH", "AND", "OR", "IMPLIES"})
_COMPARISON = frozenset({"LESS", "LESS_EQUAL", "GREATER", "GREATER_EQUAL", "EQUAL", "NOT_EQUAL"})
_DECLARATION = frozenset(
    {
        "POLICY", "ENVIRONMENT", "SENSOR", "WINDOW", "SAMPLE_TIME", "LATENCY", "FILL", "PARAM",
        "ACTION", "RULE", "PROPERTY",
    }
)  # fmt: skip

_WORDS = {
    "ARROW": "`->`", "ASSIGN": "`=`", "BACKSLASH": "a lambda", "COLON": "`:`", "COMMA": "`,`",
    "ELSE": "`else`", "FALSE": "`false`", "IN": "`in`", "LBRACE": "`{`", "LPAR": "`(`",
    "LSQB": "`[`", "MISSING": "`missing`", "NAME": "a name", "NUMBER": "a number",
    "OVER": "`over`", "QMARK": "a hole", "RBRACE": "`}`", "RPAR": "`)`", "RSQB": "`]`",
    "SAFE": "`safe`", "STRING": "a text in double quotes", "THEN": "`then`", "TRUE": "`true`",
    "VBAR": "`|`", "MINUS": "a number",
}  # fmt: skip

_FOREIGN = {
    "&&": "and", "||": "or", "&": "and", "!": "not", ":=": "=", "=": "==", "<>": "!=",
    "=>": "implies",
    "**": "x * x", "%": "", "//": "#", "^": "x * x", "λ": "\\", "≤": "<=", "≥": ">=", "≠": "!=",
    "−": "-", "×": "*", "·": "*", "÷": "/", "∧": "and", "∨": "or", "¬": "not", "→": "->",
    "’": '"', "“": '"', "”": '"', "'": '"',
}  # fmt: skip

_OPENING, _CLOSING = "([{", {")": "(", "]": "[", "}": "{"}
_TOKEN = re.compile(r'#[^\n]*|"(?:[^"\\\n]|\\.)*"|[^\W\d]\w*|\d[\w.]*|[<>=!]=|->|\S')


def explain_character(text: str, offset: int) -> SyntaxProblem:
    """The problem of a character that begins no token."""
    for length in (2, 1):
        written = text[offset : offset + length]
        meant = _FOREIGN.get(written)
        if meant and len(written) == length and written != "=":
            return problems.ForeignSpelling(Span(offset, offset + length), written, meant)
    if text[offset] == '"':
        end = text.find("\n", offset)
        return problems.UnclosedText(Span(offset, len(text) if end < 0 else end))
    return problems.UnknownCharacter(Span(offset, offset + 1), text[offset])


def explain_token(text: str, token: Token | None, accepts: frozenset[str]) -> SyntaxProblem:
    """The problem of a token (None: the end of the file) where only `accepts` could stand."""
    at = len(text) if token is None else token.start_pos or 0
    before = [m for m in _TOKEN.finditer(text, 0, at) if not m.group().startswith("#")]
    span = _end_of_text(before) if token is None else Span(at, token.end_pos or at + 1)
    kind = "$END" if token is None else token.type
    declaration = _declaration_before(before)
    return (
        _foreign(text, at, before, accepts)
        or _conditional(span, kind, before[declaration:], accepts)
        or _bracket(span, kind, before[declaration:], accepts)
        or _chained(span, kind, before[declaration:], accepts)
        or problems.Unexpected(
            span,
            _found(token),
            _expected(accepts),
            before[declaration].group() if declaration < len(before) else None,
            _help(token, accepts),
        )
    )


def _end_of_text(before: list[re.Match[str]]) -> Span:
    end = before[-1].end() if before else 0
    return Span(max(0, end - 1), end)


def _declaration_before(before: list[re.Match[str]]) -> int:
    """The index of the last token that begins a declaration (or the number of tokens)."""
    for index in range(len(before) - 1, -1, -1):
        if before[index].group().upper() in _DECLARATION and before[index].group().islower():
            return index
    return len(before)


def _foreign(
    text: str, at: int, before: list[re.Match[str]], accepts: frozenset[str]
) -> SyntaxProblem | None:
    last = before[-1] if before else None
    touching = last is not None and last.end() == at
    # Two characters that are tokens of their own here: `||`, `=>`, `<>`, `**`, `//`, `:=`.
    for start in (at, at - 1):
        written = text[start : start + 2]
        if start >= 0 and written in _FOREIGN and (start == at or touching):
            return problems.ForeignSpelling(Span(start, start + 2), written, _FOREIGN[written])
    if text.startswith("=", at) and "ASSIGN" not in accepts and _after_operand(before):
        return problems.ForeignSpelling(Span(at, at + 1), "=", "==")
    if last is not None and last.group() in ("elif", "elseif", "elsif"):
        return problems.ForeignSpelling(Span(*last.span()), last.group(), "else if")
    word = re.compile(r"elif|elseif|elsif").match(text, at)
    if word and accepts & {"ELSE", "AND"}:
        return problems.ForeignSpelling(Span(*word.span()), word.group(), "else if")
    return None


def _after_operand(before: list[re.Match[str]]) -> bool:
    """Whether the text so far ends with an operand inside an expression."""
    words = [m.group() for m in before[_declaration_before(before) :]]
    if not words or words[0] not in ("action", "rule", "property") or "=" not in words:
        return False
    return words[-1] not in KEYWORDS and (words[-1] == ")" or words[-1][-1].isalnum())


def _conditional(
    span: Span, kind: str, before: list[re.Match[str]], accepts: frozenset[str]
) -> SyntaxProblem | None:
    missing = next((word for word in ("then", "else") if word.upper() in accepts), None)
    if missing is None or kind in _COMPARISON:
        return None
    # The innermost `if` that still lacks the word: count back over the finished ones.
    unfinished = 0
    closing = "then" if missing == "then" else "else"
    for match in reversed(before):
        if match.group() == closing:
            unfinished += 1
        elif match.group() == "if":
            if unfinished == 0:
                return problems.IncompleteConditional(span, missing, Span(*match.span()))
            unfinished -= 1
    return None


def _bracket(
    span: Span, kind: str, before: list[re.Match[str]], accepts: frozenset[str]
) -> SyntaxProblem | None:
    if not accepts & {"RPAR", "RSQB", "RBRACE"}:
        return None
    if (
        kind != "$END"
        and kind not in _DECLARATION
        and kind not in ("RPAR", "RSQB", "RBRACE", "VBAR")
    ):
        return None
    stack: list[re.Match[str]] = []
    for match in before:
        if match.group() in _OPENING:
            stack.append(match)
        elif match.group() in _CLOSING and stack:
            stack.pop()
    if not stack:
        return None
    opening = stack[-1]
    return problems.UnclosedBracket(Span(*opening.span()), opening.group(), span)


def _chained(
    span: Span, kind: str, before: list[re.Match[str]], accepts: frozenset[str]
) -> SyntaxProblem | None:
    # After `a < b` the reader could go on with `+` or `and`, but not with another comparison.
    if kind in _COMPARISON and "PLUS" in accepts and not accepts & _COMPARISON:
        written = next(
            (
                m.group()
                for m in reversed(before)
                if m.group() in ("<", "<=", ">", ">=", "==", "!=")
            ),
            "<",
        )
        return problems.ChainedComparison(span, written)
    return None


def _found(token: Token | None) -> str:
    if token is None:
        return "the end of the file"
    text = str(token)
    if text in KEYWORDS:
        return f"the keyword `{text}`"
    if token.type == "NUMBER":
        return f"the number `{text}`"
    if token.type == "STRING":
        return "a text in double quotes"
    return f"`{text if len(text) <= 40 else text[:37] + '...'}`"


def _expected(accepts: frozenset[str]) -> tuple[str, ...]:
    """What could have stood there, in words, most telling first."""
    if {"NUMBER", "NAME", "LPAR"} <= accepts:
        words = ["an expression"]
        if "VBAR" in accepts and "IF" in accepts:
            words.append("`|`")
        return (*words, *(["`)`"] if "RPAR" in accepts else []))
    words = []
    if accepts & {"PLUS", "AND"}:
        words.append("an operator")
        accepts = accepts - {"MINUS"}
    for terminal, word in _WORDS.items():
        if terminal in accepts and word not in words:
            words.append(word)
    if accepts >= _DECLARATION:
        words.append("a declaration")
    return tuple(words)


def _help(token: Token | None, accepts: frozenset[str]) -> str | None:
    if token is None:
        return None
    kind, text = token.type, str(token)
    wants_name = "NAME" in accepts and not accepts & {"NUMBER", "LPAR"}
    if text in KEYWORDS and wants_name:
        return f"`{text}` is a keyword; choose another name"
    if kind in ("IF", "LET") and accepts & _VALUE_START:
        return f"put parentheses around `{text} ...` where it is an operand"
    if kind == "PLUS" and "NUMBER" in accepts:
        return "a number is written without a `+` before it"
    if kind in ("TRUE", "FALSE") and "LPAR" in accepts:
        return "there are no truth literals: write a comparison, such as `0 < 1`"
    if kind == "NAME":
        keywords = sorted(word for word in KEYWORDS if word.upper() in accepts)
        close = suggestion(text, keywords)
        return f"did you mean `{close}`?" if close else None
    return None
