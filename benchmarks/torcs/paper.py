"""What Verma et al. (ICML 2018) report; lap times in s, distances in m."""

from __future__ import annotations

from dataclasses import dataclass

G_TRACK_1, AALBORG = "g-track-1", "aalborg"

TRAINING = (G_TRACK_1, AALBORG)

TITLES = {
    G_TRACK_1: "CG-Speedway-1",
    AALBORG: "Aalborg",
    "g-track-2": "CG track 2",
    "eroad": "E-Road",
    "alpine-2": "Alpine 2",
    "ruudskogen": "Ruudskogen",
}
"""The tracks' names in the paper."""

TRANSFER = {G_TRACK_1: ("g-track-2", "eroad"), AALBORG: ("alpine-2", "ruudskogen")}
"""By the track trained on, the tracks raced on."""


@dataclass(frozen=True)
class Lap:
    """The mean of three laps, and the mean reward of a step."""

    time: float
    reward: float


@dataclass(frozen=True)
class Crash:
    distance: float


DRL, NAIVE, NOIF, NDPS = "DRL", "Naive", "NoIF", "NDPS"

PERFORMANCE: dict[tuple[str, str], Lap] = {
    (DRL, G_TRACK_1): Lap(54.27, 118.39),
    (DRL, AALBORG): Lap(109.66, 71.23),
    (NAIVE, G_TRACK_1): Lap(127.09, 58.72),
    (NOIF, G_TRACK_1): Lap(61.60, 115.25),
    (NOIF, AALBORG): Lap(165.13, 52.81),
    (NDPS, G_TRACK_1): Lap(61.56, 115.32),
    (NDPS, AALBORG): Lap(158.87, 54.91),
}
"""Table performance. What is not in it did not finish within the time."""

SMOOTHNESS: dict[tuple[str, str], float] = {
    (DRL, G_TRACK_1): 0.5981,
    (DRL, AALBORG): 0.9008,
    (NDPS, G_TRACK_1): 0.1312,
    (NDPS, AALBORG): 0.2483,
}
"""Table smoothness: population standard deviation of the steering."""

BLOCKED: dict[tuple[str, str], dict[float, float]] = {
    (DRL, G_TRACK_1): {0.5: 21, 0.9: 17},
    (DRL, AALBORG): {0.5: 71, 0.9: 20},
    (NDPS, G_TRACK_1): {0.5: 1976, 0.9: 200},
    (NDPS, AALBORG): {0.5: 1477, 0.9: 287},
}
"""Table partial: the distance raced by the probability that RPM and TrackPos are blocked."""

TRANSFERRED: dict[tuple[str, str], Lap | Crash] = {
    (DRL, "g-track-2"): Crash(1608),
    (DRL, "eroad"): Crash(1902),
    (NDPS, "g-track-2"): Lap(100.57, 110.18),
    (NDPS, "eroad"): Lap(111.59, 98.21),
    (DRL, "alpine-2"): Crash(1688),
    (DRL, "ruudskogen"): Crash(3232),
    (NDPS, "alpine-2"): Lap(196.68, 67.49),
    (NDPS, "ruudskogen"): Lap(199.77, 57.69),
}
"""Tables cgspeed and aalborg."""
