"""Finds out by racing whether an installation of TORCS is what races for pirlc need."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable
from itertools import pairwise

from pirlc.simulation.torcs.installation import CONTROL_INTERVAL, Installation
from pirlc.simulation.torcs.installation_problems import Unfit, failure

TRACKS = ("g-track-1", "g-track-2", "eroad", "aalborg", "alpine-2", "ruudskogen")
"""The tracks of the reference experiments."""

CATEGORY = "road"

_STEPS = 50

_PHYSICS = 0.0021
"""TORCS's own steps are of 0.002 s, and now and then one more goes by before a command."""

_START = 500
"""Steps after which the start signal is overdue: it comes after two seconds."""


def control_interval(installation: Installation) -> float:
    """The time (s) from one command to the next, in a race. Raises PirlcError E0525."""
    from pirlc.simulation.torcs.protocol import COLUMN, Conditions
    from pirlc.simulation.torcs.simulator import Course, TorcsDied, TorcsHangs, TorcsProcess

    times: list[float] = []
    try:
        process = TorcsProcess(installation, Course(TRACKS[0], CATEGORY))
        try:
            time = float(process.begin(Conditions(), beams=False)[COLUMN["time"]])
            for _ in range(_START):
                if time > 0:
                    times.append(time)
                if len(times) > _STEPS:
                    break
                time = float(process.step(0.0, 0.0, 0.0)[COLUMN["time"]])
        finally:
            process.close()
    except (TorcsDied, TorcsHangs) as error:
        raise failure(Unfit(f"a race on {TRACKS[0]} failed: {error}")) from error
    steps = [later - earlier for earlier, later in pairwise(times)]
    if len(steps) < _STEPS:
        raise failure(Unfit("the start signal does not come"))
    interval = statistics.median(steps)
    if abs(interval - CONTROL_INTERVAL) > 1e-6 or max(steps) > CONTROL_INTERVAL + _PHYSICS:
        raise failure(
            Unfit(
                f"it asks robots for a command every {interval:.3g} s, "
                f"where {CONTROL_INTERVAL:g} s are needed"
            )
        )
    return CONTROL_INTERVAL


def track_lengths(
    installation: Installation, told: Callable[[str], None] = lambda _: None
) -> dict[str, float]:
    """The length (m) of each of `TRACKS`, from TORCS itself. Raises PirlcError E0525."""
    from pirlc.simulation.torcs.simulator import Course, TorcsDied, TorcsHangs, TorcsProcess

    categories = installation.tracks
    lengths: dict[str, float] = {}
    for track in TRACKS:
        if categories.get(track) != CATEGORY:
            raise failure(Unfit(f"it has no {CATEGORY} track called {track}"))
        try:
            process = TorcsProcess(installation, Course(track, CATEGORY))
            try:
                _, length = process.track()
            finally:
                process.close()
        except (TorcsDied, TorcsHangs) as error:
            raise failure(Unfit(f"the track {track} cannot be loaded: {error}")) from error
        if not (math.isfinite(length) and length > 0):
            raise failure(Unfit(f"the track {track} has no length"))
        lengths[track] = round(length, 3)
        told(track)
    return lengths
