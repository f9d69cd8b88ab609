"""`pirlc explain`."""

from __future__ import annotations

import click

from pirlc import resources
from pirlc.cli.problems import UnknownCode, error
from pirlc.cli.session import Session, json_option, pass_session
from pirlc.diagnostics import suggestion


@click.command("explain", epilog="Example: pirlc explain E0303")
@click.argument("code")
@json_option
@pass_session
def command(session: Session, code: str) -> None:
    """Say more about a diagnostic's CODE: what it means and how to mend it."""
    from pirlc.frontend.explain import explain

    page = explain(code)
    if page is None:
        known = sorted(file.stem for file in resources.explanations().glob("E*.md"))
        raise error(UnknownCode(code, suggestion(code.upper(), known)))
    session.say(page.rstrip("\n"))
    session.finish({"code": code.upper(), "page": page})
