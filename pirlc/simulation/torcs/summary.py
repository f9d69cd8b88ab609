"""A race in a few figures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from pirlc.simulation.torcs.protocol import Status, Trace


@dataclass(frozen=True)
class RaceSummary:
    """What is told about a race.

    `laps`: times (s) of the laps that were completed, the first from the start signal on. `time`:
    s from the start signal to the end. `steps`: commands given, those before the start signal
    included; the mean reward, the steering deviation and the largest position are over all of them.
    `distance`: m along the road from the place on the grid. `damage`: TORCS's points, 10,000 wreck
    the car. `mean_reward`: a step's. `largest_position`: of |trackPos|, 1 at the road's edge.
    `steering_deviation`: population standard deviation of the steering commands. `top_speed`: km/h.
    """

    status: Status
    laps: tuple[float, ...]
    time: float
    steps: int
    distance: float
    damage: float
    mean_reward: float
    largest_position: float
    steering_deviation: float
    top_speed: float

    @property
    def mean_lap(self) -> float:
        """Seconds; NaN without a completed lap."""
        return math.fsum(self.laps) / len(self.laps) if self.laps else math.nan


def summary(trace: Trace) -> RaceSummary:
    """The figures of a race. A race without a single step has NaN for means and deviations."""
    steering = trace.actions[:, 0]
    return RaceSummary(
        status=trace.status,
        laps=trace.laps,
        time=float(trace["time"][-1]),
        steps=len(steering),
        distance=float(trace["distance"][-1]),
        damage=float(trace["damage"][-1]),
        mean_reward=float(trace.rewards.mean()) if len(steering) else math.nan,
        largest_position=float(np.abs(positions(trace)).max()),
        steering_deviation=float(steering.std()) if len(steering) else math.nan,
        top_speed=float(trace["speed"].max()) * 3.6,
    )


def positions(trace: Trace) -> NDArray[np.float64]:
    """Shape (T + 1,): where on the road the car is, also where its sensor is blocked."""
    return 2.0 * trace["to_middle"] / trace["width"]


def outcome(figures: RaceSummary) -> str:
    """How the race ended, in words."""
    laps = f"{len(figures.laps)} lap{'' if len(figures.laps) == 1 else 's'}"
    where = f"after {figures.distance:,.0f} m"
    match figures.status:
        case Status.FINISHED:
            return f"finished {laps}"
        case Status.OFF_TRACK:
            return f"left the road {where}"
        case Status.TOO_SLOW:
            return f"too slow {where}"
        case Status.BACKWARDS:
            return f"turned backwards {where}"
        case Status.OUT:
            return f"taken out by TORCS {where}"
        case Status.TIME_LIMIT:
            return f"cut off {where}"
        case Status.BAD_ACTION:
            return f"ended by a command that is no number, {where}"
        case Status.NO_CONTROLLER | Status.RUNNING:
            return f"broke off {where}"
        case _:
            assert_never(figures.status)
