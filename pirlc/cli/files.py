"""Sketches and programs from the files that a command is given."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from pirlc.cli.arguments import Arguments
from pirlc.cli.problems import NotText, StillOpen, TooLarge, Unreadable, error
from pirlc.cli.session import Session
from pirlc.diagnostics import suggestion
from pirlc.source import SourceText, Span

if TYPE_CHECKING:
    from pirlc.ir.policy import Program, Sketch

LARGEST = 4_000_000
"""Bytes of a .pirl file; the parser's own limit, in characters, is below it."""


def read_source(name: str) -> SourceText:
    """The text of a file, or of standard input for ``-``. Raises PirlcError E0701 to E0703."""
    shown = "<stdin>" if name == "-" else name
    try:
        if name == "-":
            data = sys.stdin.buffer.read(LARGEST + 1)
        else:
            with Path(name).open("rb") as stream:
                data = stream.read(LARGEST + 1)
    except OSError as e:
        reason = (e.strerror or str(e)).lower()
        raise error(Unreadable(shown, reason, _similar(Path(name)))) from None
    except ValueError:
        # A NUL in the name.
        raise error(Unreadable(ascii(shown), "no file can have this name")) from None
    if len(data) > LARGEST:
        raise error(TooLarge(shown, LARGEST))
    try:
        return SourceText(shown, data.decode("utf-8-sig"))
    except UnicodeDecodeError as e:
        raise error(NotText(shown, e.start)) from None


def _similar(path: Path) -> str | None:
    """A .pirl file that the name may have meant: in it, if it is a folder, or beside it."""
    try:
        if path.is_dir():
            inside = sorted(path.glob("*.pirl"))
            return str(inside[0]) if len(inside) == 1 else None
        names = [entry.name for entry in path.parent.iterdir() if entry.suffix == ".pirl"]
    except OSError:
        return None
    close = suggestion(path.name, sorted(names))
    return str(path.with_name(close)) if close else None


def read_sketch(
    session: Session, name: str, arguments: Arguments = ()
) -> tuple[SourceText, Sketch]:
    """The sketch in a file; its warnings are shown. Raises `PirlcError` as the front end does.

    `arguments` of its environment take the place of the file's; E0513 if it names none.
    """
    from pirlc.frontend import check

    source = read_source(name)
    sketch, warnings = check(source)
    session.tell(warnings)
    if arguments:
        from pirlc.simulation.environments import require_environment

        known = require_environment(sketch.interface)
        sketch = sketch.in_environment(known.with_arguments(arguments))
    return source, sketch


def read_program(session: Session, name: str) -> Program:
    """The program in a file. Raises E0704 for a sketch that leaves something open."""
    return program_in(*read_sketch(session, name))


def program_in(source: SourceText, sketch: Sketch) -> Program:
    """The program that the sketch is. Raises E0704 where it leaves something open."""
    from pirlc.ir.expansion import close

    program = close(sketch)
    if program is None:
        raise error(StillOpen(source, open_choices(sketch)))
    return program


def open_choices(sketch: Sketch) -> tuple[tuple[Span, str], ...]:
    """What a sketch leaves open, in the order of the text: rules, holes, parameters."""
    from pirlc.ir.policy import FreeParameter
    from pirlc.ir.terms import Hole, RuleCall, subterms

    found: dict[Span, str] = {}
    waiting, seen = list(sketch.bodies), set[str]()
    while waiting:
        for term in subterms(waiting.pop()):
            match term:
                case Hole():
                    found[term.span] = "a parameter to find"
                case RuleCall(key) if key not in seen:
                    seen.add(key)
                    rule = sketch.rule(key)
                    waiting.extend(rule.alternatives)
                    if len(rule.alternatives) != 1:
                        found[rule.span] = f"{len(rule.alternatives)} alternatives"
                case _:
                    pass
    for parameter in sketch.parameters:
        if isinstance(parameter, FreeParameter):
            found[parameter.span] = "a parameter to find"
    return tuple(sorted(found.items(), key=lambda item: (item[0].start, item[0].end)))
