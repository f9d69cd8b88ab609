"""`pirlc analyze`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pirlc.cli.arguments import Arguments, argument_option
from pirlc.cli.progress import busy
from pirlc.cli.session import Session, json_option, pass_session

if TYPE_CHECKING:
    from pirlc.analyze.findings import Plant
    from pirlc.ir.policy import Program

_FOUND = ("equations", "simulator", "identify")


@click.command("analyze", epilog="Example: pirlc analyze pendulum.pirl --latency 1 -o plots")
@click.argument("program")
@click.option(
    "--plant",
    metavar="FILE|auto|equations|simulator|identify|none",
    default="auto",
    show_default=True,
    help="The plant: from a TOML or JSON file; from known equations, linearised; by differences in "
    "the simulator; identified from rollouts; auto: the first of these three that is possible.",
)
@click.option(
    "--operating-point",
    metavar="NAME",
    help="Of an environment whose equations are known: where to linearise, such as upright.",
)
@click.option(
    "--at",
    "points",
    multiple=True,
    metavar="NAME=VALUE",
    help="A reading (or an action) to linearise the program at; may be repeated.",
)
@click.option(
    "--latency",
    type=click.IntRange(0, 1000),
    help="Steps that readings are late (default: the program's).",
)
@click.option(
    "--simulate/--no-simulate",
    default=True,
    help="Compare the loops with the simulator, where the program names one.",
)
@click.option(
    "-o", "--output", "folder", type=click.Path(path_type=Path),
    help="A folder for plots: Bode, Nyquist, step response, poles.",
)  # fmt: skip
@argument_option
@click.option("--trust", is_flag=True, help="Let environments run their own code.")
@json_option
@pass_session
def command(
    session: Session,
    program: str,
    plant: str,
    operating_point: str | None,
    points: tuple[str, ...],
    latency: int | None,
    simulate: bool,
    folder: Path | None,
    arguments: Arguments,
    trust: bool,
) -> None:
    """Say what control theory says of PROGRAM: filters, margins, switching.

    Each branch of each action is a filter of its readings; with a plant it is a loop, with poles,
    margins (each found in two ways) and responses.
    """
    from pirlc.analyze.analysis import analyze
    from pirlc.cli.analysis_text import in_words
    from pirlc.cli.files import program_in, read_sketch
    from pirlc.report.data import as_data

    source, sketch = read_sketch(session, program, arguments)
    closed = program_in(source, sketch)
    at = parse_points(points, closed)
    with busy("finding a plant") as doing:
        around, notes = _plant(closed, plant, operating_point, trust)
        doing("analysing")
        found = analyze(
            closed, around, at=at, latency=latency,
            simulator=closed.interface.environment if simulate else None, trust=trust,
        )  # fmt: skip
    found = replace(found, notes=(*found.notes, *notes))
    session.say(in_words(found))
    data = as_data(found)
    written: list[str] = []
    if folder is not None:
        from pirlc.report.analysis_plots import write_plots

        written = [str(path) for path in write_plots(data, folder)]
        for path in written:
            session.say(f"wrote {path}")
    session.finish({"analysis": data, "files": written})


def parse_points(entries: tuple[str, ...], program: Program) -> dict[str, float]:
    """The values that ``name=value`` texts give sensors and actions. Raises PirlcError E0924."""
    from pirlc.analyze.problems import BadPoint, error
    from pirlc.diagnostics import suggestion

    interface = program.interface
    known = [*(s.name for s in interface.sensors), *(a.name for a in interface.actions)]
    found: dict[str, float] = {}
    for entry in entries:
        name, equals, text = entry.partition("=")
        if not equals:
            raise error(BadPoint(entry, "it has no `=`"))
        if name not in known:
            reason = f"the program has no sensor or action {name!a}"
            raise error(BadPoint(entry, reason, suggestion(name, known)))
        if name in found:
            raise error(BadPoint(entry, f"{name} is given twice"))
        try:
            value = float(text)
        except ValueError:
            raise error(BadPoint(entry, f"{text!a} is no number")) from None
        if not abs(value) < 1e300:
            raise error(BadPoint(entry, f"{text!a} is not finite"))
        found[name] = value
    return found


def _plant(
    program: Program, wanted: str, operating_point: str | None, trust: bool
) -> tuple[Plant | None, tuple[str, ...]]:
    """The plant that the command line asks for. Raises PirlcError where it cannot be had; for
    `auto` there is none then, and notes say why."""
    from pirlc.diagnostics import PirlcError

    environment = program.interface.environment
    if wanted == "none" or (wanted == "auto" and environment is None):
        return None, ()
    if wanted not in ("auto", *_FOUND):
        from pirlc.analyze.plant_file import read_plant
        from pirlc.cli.files import read_source

        return read_plant(read_source(wanted), program), ()
    if environment is None:
        from pirlc.analyze.problems import NowhereToLook, error

        raise error(NowhereToLook(program.interface.name))
    from pirlc.analyze.findings import Origin
    from pirlc.analyze.plants.find import find_plant

    origins = dict(
        zip(_FOUND, (Origin.EQUATIONS, Origin.SIMULATOR, Origin.IDENTIFIED), strict=True)
    )
    try:
        found = find_plant(program, environment, origins.get(wanted), operating_point, trust=trust)
    except PirlcError as e:
        if wanted != "auto" or operating_point is not None:
            raise
        return None, tuple(f"no plant: {diagnostic.message}" for diagnostic in e.diagnostics)
    return found, ()
