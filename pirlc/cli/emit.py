"""`pirlc emit`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from pirlc.cli.files import read_program
from pirlc.cli.session import Session, json_option, pass_session


def _targets(_: click.Context, __: click.Parameter, value: str) -> tuple[str, ...]:
    targets = tuple(name.strip() for name in value.split(",") if name.strip())
    if not targets:
        raise click.BadParameter("name at least one target, such as c")
    return targets


@click.command("emit", epilog="Example: pirlc emit cartpole.pirl --target c -o build")
@click.argument("program")
@click.option(
    "--target",
    "targets",
    default="c,python",
    show_default=True,
    callback=_targets,
    help="What to write, separated by commas: c, python, torcs (a robot).",
)
@click.option(
    "-o", "--output", "folder", required=True, type=click.Path(path_type=Path),
    help="The folder for the files; made if it is not there.",
)  # fmt: skip
@click.option(
    "--real",
    type=click.Choice(["double", "float"]),
    default="double",
    show_default=True,
    help="The numbers to compute in: binary64 or binary32.",
)
@json_option
@pass_session
def command(
    session: Session,
    program: str,
    targets: tuple[str, ...],
    folder: Path,
    real: Literal["double", "float"],
) -> None:
    """Write PROGRAM, a .pirl file with nothing left to choose, as C, Python or a TORCS robot."""
    from pirlc.backend.emit import emit, write
    from pirlc.cli.emitted_text import in_words
    from pirlc.report.data import as_data
    from pirlc.verify.emitted.gate import compared

    closed = read_program(session, program)
    files = emit(closed, targets, real)
    # Before anything is written: C that is not the program must not look as if it were.
    finding = compared(closed, files, real)
    paths = write(files, folder)
    for path in paths:
        session.say(f"wrote {path}")
    result: dict[str, object] = {"real": real, "files": [str(path) for path in paths]}
    if finding is not None:
        session.say(in_words(finding))
        result["emitted"] = as_data(finding)
    session.finish(result)
