"""Where a policy acts: its environment, compared with the file that speaks of it."""

from __future__ import annotations

from dataclasses import replace

from pirlc.cli.session import Session
from pirlc.diagnostics import Label, PirlcError, Severity
from pirlc.ir.policy import Interface
from pirlc.simulation.environments import (
    EnvironmentFacts,
    check_interface,
    facts,
    require_environment,
)
from pirlc.source import SourceText


def facts_for(source: SourceText, interface: Interface, trust: bool) -> EnvironmentFacts:
    """The facts of the environment that a file names.

    Raises PirlcError E0501 to E0506, pointing into the file, and E0513.
    """
    environment = require_environment(interface)
    try:
        return facts(environment, trust)
    except PirlcError as error:
        where = Label(environment.span)
        raise PirlcError(
            d if d.source else replace(d, source=source, primary=where) for d in error.diagnostics
        ) from error


def check_fit(
    session: Session, source: SourceText, interface: Interface, found: EnvironmentFacts
) -> None:
    """Compare a file's sensors and actions with an environment; warnings are shown.

    Raises PirlcError E0507 to E0510.
    """
    diagnostics = check_interface(interface, found, source)
    if any(d.severity is Severity.ERROR for d in diagnostics):
        raise PirlcError(diagnostics)
    session.tell(diagnostics)


def fitting_facts(
    session: Session, source: SourceText, interface: Interface, trust: bool
) -> EnvironmentFacts:
    """The facts of the environment that a file names, which its sensors and actions fit."""
    found = facts_for(source, interface, trust)
    check_fit(session, source, interface, found)
    return found
