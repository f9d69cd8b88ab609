"""`pirlc torcs`."""

from __future__ import annotations

from pathlib import Path

import click

from pirlc.cli.session import Session, json_option, pass_session


@click.group("torcs")
def group() -> None:
    """Prepare the racing simulator TORCS, and race in it."""


@group.command("install", epilog="Example: pirlc torcs install")
@click.option(
    "--source", type=click.Path(path_type=Path),
    help="TORCS's source archive, or the folder it unpacks to (default: fetched from Debian).",
)  # fmt: skip
@json_option
@pass_session
def install(session: Session, source: Path | None) -> None:
    """Prepare TORCS for races, in pirlc's cache. Again: nothing, if all is there."""
    from pirlc.cli.torcs_setup import prepare

    prepare(session, source)


@group.command("doctor", epilog="Example: pirlc torcs doctor")
@json_option
@pass_session
def doctor(session: Session) -> int:
    """Look at everything that races need; exit 1 if something is wrong."""
    from pirlc.cli.torcs_setup import show_health

    return show_health(session)
