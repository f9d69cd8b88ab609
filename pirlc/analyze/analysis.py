"""The control theory of a program: the one call that makes an `Analysis`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from pirlc.analyze.findings import Analysis, Leaf, LoopFinding, Plant, ResponseFinding
from pirlc.analyze.relay import relays_of, switches
from pirlc.analyze.transfer import leaves_of, operating_point
from pirlc.ir.policy import Environment, Program

if TYPE_CHECKING:
    from pirlc.analyze.pid import RestGain


def analyze(
    program: Program,
    plant: Plant | None = None,
    *,
    at: Mapping[str, float] | None = None,
    latency: int | None = None,
    sample_time: float | None = None,
    simulator: Environment | None = None,
    trust: bool = False,
) -> Analysis:
    """Leaves of every action; with a plant the loops, the relays and the switching too.

    `at`: readings and actions by name to linearise at, instead of the plant's operating point (and
    the middle of the range where there is neither). `latency` (steps) and `sample_time` (seconds)
    instead of the program's; without either sample time the plant's, else times are in steps.
    `simulator`: where to compare the stable loops at the operating point with what is simulated
    (the program's own latency is simulated).

    Raises PirlcError E0921 where two ways to a margin disagree, and E0501 to E0518 for `simulator`.
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
            interface.name, seconds, delay, leaves, relays=relays,
            notes=(*notes, "no plant: no loops, no margins"),
        )  # fmt: skip
    from pirlc.analyze.loop import loops_of
    from pirlc.analyze.switching import switching_of

    linear = [leaf for leaf in leaves if not switches(_of(leaves, leaf.action))]
    loops, more = loops_of(linear, plant, delay, seconds)
    return Analysis(
        program=interface.name,
        sample_time=seconds,
        latency=delay,
        leaves=leaves,
        plant=plant,
        loops=loops,
        relays=relays,
        switching=switching_of(plant, linear, delay) if linear else (),
        responses=_responses(program, simulator, plant, linear, loops, delay, trust),
        notes=(*notes, *more),
    )


def _responses(
    program: Program,
    simulator: Environment | None,
    plant: Plant,
    leaves: list[Leaf],
    loops: tuple[LoopFinding, ...],
    latency: int,
    trust: bool,
) -> tuple[ResponseFinding, ...]:
    """Of the stable loops whose leaf is taken at the operating point."""
    if simulator is None or latency != program.interface.latency:
        return ()
    from pirlc.analyze.response import response_of

    stable = {loop.leaf for loop in loops if loop.stable}
    taken = [leaf for leaf in leaves if leaf.active and leaf.action in plant.inputs]
    return tuple(
        response_of(
            program, simulator, plant, leaf, [o for o in taken if o.action != leaf.action],
            trust=trust,
        )
        for leaf in taken
        if leaf.name in stable
    )  # fmt: skip


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
