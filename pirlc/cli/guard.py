"""What comes of an exception: a message in words and an exit code, never a traceback."""

from __future__ import annotations

import os
import sys
import tempfile
import traceback
from collections.abc import Callable
from contextlib import suppress

import click

from pirlc.cli.problems import OutOfMemory, SystemRefused, describe
from pirlc.cli.session import Session
from pirlc.diagnostics import PirlcError, render

REFUSED, USAGE, TIMEOUT, FAULT, INTERRUPTED = 1, 2, 3, 70, 130


def guarded(run: Callable[[], int], session: Session) -> int:
    """The exit code of `run`, whatever it raises."""
    try:
        try:
            return _flushed(run())
        except Exception as error:
            return _flushed(_code(error, session))
        except KeyboardInterrupt:
            return _flushed(_interrupted(session))
    except BrokenPipeError:
        _discard_stdout()
        return REFUSED
    except PirlcError as error:
        # Standard output takes no more; stderr still may.
        for diagnostic in error.diagnostics:
            print(render(diagnostic), file=sys.stderr)
        _discard_stdout()
        return REFUSED


def _flushed(code: int) -> int:
    sys.stdout.flush()
    return code


def _code(error: Exception, session: Session) -> int:
    match error:
        case PirlcError():
            session.tell(error.diagnostics)
            session.finish({})
            return REFUSED
        case click.Abort():
            return _interrupted(session)
        case click.ClickException():
            error.show()
            return error.exit_code
        case BrokenPipeError():
            raise error
        case OSError() if error.errno is not None:
            place = os.fsdecode(error.filename) if error.filename is not None else None
            session.tell([describe(SystemRefused(place, _reason(error)))])
            session.finish({})
            return REFUSED
        case MemoryError():
            session.tell([describe(OutOfMemory())])
            session.finish({})
            return REFUSED
        case _:
            return _fault(error, session)


def _interrupted(session: Session) -> int:
    if not session.json:
        print("interrupted", file=sys.stderr)
    session.finish({"interrupted": True})
    return INTERRUPTED


def _fault(error: Exception, session: Session) -> int:
    kind = type(error).__name__
    place = _saved("".join(traceback.format_exception(error)))
    where = f"What happened is written down in {place}." if place else ""
    print(
        f"internal error: {kind}. This is a fault of pirlc, not of your file: please report it, "
        f"with the file and the command. {where}".rstrip(),
        file=sys.stderr,
    )
    session.finish({"internal_error": {"type": kind, "details": place}})
    return FAULT


def _saved(text: str) -> str | None:
    try:
        handle, place = tempfile.mkstemp(prefix="pirlc-fault-", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8", errors="backslashreplace") as stream:
            stream.write(text)
    except OSError:
        return None
    return place


def _reason(error: OSError) -> str:
    return (error.strerror or str(error) or type(error).__name__).lower()


def _discard_stdout() -> None:
    """For when whoever read the output (`| head`) has had enough, or the disk is full."""
    # Python flushes stdout once more when it exits, and would complain then.
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
