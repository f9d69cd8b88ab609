"""Plants by differences of one step of a simulator that can be put into a state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from pirlc.analyze.plants.equations import OperatingPoint
from pirlc.analyze.plants.problems import NoEquilibrium, failure
from pirlc.analyze.plants.states import Resettable, Vector

_WIDTHS = 10.0 ** -np.arange(1.0, 6.5, 0.5)
"""Widths of differences to choose from, in units of max(1, |x|)."""

_INSET = 0.02
"""How far inside its range an action must rest, as a share of it."""

REST = 1e-5
"""A state is at rest if a step changes none of its components by more than this, relatively."""


@dataclass(frozen=True)
class Derivatives:
    """x' = A dx + B du and the reading dy = C dx, at a point; `error` is the largest difference
    between the estimates of two widths."""

    a: Vector
    b: Vector
    c: Vector
    observation: Vector
    error: float


def find_rest(system: Resettable, state: Vector, action: Vector, identifier: str) -> OperatingPoint:
    """The state and action near the given ones that a step does not change.

    A discrete action is kept. Raises PirlcError E0933.
    """
    space: Any = system.simulator.action_space
    free = hasattr(space, "low")
    scale = np.maximum(1.0, np.abs(state))
    # At a bound of the action there is no derivative to both sides.
    low = np.full(system.size, -np.inf)
    high = np.full(system.size, np.inf)
    start = state.copy()
    if free:
        ends = np.array(space.low, np.float64), np.array(space.high, np.float64)
        inset = _INSET * np.minimum(ends[1] - ends[0], 2.0)
        bounds = ends[0] + inset, ends[1] - inset
        start = np.concatenate([state, np.clip(action, bounds[0] + 1e-9, bounds[1] - 1e-9)])
        low, high = np.concatenate([low, bounds[0]]), np.concatenate([high, bounds[1]])

    def drift(point: Vector) -> Vector:
        chosen = point[system.size :] if free else action
        after, _ = system.advance(point[: system.size], chosen)
        return (after - point[: system.size]) / scale

    step = 1e-3 if system.resolution > 1e-10 else 1e-6
    best = least_squares(drift, start, bounds=(low, high), diff_step=step, xtol=1e-14, gtol=1e-14)
    worst = float(np.max(np.abs(drift(best.x))))
    if not worst <= REST:
        raise failure(NoEquilibrium(identifier, worst))
    # The last digits are where the search happened to stop.
    rest = np.round(best.x, 12) + 0.0
    found = tuple(map(float, rest[: system.size]))
    chosen = tuple(map(float, rest[system.size :] if free else action))
    return OperatingPoint("at rest", found, chosen)


def differences(system: Resettable, point: OperatingPoint) -> Derivatives:
    """Central differences of one step, of fourth order, with the width at which they agree best.

    A reading is of the state that a step ends in, so C is what explains the readings' differences
    by the states' (least squares). A discrete action is taken as a number on the line through its
    least and greatest values.
    """
    x0, u0 = np.array(point.state), np.array(point.action)
    space: Any = system.simulator.action_space
    columns, errors = [], []
    for i in range(len(x0)):
        direction = np.zeros(len(x0))
        direction[i] = max(1.0, abs(x0[i]))
        column, error = _best(system, x0, u0, direction, np.zeros(len(u0)))
        columns.append(column / direction[i])
        errors.append(error / direction[i])
    for i in range(len(u0)):
        if hasattr(space, "low"):
            direction = np.zeros(len(u0))
            room = min(float(space.high[i]) - u0[i], u0[i] - float(space.low[i]))
            direction[i] = min(1.0, room / 0.3) if room > 1e-3 else 1e-3
            column, error = _best(system, x0, u0, np.zeros(len(x0)), direction)
            columns.append(column / direction[i])
            errors.append(error / direction[i])
        else:
            first, last = float(space.start), float(space.start + space.n - 1)
            ends = [np.concatenate(system.advance(x0, np.array([end]))) for end in (first, last)]
            columns.append(_unwrapped(ends[1] - ends[0]) / (last - first))
    n = len(x0)
    jacobian = np.stack(columns, axis=1)
    ab, readings = jacobian[:n], jacobian[n:]
    c = readings @ np.linalg.pinv(ab, rcond=1e-9)
    _, observation = system.advance(x0, u0)
    return Derivatives(ab[:, :n], ab[:, n:], c, observation, float(max(errors)))


def _best(
    system: Resettable, x0: Vector, u0: Vector, dx: Vector, du: Vector
) -> tuple[Vector, float]:
    """The derivative along (dx, du) and how well that of the state is known.

    State and observation each have the width that suits their rounding.
    """
    middle = np.concatenate(system.advance(x0, u0))

    def at(width: float) -> Vector:
        sides = [
            _unwrapped(
                np.concatenate(system.advance(x0 + k * width * dx, u0 + k * width * du)) - middle
            )
            for k in (-2.0, -1.0, 1.0, 2.0)
        ]
        slope: Vector = (sides[0] - 8.0 * sides[1] + 8.0 * sides[2] - sides[3]) / (12.0 * width)
        return slope

    estimates = np.array([at(width) for width in _WIDTHS])
    gaps = np.abs(np.diff(estimates, axis=0))
    found = np.zeros(len(middle))
    n = len(x0)
    error = 0.0
    for part, resolution in ((slice(0, n), system.resolution), (slice(n, None), system.seen)):
        size = max(1.0, float(np.max(np.abs(middle[part]), initial=0.0)))
        worst = gaps[:, part].max(axis=1, initial=0.0) + resolution * size / _WIDTHS[:-1]
        best = int(np.argmin(worst))
        found[part] = estimates[best][part]
        error = error or float(worst[best])
    return found, error


def _unwrapped(difference: Vector) -> Vector:
    """What jumps by a whole turn is an angle."""
    turns = np.round(difference / (2.0 * np.pi))
    rest = difference - turns * 2.0 * np.pi
    return np.where((turns != 0.0) & (np.abs(rest) < 1.0), rest, difference)
