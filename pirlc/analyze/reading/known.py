"""The plant that is known of an environment without a look at its simulator's behaviour."""

from __future__ import annotations

from pirlc.analyze.findings import Origin, Plant
from pirlc.diagnostics import PirlcError
from pirlc.ir.policy import Program


def known_plant(program: Program, *, trust: bool = False) -> Plant | None:
    """The plant of known equations; None where the environment has none, or has changed."""
    environment = program.interface.environment
    if environment is None:
        return None
    from pirlc.analyze.plants.equations import known_equations
    from pirlc.analyze.plants.find import find_plant

    if known_equations(environment) is None:
        return None
    try:
        return find_plant(program, environment, Origin.EQUATIONS, trust=trust)
    except PirlcError:
        return None
