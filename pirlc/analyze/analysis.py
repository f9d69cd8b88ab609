"""The control theory of a program: the one call that makes an `Analysis`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from pirlc.analyze.findings import Analysis, Leaf, Plant, ResponseFinding
from pirlc.analyze.relay import relays_of, switches
from pirlc.analyze.transfer import leaves_of, operating_point
from pirlc.ir.policy import Program

if TYPE_CHECKING:
    from pirlc.analyze.pid import RestGain


def analyze(
    program: Program,
    plant: Plant | None = None,
    *,
    at: Mapping[str, float] | None = None,
    latency: int | None = None,
    sample_time: float | None = None,
    responses: tuple[ResponseFinding, ...] = (),
) -> Analysis:
    """Leaves of every action; with a plant the loops, the relays and the switching too.

    `at`: readings and actions by name to linearise at, instead of the plant's operating point (and
    the middle of the range where there is neither). `latency` (steps) and `sample_time` (seconds)
    instead of the program's; without either sample time the plant's, else times are in steps.
    `responses` are put in as they are.

    Raises PirlcError E0921 where two ways to a margin disagree.
    """
    interface = program.interface
    delay = interface.latency if latency is None else latency
    seconds = sample_time or interface.sample_time or (plant.sample_time if plant else None)
    point = operating_point(program, {**(plant.operating if plant else {}), **(at or {})})
    leaves, notes = leaves_of(program, point, _rest_gain(plant))
    relays, more = relays_of(program, leaves, point, plant, delay, seconds)
    notes = (*notes, *more)
    if plant is None:
        return Analysis(
            interface.name, seconds, delay, leaves, relays=relays, responses=responses,
            notes=(*notes, "no plant: no loops, no margins"),
        )  # fmt: skip
    from pirlc.analyze.loop import loops_of
    from pirlc.analyze.switching import switching_of

    linear = [leaf for leaf in leaves if not switches(_of(leaves, leaf.action))]
    loops, more = loops_of(linear, plant, delay, seconds)
    switching = switching_of(plant, linear, delay) if linear else None
    return Analysis(
        program=interface.name,
        sample_time=seconds,
        latency=delay,
        leaves=leaves,
        plant=plant,
        loops=loops,
        relays=relays,
        switching=() if switching is None else (switching,),
        responses=responses,
        notes=(*notes, *more),
    )


def _of(leaves: tuple[Leaf, ...], action: str) -> list[Leaf]:
    return [leaf for leaf in leaves if leaf.action == action]


def _rest_gain(plant: Plant | None) -> RestGain | None:
    """The plant's gain at rest from an action to a sensor, the other actions held."""
    if plant is None:
        return None
    import numpy as np

    from pirlc.analyze.assembly import visible
    from pirlc.analyze.realisation import Realisation

    def gain(action: str, sensor: str) -> float | None:
        if action not in plant.inputs or sensor not in plant.outputs:
            return None
        a, b, c = (np.array(m, dtype=np.float64) for m in (plant.a, plant.b, plant.c))
        b, c = b[:, plant.inputs.index(action)], c[plant.outputs.index(sensor)]
        part = visible(Realisation(a, b, c))
        if not len(part.b):
            return 0.0
        if np.min(np.abs(part.poles - 1.0)) < 1e-9:
            return math.inf
        return float(part.at(np.array([1.0 + 0.0j]))[0].real)

    return gain
