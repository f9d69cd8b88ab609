"""`pirlc report`."""

from __future__ import annotations

from pathlib import Path

import click

from pirlc.cli.session import Session, json_option, pass_session


@click.command("report", epilog="Example: pirlc report runs/cartpole")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@json_option
@pass_session
def command(session: Session, folder: Path) -> None:
    """Make the page of the run in DIR: report.html, and report.json with all that it shows.

    The page stands alone: it can be read offline, sent, and printed. Of a run that has not ended it
    shows what there is.
    """
    from pirlc.report.page import write_report

    page, data = write_report(folder)
    session.say(f"{page}\n{data}")
    session.finish({"page": str(page), "data": str(data)})
