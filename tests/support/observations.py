"""Random observation sequences, the nasty ones included."""

from __future__ import annotations

import math
import random

import numpy as np
from numpy.typing import NDArray

from pirlc.ir.policy import Interface
from tests.support.programs import ODD_NUMBERS

OBSERVATION_SIZE = 5


def random_observations(
    rng: random.Random, interface: Interface, steps: int, nasty: bool = True
) -> NDArray[np.float64]:
    """Observation vectors (steps, 5).

    Readings wander in and around each sensor's range. `nasty` ones are at times missing (for a
    while, and from the start), zeros of either sign, denormal, huge, or at the very bounds.
    """
    table = np.array(
        [[rng.uniform(-1.0, 1.0) for _ in range(OBSERVATION_SIZE)] for _ in range(steps)]
    ).reshape(steps, OBSERVATION_SIZE)
    for sensor in interface.sensors:
        width = sensor.upper - sensor.lower
        missing_until = 0
        for t in range(steps):
            reading = sensor.lower + width * rng.random()
            if nasty:
                kind = rng.random()
                if t < missing_until or kind < 0.04:
                    reading = rng.choice([math.nan, math.inf, -math.inf])
                    if t >= missing_until:
                        missing_until = t + rng.randint(1, 7)
                elif kind < 0.10:
                    reading = rng.choice(ODD_NUMBERS)
                elif kind < 0.15:
                    reading = sensor.lower + width * rng.uniform(-1.0, 2.0)
                elif kind < 0.20:
                    reading = rng.choice([sensor.lower, sensor.upper])
                    reading = rng.choice([reading, float(np.float32(reading))])
                elif kind < 0.30 and t:
                    reading = float(table[t - 1, sensor.index])
            table[t, sensor.index] = reading
    if nasty and steps and rng.random() < 0.3:
        table[: rng.randint(1, min(steps, 6)), rng.choice(interface.sensors).index] = math.nan
    return table
