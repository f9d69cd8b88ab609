"""`pirlc explain-program`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from pirlc.cli.arguments import Arguments, argument_option
from pirlc.cli.progress import busy
from pirlc.cli.session import Session, json_option, pass_session

if TYPE_CHECKING:
    from pirlc.analyze.findings import Plant
    from pirlc.ir.policy import Program


@click.command("explain-program", epilog="Example: pirlc explain-program cartpole.pirl")
@click.argument("program")
@click.option(
    "--plant", metavar="FILE|equations|none", default="equations", show_default=True,
    help="What loops are closed with: a plant from a TOML or JSON file; known equations of the "
    "program's environment, where there are any; none.",
)  # fmt: skip
@click.option(
    "--episodes", type=click.IntRange(1, 100_000),
    help="Simulate this many episodes, and tell how often each branch is taken.",
)  # fmt: skip
@click.option(
    "--seed", type=click.IntRange(0, 2**62), default=1_000_000, show_default=True,
    help="Of the first episode.",
)  # fmt: skip
@argument_option
@click.option("--trust", is_flag=True, help="Let environments run their own code.")
@json_option
@pass_session
def command(
    session: Session,
    program: str,
    plant: str,
    episodes: int | None,
    seed: int,
    arguments: Arguments,
    trust: bool,
) -> None:
    """Say in words and small tables what PROGRAM does.

    Of each action: its branches and when each is taken, the gains, where it saturates, how it
    settles; of each sensor: what it is used for. Nothing is simulated unless --episodes asks for
    it.
    """
    from pirlc.analyze.analysis import analyze
    from pirlc.analyze.reading.program import read_program
    from pirlc.cli.files import program_in, read_sketch
    from pirlc.report.data import as_data
    from pirlc.report.reading_words import as_text, sections

    source, sketch = read_sketch(session, program, arguments)
    closed = program_in(source, sketch)
    with busy("reading") as doing:
        reading = read_program(closed, analyze(closed, _plant(closed, plant, trust)))
        if episodes is not None:
            from pirlc.analyze.reading.activity import with_shares

            doing("simulating")
            reading = with_shares(reading, closed, episodes, seed, trust=trust)
    session.say(as_text(sections(reading)))
    session.finish({"reading": as_data(reading)})


def _plant(program: Program, wanted: str, trust: bool) -> Plant | None:
    """The plant of a file, or that of known equations; None where there is none."""
    if wanted == "none":
        return None
    if wanted != "equations":
        from pirlc.analyze.plant_file import read_plant
        from pirlc.cli.files import read_source

        return read_plant(read_source(wanted), program)
    from pirlc.analyze.reading.known import known_plant

    return known_plant(program, trust=trust)
