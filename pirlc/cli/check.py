"""`pirlc check`."""

from __future__ import annotations

import click

from pirlc.cli.arguments import Arguments, argument_option
from pirlc.cli.files import read_sketch
from pirlc.cli.session import Session, json_option, pass_session


@click.command("check", epilog="Example: pirlc check examples/cartpole.pirl --environment")
@click.argument("file")
@click.option(
    "--environment", is_flag=True, help="Also make the environment and compare it with the file."
)
@click.option(
    "--size",
    type=click.IntRange(1, 200),
    help="Count the program templates up to this size (default: 40 for each action).",
)
@argument_option
@click.option("--trust", is_flag=True, help="Let an environment `module:id` run its code.")
@json_option
@pass_session
def command(
    session: Session,
    file: str,
    environment: bool,
    size: int | None,
    arguments: Arguments,
    trust: bool,
) -> None:
    """Check FILE, a sketch or a program, and say what it allows.

    `-` reads standard input.
    """
    from pirlc.cli.allowed import as_data, in_words, measure

    source, sketch = read_sketch(session, file, arguments)
    if environment:
        from pirlc.cli.places import fitting_facts

        fitting_facts(session, source, sketch.interface, trust)
    allowed = measure(sketch, size or 40 * len(sketch.interface.actions))
    session.say(in_words(allowed))
    session.finish(as_data(allowed))
