"""The readings against the road that TORCS tells of."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pirlc.simulation.torcs.installation import Installation
from pirlc.simulation.torcs.protocol import COLUMN, FIRST_READING, Conditions, Status
from pirlc.simulation.torcs.readings import BEAM_DEGREES, READINGS
from pirlc.simulation.torcs.simulator import Course, TorcsProcess

RANGE = 200.0


def cast(
    edges: NDArray[np.float64], x: float, y: float, directions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Where rays first meet any piece of the road's edges, by trying them all."""
    sides = edges.reshape(-1, 2, 2).transpose(1, 0, 2)  # left and right, n points, x and y
    start = sides.reshape(-1, 2)
    along = (np.roll(sides, -1, axis=1) - sides).reshape(-1, 2)
    to_start = start - (x, y)
    rays = np.stack([np.cos(directions), np.sin(directions)], axis=1)[:, None, :]

    def cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
        return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]

    with np.errstate(divide="ignore", invalid="ignore"):
        distance = cross(to_start, along) / cross(rays, along)
        place = cross(to_start, rays) / cross(rays, along)
    met = (distance >= 0) & (place >= 0) & (place <= 1)
    return np.where(met, np.minimum(distance, RANGE), RANGE).min(axis=1)


def seen(process: TorcsProcess, swerve: float, gas: float, steps: int) -> NDArray[np.float64]:
    """Frames of a drive that swings from side to side, shape (n, columns)."""
    frame = process.begin(Conditions()).copy()
    frames = [frame]
    for step in range(steps):
        angle, place = frame[FIRST_READING + 1], frame[FIRST_READING + 2]
        wanted = swerve * np.sin(step / 35)
        steer = float(np.clip(8 * angle + 0.5 * (wanted - place), -1, 1))
        slow = 0.2 + 5 * (gas - frame[FIRST_READING])
        frame = process.step(steer, float(np.clip(slow, 0, 1)), 0.0).copy()
        frames.append(frame)
        if frame[0] != Status.RUNNING:
            break
    return np.array(frames)


@pytest.mark.parametrize("track", ["aalborg", "g-track-1", "alpine-2"])
def test_beams_end_where_the_road_does(torcs_installation: Installation, track: str) -> None:
    process = TorcsProcess(torcs_installation, Course(track))
    edges, length = process.track()
    frames = np.concatenate([seen(process, 0.0, 0.2, 2500), seen(process, 1.6, 0.18, 2500)])
    process.close()
    middle = edges.reshape(-1, 2, 2).mean(axis=1)
    steps = np.linalg.norm(np.roll(middle, -1, axis=0) - middle, axis=1)
    assert abs(steps.sum() - length) < 2.0
    on_road = frames[np.abs(frames[:, COLUMN["trackPos"]]) <= 0.99]
    beams = on_road[:, COLUMN["track0"] :] * RANGE
    degrees = np.radians(BEAM_DEGREES)
    worst = []
    for frame, read in zip(on_road[::7], beams[::7], strict=True):
        x, y, yaw = (float(frame[COLUMN[name]]) for name in ("x", "y", "yaw"))
        # Angles in the plane grow to the left, the first beam looks left.
        worst.append(np.abs(cast(edges, x, y, yaw - degrees) - read).max())
    assert len(worst) > 200
    assert max(worst) < 1e-3


def test_beams_look_back_where_the_car_does(torcs_installation: Installation) -> None:
    """Spun round and round, from the longest straight to the bends."""
    process = TorcsProcess(torcs_installation, Course("g-track-1"))
    edges, _ = process.track()
    worst, yaws = [], []
    frame = process.begin(Conditions())
    for step in range(1500):
        spinning = 330 < step < 900
        angle, place = frame[FIRST_READING + 1], frame[FIRST_READING + 2]
        steer = 1.0 if spinning else float(np.clip(8 * angle - 0.4 * place, -1, 1))
        frame = process.step(steer, 1.0, 0.0)
        if spinning and abs(frame[COLUMN["trackPos"]]) < 0.99:
            x, y, yaw = (float(frame[COLUMN[name]]) for name in ("x", "y", "yaw"))
            read = frame[COLUMN["track0"] :] * RANGE
            worst.append(np.abs(cast(edges, x, y, yaw - np.radians(BEAM_DEGREES)) - read).max())
            yaws.append(float(frame[COLUMN["angle"]]))
    process.close()
    assert max(np.abs(yaws)) > 0.75  # of a half turn: it did look back
    assert max(worst) < 1e-3


def test_off_the_road_there_are_no_beams(torcs_installation: Installation) -> None:
    process = TorcsProcess(torcs_installation, Course("aalborg"))
    frames = seen(process, 2.5, 0.2, 2000)
    process.close()
    off = np.abs(frames[:, COLUMN["trackPos"]]) > 1
    assert 10 < off.sum() < len(frames) - 10
    beams = frames[:, COLUMN["track0"] :]
    assert (beams[off] == -1 / 200).all()
    assert (beams[~off] >= 0).all() and (beams[~off] <= 1).all()


def test_the_scaled_readings_are_the_cars(torcs_installation: Installation) -> None:
    process = TorcsProcess(torcs_installation, Course("aalborg"))
    frames = seen(process, 0.6, 0.25, 800)
    edges, _ = process.track()
    process.close()
    column = {name: frames[:, place] for name, place in COLUMN.items()}
    np.testing.assert_allclose(column["speedX"], column["speed"] * 3.6 / 300, rtol=1e-12)
    np.testing.assert_allclose(
        column["trackPos"], 2 * column["to_middle"] / column["width"], rtol=1e-12
    )
    assert tuple(READINGS[6:10]) == tuple(f"wheelSpinVel{i}" for i in range(4))
    # Rolling: the wheels' speed is the car's over their radius, about 0.3 m.
    rolling = column["speed"] > 15
    ratio = column["speed"][rolling, None] / (frames[rolling][:, COLUMN["wheelSpinVel0"] :][:, :4])
    assert (np.abs(ratio / 100 - 0.32) < 0.06).all()
    # The angle is the road's direction less the car's: facing left of it, it is negative.
    moved = np.stack([np.gradient(column["x"]), np.gradient(column["y"])], axis=1)
    left = edges[:, :2]
    fast = np.flatnonzero(column["speed"] > 10)[::25]
    for i in fast:
        nearest = int(np.argmin(np.linalg.norm(left - (column["x"][i], column["y"][i]), axis=1)))
        road = left[(nearest + 1) % len(left)] - left[nearest]
        heading = np.arctan2(road[1], road[0]) - column["yaw"][i]
        heading = (heading + np.pi) % (2 * np.pi) - np.pi
        assert abs(heading / 3.1416 - column["angle"][i]) < 0.06
    # Turned left of the road's direction, the car goes to the left edge, where trackPos is 1.
    drift = np.gradient(column["to_middle"])[fast] / np.linalg.norm(moved[fast], axis=1)
    assert np.corrcoef(drift, -column["angle"][fast])[0, 1] > 0.8
    assert (column["rpm"] > 0).all() and column["rpm"].max() < 1.2
