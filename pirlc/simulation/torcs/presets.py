"""Rewards and endings of races, named for where they come from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum


class Reward(IntEnum):
    """What a step earns; the numbers are those of runtime/torcs/protocol.h.

    `NDPS`: ``v cos(a) - |v sin(a)| - v |p|`` with the speed v in km/h, the angle a to the road and
    the position p on it; -1 if the car was damaged (Verma et al. 2018). `GYM_TORCS`: ``v cos(a)``,
    or -1. `PROGRESS`: metres of road gained, less a tenth of the damage.
    """

    NDPS = 0
    GYM_TORCS = 1
    PROGRESS = 2


@dataclass(frozen=True)
class Termination:
    """When a race ends before its laps are done.

    `off_track`: the position |trackPos| beyond which the car is off the road. `slow_after`: steps
    after which driving slower than `slow` km/h along the road ends the race (None: never).
    `backwards`: whether facing backwards ends it.
    """

    off_track: float = math.inf
    slow_after: int | None = None
    slow: float = 5.0
    backwards: bool = False


REWARDS = {"ndps": Reward.NDPS, "gym_torcs": Reward.GYM_TORCS, "progress": Reward.PROGRESS}

TERMINATIONS = {
    "gym_torcs": Termination(off_track=1.0, slow_after=100, backwards=True),
    "ndps": Termination(off_track=2.7, slow_after=500, backwards=True),
    "none": Termination(),
}
