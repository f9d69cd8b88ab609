"""`pirlc fmt`."""

from __future__ import annotations

import os
import tempfile
from contextlib import suppress
from pathlib import Path

import click

from pirlc.cli.files import read_source
from pirlc.cli.guard import REFUSED
from pirlc.cli.problems import SystemRefused, error
from pirlc.cli.session import Session, json_option, pass_session
from pirlc.diagnostics import PirlcError


@click.command("fmt", epilog="Example: pirlc fmt --check sketches/*.pirl")
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@click.option("--check", is_flag=True, help="Change nothing; exit 1 if a file would change.")
@json_option
@pass_session
def command(session: Session, files: tuple[str, ...], check: bool) -> int:
    """Lay out FILEs in the one layout, in place; comments are kept.

    `-` reads standard input and prints the result. A file with syntax errors is left as it is.
    """
    from pirlc.frontend import format_source

    outcomes: list[dict[str, object]] = []
    failed = False
    for name in files:
        try:
            source = read_source(name)
            text = format_source(source)
            changed = text != source.text
            if changed and not check and name != "-":
                _replace(Path(name), text)
        except PirlcError as e:
            session.tell(e.diagnostics)
            failed = True
            continue
        outcome: dict[str, object] = {"file": source.name, "changed": changed}
        if name == "-":
            outcome["text"] = text
            if not check and not session.json:
                click.echo(text, nl=False)
        if changed and (check or name != "-"):
            verb = "would change" if check else "formatted"
            session.say(f"{verb} {source.name}")
        outcomes.append(outcome)
    session.finish({"files": outcomes})
    unformatted = check and any(outcome["changed"] for outcome in outcomes)
    return REFUSED if failed or unformatted else 0


def _replace(path: Path, text: str) -> None:
    """Put the text in the file's place in one step, so that an interruption loses nothing."""
    place = path.resolve()
    draft = None
    try:
        mode = place.stat().st_mode
        handle, name = tempfile.mkstemp(prefix=".pirlc-", dir=place.parent)
        draft = Path(name)
        with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as stream:
            stream.write(text)
        draft.chmod(mode & 0o7777)
        draft.replace(place)
        draft = None
    except OSError as e:
        reason = (e.strerror or str(e)).lower()
        raise error(SystemRefused(str(path), reason)) from None
    finally:
        if draft is not None:
            with suppress(OSError):
                draft.unlink()
