"""Observation streams that lead a controller into its corners."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pirlc.ir.policy import Program
from pirlc.ir.terms import Literal, subterms
from tests.support.programs import ODD_NUMBERS

Stream = NDArray[np.float64]

_MISSING = np.array([math.nan, math.inf, -math.inf])
_CALM = 256
"""Readings change their manner, from wandering to jumping and back, every so many steps."""


def stream(program: Program, steps: int, seed: int) -> Stream:
    """Readings (steps, sensors), in the order of the program's sensors.

    Half of the time they wander through the sensors' ranges (so that guards on differences see
    small ones), half of the time they jump. Every twelfth or so is missing, in runs of up to
    twenty, now and then from the start on; others are bounds of the range and their neighbours, far
    outside, denormal, zeros of either sign, huge, or one of the program's own constants or next to
    it, where guards switch.
    """
    rng = np.random.default_rng([seed, steps])
    sensors = program.interface.sensors
    constants = _constants(program)
    table = np.empty((steps, len(sensors)))
    for column, sensor in enumerate(sensors):
        low, width = sensor.lower, sensor.upper - sensor.lower
        jumps = low + width * rng.random(steps)
        walk = np.cumsum(rng.standard_normal(steps)) * rng.choice([0.001, 0.02])
        wander = low + width * (0.5 + 0.5 * np.sin(walk + rng.uniform(0, 6)))
        calm = rng.random(steps // _CALM + 1) < 0.5
        readings = np.where(np.repeat(calm, _CALM)[:steps], wander, jumps)
        odd = np.array(ODD_NUMBERS)
        bounds = np.array([low, low + width, np.float64(np.float32(low)), sensor.upper])
        bounds = np.concatenate(
            [bounds, np.nextafter(bounds, -np.inf), np.nextafter(bounds, np.inf)]
        )
        kind = rng.random(steps)
        for below, pool in (
            (0.04, constants),
            (0.06, odd),
            (0.09, bounds),
            (0.11, low + width * np.array([-1.0, -0.01, 1.01, 2.0, 100.0])),
        ):
            chosen = (kind < below) & (kind >= below - 0.02)
            readings[chosen] = rng.choice(pool, int(chosen.sum()))
        repeats = np.flatnonzero((kind >= 0.11) & (kind < 0.16) & (np.arange(steps) > 0))
        readings[repeats] = readings[repeats - 1]
        _miss(rng, readings)
        table[:, column] = readings
    return table


def _miss(rng: np.random.Generator, readings: NDArray[np.float64]) -> None:
    """Blanks runs of readings."""
    steps = len(readings)
    starts = np.flatnonzero(rng.random(steps) < 0.02)
    if rng.random() < 0.3:
        starts = np.append(starts, 0)
    lengths = np.minimum(rng.geometric(0.25, len(starts)), 20)
    places = np.concatenate(
        [np.arange(s, s + n) for s, n in zip(starts, lengths, strict=True)] or [np.arange(0)]
    )
    places = places[places < steps]
    readings[places] = rng.choice(_MISSING, len(places))


def _constants(program: Program) -> NDArray[np.float64]:
    """Parameters and literals, their negatives, and the numbers next to them."""
    values = [p.value for p in program.parameters]
    for body in program.bodies:
        values += [sub.value for sub in subterms(body) if isinstance(sub, Literal)]
    known = np.array([0.0, *values])
    known = np.concatenate([known, -known])
    with np.errstate(over="ignore"):
        near = [known, np.nextafter(known, np.inf), np.nextafter(known, -np.inf)]
    return np.concatenate(near)
