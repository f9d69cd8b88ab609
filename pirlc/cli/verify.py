"""`pirlc verify`."""

from __future__ import annotations

from dataclasses import replace

import click

from pirlc.cli.files import program_in, read_sketch
from pirlc.cli.progress import busy
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
@click.option(
    "--bounds",
    "bounded",
    is_flag=True,
    help="Also the tightest bounds of each action and of its change in one step, and of what "
    "properties bound, exactly.",
)
@click.option(
    "--emitted",
    is_flag=True,
    help="Also whether the C that is emitted for it is the program, in both precisions.",
)
@json_option
@pass_session
def command(
    session: Session, program: str, seconds: float | None, bounded: bool, emitted: bool
) -> int:
    """Prove the properties of PROGRAM, or show a history that violates them.

    Also told: branches that no history reaches, guards that never change, jumps, divisions by zero
    and the like, parameters without effect, guards that rounding can turn.

    PROGRAM is a .pirl file with nothing left to choose. The exit code is 0 if all properties are
    proved (and the emitted C, if it is asked for), 1 if one is refuted, 2 if one is neither.
    """
    source, sketch = read_sketch(session, program)
    closed = program_in(source, sketch)

    from pirlc.backend.numbers import PRECISIONS
    from pirlc.cli.bounds_text import bounds_texts, guard_texts, placed, remark_texts
    from pirlc.cli.emitted_text import emitted_problems, emitted_texts
    from pirlc.cli.verification_text import exit_code, property_texts
    from pirlc.report.data import as_data
    from pirlc.verify.bounds.actions import bounds
    from pirlc.verify.bounds.tightening import tightened
    from pirlc.verify.emitted import check_emitted
    from pirlc.verify.findings import Verification
    from pirlc.verify.problems import problems_of
    from pirlc.verify.properties.asking import Limits
    from pirlc.verify.properties.prove import prove
    from pirlc.verify.remarks.collect import guard_margins, remarks

    limits = Limits(seconds=seconds)
    with busy("proving the properties") as doing:
        proved = prove(closed, limits)
        doing("looking for what was not asked")
        found = Verification(
            closed.interface.name,
            properties=proved,
            remarks=remarks(closed, limits),
            guards=guard_margins(closed, limits),
        )
        if bounded:
            doing("finding the tightest bounds")
            tight = tightened(closed, proved, limits)
            found = replace(found, properties=tight, bounds=bounds(closed, limits))
        if emitted:
            doing("comparing the emitted C")
            compared = tuple(check_emitted(closed, real) for real in PRECISIONS)
            found = replace(found, emitted=compared)
    policy = closed.interface.name
    if session.json:
        session.tell(problems_of(source, found.properties))
        session.tell(emitted_problems(policy, found.emitted))
    session.say("\n".join(property_texts(source, closed, found.properties)))
    for lines in (
        bounds_texts(found.bounds) if bounded else (),
        remark_texts(source, found.remarks),
        guard_texts(source, found.guards),
        emitted_texts(policy, found.emitted),
    ):
        if text := "\n".join(lines):
            session.say(f"\n{text}")
    code = exit_code(found)
    data = as_data(found)
    for remark, entry in zip(found.remarks, data["remarks"], strict=True):
        entry.update(placed(source, remark.span))
    for guard, entry in zip(found.guards, data["guards"], strict=True):
        entry.update(placed(source, guard.span))
    session.finish({"exit_code": code, **data})
    return code
