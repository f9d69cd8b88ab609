"""The 29 readings of a TORCS car, by name and in the order of the reference experiments."""

from __future__ import annotations

BEAM_DEGREES = (
    *(-45.0, -19.0, -12.0, -7.0, -4.0, -2.5, -1.7, -1.0, -0.5, 0.0),
    *(0.5, 1.0, 1.7, 2.5, 4.0, 7.0, 12.0, 19.0, 45.0),
)
"""Where the range finders look, clockwise from the car's axis."""

READINGS = (
    *("speedX", "angle", "trackPos", "speedY", "speedZ", "rpm"),
    *(f"wheelSpinVel{i}" for i in range(4)),
    *(f"track{i}" for i in range(len(BEAM_DEGREES))),
)
"""Scaled: speeds are in 300 km/h, the angle in half turns (of 3.1416 rad), the engine's speed in
1,000 rad/s, the wheels' in 100 rad/s, the beams in 200 m; `trackPos` is 1 at the left edge."""

FIRST_BEAM = READINGS.index("track0")
"""The readings from here on are the beams, the costly ones."""

ACTIONS = ("steer", "accel", "brake")
"""Steering from -1 (right) to 1 (left), accelerator and brake from 0 to 1."""
