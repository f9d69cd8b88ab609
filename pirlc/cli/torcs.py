"""`pirlc torcs`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

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


@group.command("race", epilog="Example: pirlc torcs race driver.pirl --track aalborg --laps 3")
@click.argument("driver", metavar="PROGRAM")
@click.option("--track", help="Default: that of the program's environment, else aalborg.")
@click.option("--laps", type=click.IntRange(1, 1000), default=3, show_default=True)
@click.option("--car", help="Default: that of the program's environment, else car1-trb1.")
@click.option(
    "--seed",
    type=click.IntRange(0, 2**62),
    default=0,
    show_default=True,
    help="Of what is left to chance: blocked sensors, noise.",
)
@click.option(
    "--blocked", metavar="NAMES", default="", help="Sensors to block, such as rpm,trackPos."
)
@click.option(
    "--block-probability",
    type=click.FloatRange(0, 1),
    help="That a blocked sensor is missing in a step (default: 0.5).",
)
@click.option(
    "--termination",
    default="none",
    show_default=True,
    help="What ends a race early: none, ndps or gym_torcs.",
)
@click.option(
    "--real",
    type=click.Choice(["double", "float"]),
    default="double",
    show_default=True,
    help="The numbers that the program computes in.",
)
@click.option(
    "-o", "--output", "folder", type=click.Path(path_type=Path),
    help="The folder for the plots (default: race-PROGRAM-TRACK).",
)  # fmt: skip
@click.option("--no-plots", is_flag=True, help="Draw nothing.")
@json_option
@pass_session
def race(
    session: Session,
    driver: str,
    track: str | None,
    laps: int,
    car: str | None,
    seed: int,
    blocked: str,
    block_probability: float | None,
    termination: str,
    real: Literal["double", "float"],
    folder: Path | None,
    no_plots: bool,
) -> None:
    """Race PROGRAM natively in TORCS, and tell how it drove.

    PROGRAM is a .pirl file with nothing left to choose, built as C, or a robot that comes with
    TORCS: robot:berniw, robot:bt, robot:inferno or robot:olethros.
    """
    from pirlc.cli import torcs_race

    given: dict[str, str | int | float | bool | None] = {
        "track": track,
        "laps": laps,
        "car": car,
        "termination": termination,
        "block_probability": 0.5 if blocked and block_probability is None else block_probability,
    }
    arguments = {key: value for key, value in given.items() if value is not None}
    torcs_race.race(
        session,
        torcs_race.RaceRequest(driver, arguments, blocked, seed, real, folder, not no_plots),
    )
