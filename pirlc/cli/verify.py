"""`pirlc verify`."""

from __future__ import annotations

import click

from pirlc.cli.files import program_in, read_sketch
from pirlc.cli.session import Session, json_option, pass_session


@click.command("verify", epilog="Example: pirlc verify examples/torcs/printed/aalborg.pirl")
@click.argument("program")
@click.option(
    "--timeout",
    "seconds",
    type=click.FloatRange(0.001),
    metavar="SECONDS",
    help="The most time for one question to z3. (There is always a limit on its work, which gives "
    "the same answer on every machine.)",
)
@json_option
@pass_session
def command(session: Session, program: str, seconds: float | None) -> int:
    """Prove the properties of PROGRAM, or show a history that violates them.

    PROGRAM is a .pirl file with nothing left to choose. The exit code is 0 if all properties are
    proved, 1 if one is refuted, 2 if one is neither.
    """
    source, sketch = read_sketch(session, program)
    closed = program_in(source, sketch)

    from pirlc.cli.verification_text import exit_code, property_texts
    from pirlc.report.data import as_data
    from pirlc.verify.asking import Limits
    from pirlc.verify.findings import Verification
    from pirlc.verify.problems import problems_of
    from pirlc.verify.properties import prove

    found = Verification(closed.interface.name, prove(closed, Limits(seconds=seconds)))
    if session.json:
        session.tell(problems_of(source, found.properties))
    session.say("\n".join(property_texts(source, closed, found.properties)))
    code = exit_code(found)
    session.finish({"exit_code": code, **as_data(found)})
    return code
