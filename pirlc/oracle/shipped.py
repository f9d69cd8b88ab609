"""Oracles that come with a sketch: those in the folder `oracles/` beside it."""

from __future__ import annotations

from pathlib import Path

from pirlc.diagnostics import PirlcError
from pirlc.ir.policy import Environment, Scalar
from pirlc.oracle.load import LoadedOracle, load
from pirlc.oracle.manifest import Manifest
from pirlc.oracle.store import list_stored
from pirlc.simulation.environments import EnvironmentFacts

FOLDER = "oracles"

_TELLING = {"pirlc/Torcs-v0": {"track": "aalborg"}}
"""Arguments (and their defaults) in which an oracle must agree to be taken unasked: a driver for
one track may drive on any, but it is not what a sketch for another came with."""


def find_shipped(
    sketch: Path,
    environment: Environment,
    facts: EnvironmentFacts,
    *,
    algorithm: str | None = None,
    seed: int | None = None,
) -> LoadedOracle | None:
    """The oracle beside a sketch's file that fits its environment, or None.

    Of several the one that agrees in the most arguments, then the first by name. `algorithm` and
    `seed` must be the oracle's, where they are given.
    """
    found: list[tuple[int, str, LoadedOracle]] = []
    for stored in list_stored(sketch.parent / FOLDER):
        manifest = stored.manifest
        if algorithm not in (None, manifest.algorithm) or seed not in (None, manifest.seed):
            continue
        if _telling(manifest.environment) != _telling(environment):
            continue
        try:
            oracle = load(str(stored.folder), environment, facts)
        except PirlcError:
            continue
        found.append((-_agreement(manifest, environment), stored.folder.name, oracle))
    return min(found, key=lambda entry: entry[:2])[2] if found else None


def _telling(environment: Environment) -> dict[str, Scalar]:
    given = dict(environment.arguments)
    defaults = _TELLING.get(environment.id, {})
    return {name: given.get(name, default) for name, default in defaults.items()}


def _agreement(manifest: Manifest, environment: Environment) -> int:
    return len(set(manifest.environment.arguments) & set(environment.arguments))
