"""What the compiler reports to people: a code, a place in the source, and a way out.

The parts of the compiler describe each kind of mistake as a small frozen dataclass of their own
and turn it into a `Diagnostic`; this module alone knows how a diagnostic looks.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum

from pirlc.source import SourceText, Span


class Severity(Enum):
    ERROR = "error"
    WARNING = "warning"


@dataclass(frozen=True, slots=True)
class Label:
    """A span that is underlined, with the words beside the underline."""

    span: Span
    text: str = ""


@dataclass(frozen=True)
class Diagnostic:
    """One report. `code` names the kind of mistake (`pirlc explain CODE` tells more)."""

    code: str
    message: str
    source: SourceText | None = None
    primary: Label | None = None
    secondary: tuple[Label, ...] = ()
    notes: tuple[str, ...] = ()
    help: str | None = None
    severity: Severity = Severity.ERROR


class PirlcError(Exception):
    """Raised with one or more diagnostics; the command line renders them and exits."""

    def __init__(self, diagnostics: Diagnostic | Iterable[Diagnostic]) -> None:
        single = isinstance(diagnostics, Diagnostic)
        self.diagnostics: tuple[Diagnostic, ...] = (
            (diagnostics,) if isinstance(diagnostics, Diagnostic) else tuple(diagnostics)
        )
        assert single or self.diagnostics, "an error needs at least one diagnostic"
        super().__init__("; ".join(f"{d.code}: {d.message}" for d in self.diagnostics))

    def __reduce__(self) -> tuple[type[PirlcError], tuple[tuple[Diagnostic, ...]]]:
        # Worker processes send their errors back by pickle.
        return PirlcError, (self.diagnostics,)


def suggestion(name: str, known: Sequence[str]) -> str | None:
    """The known name that a misspelt one was most likely meant to be, if any comes close."""
    from difflib import get_close_matches  # only mistakes pay for loading it

    close = get_close_matches(name, known, n=1, cutoff=0.6)
    if close:
        return close[0]
    folded = {candidate.casefold(): candidate for candidate in known}
    return folded.get(name.casefold())


_RED, _BLUE, _YELLOW, _BOLD, _OFF = "\x1b[1;31m", "\x1b[1;34m", "\x1b[1;33m", "\x1b[1m", "\x1b[0m"


def render(diagnostic: Diagnostic, *, color: bool = False) -> str:
    """The diagnostic as text in the manner of rustc, without a final newline."""

    def paint(style: str, text: str) -> str:
        return f"{style}{text}{_OFF}" if color and text else text

    tone = _RED if diagnostic.severity is Severity.ERROR else _YELLOW
    head = paint(tone, f"{diagnostic.severity.value}[{diagnostic.code}]")
    lines = [f"{head}{paint(_BOLD, ': ' + diagnostic.message)}"]
    gutter = 1
    if diagnostic.source is not None and diagnostic.primary is not None:
        source = diagnostic.source
        labels = sorted(
            [(diagnostic.primary, "^", tone), *((s, "-", _BLUE) for s in diagnostic.secondary)],
            key=lambda item: item[0].span.start,
        )
        row, column = source.position(diagnostic.primary.span.start)
        gutter = max(len(str(source.position(label.span.start)[0])) for label, _, _ in labels)
        places = [source.position(diagnostic.primary.span.start)]
        places.extend(source.position(label.span.start) for label, _, _ in labels)
        pad = " " * gutter
        lines.append(f"{pad}{paint(_BLUE, '-->')} {source.name}:{row}:{column}")
        bar = paint(_BLUE, "|")
        lines.append(f"{pad} {bar}")
        shown = 0
        for label, mark, style in labels:
            row, column = source.position(label.span.start)
            text = source.line(row)
            # One excerpt a line, wherever its labels are; a label outside has no underline.
            start = _excerpt_start(next(c for r, c in places if r == row))
            if row != shown:
                if shown and row > shown + 1:
                    lines.append(paint(_BLUE, "..."))
                excerpt = _printable(text[start : start + _LINE_LIMIT]).expandtabs(4)
                lines.append(f"{paint(_BLUE, str(row).rjust(gutter))} {bar} {excerpt}")
                shown = row
            if not start < column <= start + _LINE_LIMIT + 1:
                continue
            before = text[start : column - 1].expandtabs(4)
            last = min(label.span.end - label.span.start, start + _LINE_LIMIT - column + 1)
            under = mark * max(1, min(last, len(text) - column + 1))
            words = f" {label.text}" if label.text else ""
            lines.append(f"{pad} {bar} {' ' * len(before)}{paint(style, under + words)}")
        if diagnostic.notes or diagnostic.help:
            lines.append(f"{pad} {bar}")
    pad = " " * gutter
    for kind, text in [
        *(("note", note) for note in diagnostic.notes),
        *([("help", diagnostic.help)] if diagnostic.help else []),
    ]:
        lines.append(f"{pad} {paint(_BLUE, '=')} {paint(_BOLD, kind)}: {text}")
    return "\n".join(lines)


_LINE_LIMIT = 160


def _excerpt_start(column: int) -> int:
    """Where the shown part of a line begins: at its start, unless a label is far beyond."""
    return 0 if column <= _LINE_LIMIT * 3 // 4 else column - _LINE_LIMIT // 2


def _printable(text: str) -> str:
    """Control characters must not reach the terminal; each keeps its one column."""
    return "".join(c if c.isprintable() or c == "\t" else "\N{REPLACEMENT CHARACTER}" for c in text)


def as_json(diagnostic: Diagnostic) -> dict[str, object]:
    """The diagnostic as plain data, for `--json`."""

    def place(label: Label) -> dict[str, object]:
        assert diagnostic.source is not None
        line, column = diagnostic.source.position(label.span.start)
        end_line, end_column = diagnostic.source.position(label.span.end)
        return {
            "file": diagnostic.source.name,
            "line": line,
            "column": column,
            "end_line": end_line,
            "end_column": end_column,
            "label": label.text,
        }

    placed = diagnostic.source is not None and diagnostic.primary is not None
    return {
        "code": diagnostic.code,
        "severity": diagnostic.severity.value,
        "message": diagnostic.message,
        "at": place(diagnostic.primary) if placed and diagnostic.primary else None,
        "also": [place(label) for label in diagnostic.secondary] if placed else [],
        "notes": list(diagnostic.notes),
        "help": diagnostic.help,
    }
