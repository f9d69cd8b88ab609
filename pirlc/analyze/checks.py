"""Every margin a second time, by another way.

Gain, phase and delay margins come back as the gains and rotations at which eigenvalues of the
closed loop cross the unit circle; peaks come back from a dense grid of a frequency response that is
composed of the plant's and the leaf's. What differs is an error (E0921), never a footnote.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pirlc.analyze.findings import Check, Margins
from pirlc.analyze.realisation import Complex, Real, Realisation, angles

TOLERANCE = 1e-6
"""Relative, of every figure."""

_HALF_TURN = 179.999
"""Degrees: where L only touches 1 (at rest, say), half a turn is no margin to speak of."""

_EDGE = 1e-10
_LARGEST_GAIN = 1e3
_MOST_WHOLE_DELAYS = 40

Response = Callable[[Complex], Complex]


def checks_of(
    loop: Realisation, composed: Response, found: Margins, sample_time: float | None
) -> tuple[Check, ...]:
    """The figures of a stable loop beside their second values. `composed` is L by another way."""
    rate = 1.0 / (sample_time or 1.0)
    factors = [c.margin for c in found.crossovers if c.kind == "phase"]
    lags = [math.radians(c.margin) for c in found.crossovers if c.kind == "gain"]
    up, down = _gain_edges(loop, factors)
    phase, delay = _rotation_edges(loop, lags)
    by_gain, by_turn = "gain at which an eigenvalue crosses", "rotation at which one crosses"
    checks = [
        _check("gain margin upward", found.gain_up, by_gain, up, _LARGEST_GAIN),
        _check("gain margin downward", found.gain_down, by_gain, down),
        _check("phase margin", found.phase, by_turn, math.degrees(phase), _HALF_TURN),
        _check(
            "delay margin",
            found.delay_samples,
            "rotation at which one crosses, whole delays",
            min(delay, _first_whole(loop, found)),
        ),
    ]
    grid = np.concatenate([[0.0], angles(loop, 3000)])
    peaks: tuple[tuple[str, float, Callable[[Complex], Complex]], ...] = (
        ("disk margin", 1.0 / found.disk, lambda v: 0.5 * (1.0 - v) / (1.0 + v)),
        ("sensitivity peak", found.sensitivity_peak, lambda v: 1.0 / (1.0 + v)),
        ("complementary peak", found.complementary_peak, lambda v: v / (1.0 + v)),
    )
    # On a pole of L itself these have no value: the grid's other points tell.
    with np.errstate(all="ignore"):
        for name, value, of in peaks:
            top = _grid_top(composed, of, grid)
            one, other = (1.0 / value, 1.0 / top) if name == "disk margin" else (value, top)
            checks.append(_check(name, one, "dense frequency grid", other))
        checks.append(_response_check(loop, composed, grid, rate))
    return tuple(checks)


def failed(check: Check) -> bool:
    return not check.difference <= check.tolerance


def _check(figure: str, value: float, by: str, again: float, limit: float = math.inf) -> Check:
    """`limit`: values above it count as infinite in both ways."""
    one, other = (math.inf if v > limit else v for v in (value, again))
    difference = 0.0 if one == other else abs(one - other) / max(abs(one), 1e-3)
    return Check(figure, value, by, again, difference, TOLERANCE)


def _outside(numbers: Complex) -> NDArray[np.int_]:
    """How many eigenvalues are outside the unit circle."""
    return np.asarray(np.count_nonzero(np.abs(numbers) > 1.0, axis=-1))


def _edges(loop: Realisation, gain: Callable[[Real], Complex], points: Real) -> list[float]:
    """Where the number of eigenvalues outside changes along ascending points, to the last digit."""
    if not len(points):
        return []
    counts = _outside(loop.closed_at(gain(points)))
    edges = []
    for i in np.flatnonzero(counts[1:] != counts[:-1]):
        low, high, before = float(points[i]), float(points[i + 1]), counts[i]
        for _ in range(200):
            middle = 0.5 * (low + high)
            if not low < middle < high:
                break
            if _outside(loop.closed(complex(gain(np.array([middle]))[0]))) == before:
                low = middle
            else:
                high = middle
        edges.append(0.5 * (low + high))
    return edges


def _around(points: list[float]) -> Real:
    """A little before and after each point, so that close edges are told apart."""
    return np.array([p * (1.0 + s) for p in points for s in (-1e-4, 1e-4)], dtype=np.float64)


def _gain_edges(loop: Realisation, factors: list[float]) -> tuple[float, float]:
    """The first gains above and below 1 at which the loop is no longer stable."""
    wide = np.geomspace(1.0 / _LARGEST_GAIN, _LARGEST_GAIN, 301)
    points = np.unique(np.concatenate([wide, [1.0], _around([k for k in factors if k > 0.0])]))
    above = _edges(loop, _as_complex, points[points >= 1.0])
    below = _edges(loop, _as_complex, points[points <= 1.0])
    return (above[0] if above else math.inf), (below[-1] if below else 0.0)


def _as_complex(gains: Real) -> Complex:
    return gains.astype(np.complex128)


def _turned(lags: Real) -> Complex:
    return np.asarray(np.exp(-1j * lags), dtype=np.complex128)


def _rotation_edges(loop: Realisation, lags: list[float]) -> tuple[float, float]:
    """The smallest rotation, and the smallest delay in samples, that make the loop unstable.

    A rotation by -phi of L crosses where an eigenvalue reaches exp(i theta): a delay of phi / theta
    samples turns L by as much there.
    """
    full = 2.0 * math.pi
    hints = [lag % full for lag in lags]
    points = np.unique(np.concatenate([np.linspace(1e-9, full - 1e-9, 241), _around(hints)]))
    points = points[(points > 0.0) & (points < full)]

    # Rotated loops are complex: those eigenvalues count that a positive frequency would have.
    edges = _edges(loop, _turned, points)
    phase, delay = math.inf, math.inf
    for phi in edges:
        numbers = loop.closed(complex(np.exp(-1j * phi)))
        theta = float(np.angle(numbers[np.argmin(np.abs(np.abs(numbers) - 1.0))]))
        phase = min(phase, phi, full - phi)
        if theta > 0.0:
            delay = min(delay, phi / theta)
    return phase, delay


def _first_whole(loop: Realisation, found: Margins) -> float:
    """The first whole delay, up to the margin, with which an eigenvalue is outside."""
    last = math.floor(min(found.delay_samples, _MOST_WHOLE_DELAYS))
    unstable = (
        n for n in range(1, last + 1) if np.max(np.abs(_delayed(loop, n).closed())) > 1.0 - _EDGE
    )
    return next(unstable, math.inf)


def _delayed(loop: Realisation, steps: int) -> Realisation:
    """L(z) / z^steps."""
    n = len(loop.b)
    a = np.zeros((n + steps, n + steps))
    b, c = np.zeros(n + steps), np.zeros(n + steps)
    a[:n, :n], a[:n, n + steps - 1] = loop.a, loop.b
    b[n] = 1.0
    for i in range(1, steps):
        a[n + i, n + i - 1] = 1.0
    c[:n], c[n + steps - 1] = loop.c, loop.d
    return Realisation(a, b, c)


def _grid_top(composed: Response, of: Callable[[Complex], Complex], grid: Real) -> float:
    """The largest value on a grid, looked at ever more closely around its top."""
    top = -math.inf
    for _ in range(4):
        sizes = np.abs(of(composed(np.exp(1j * grid))))
        sizes = np.where(np.isfinite(sizes), sizes, -math.inf)
        i = int(np.argmax(sizes))
        top = max(top, float(sizes[i]))
        low, high = grid[max(i - 1, 0)], grid[min(i + 1, len(grid) - 1)]
        grid = np.linspace(low, high, 401)
    return top


def _response_check(loop: Realisation, composed: Response, grid: Real, rate: float) -> Check:
    """The two frequency responses themselves, where they are furthest apart."""
    z = np.exp(1j * grid)
    one, other = loop.at(z), composed(z)
    # On the Riemann sphere: near a pole both are huge, which is the same.
    apart = np.abs(one - other) / np.sqrt((1.0 + np.abs(one) ** 2) * (1.0 + np.abs(other) ** 2))
    apart = np.where(np.isfinite(apart), apart, 0.0)
    i = int(np.argmax(apart))
    return Check(
        f"frequency response at {grid[i] * rate:.6g}", float(abs(one[i])),
        "plant and leaf composed", float(abs(other[i])), float(apart[i]), TOLERANCE,
    )  # fmt: skip
