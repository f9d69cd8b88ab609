"""A loop as one state space: its frequency response, its closed-loop eigenvalues, its crossings.

Angles theta are in radians a sample: z = exp(i theta), from 0 to pi (the Nyquist frequency).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

Height = Callable[[float], tuple[float, float]]
"""A real function of the angle and its derivative."""

_NEAR = 1e-3
"""How far from the unit circle an eigenvalue of a pencil may be to be tried as a crossing."""

_STEPS = 60


@dataclass(frozen=True)
class Realisation:
    """L(z) = c (zI - a)^-1 b + d, of one input and one output; the loop closes as u = -(L u).

    a: (n, n), b: (n,), c: (n,).
    """

    a: Real
    b: Real
    c: Real
    d: float = 0.0

    def at(self, z: Complex) -> Complex:
        """L at points z (any shape); where z is a pole, nan or a huge number."""
        return self.c.astype(np.complex128) @ self._solved(z) + self.d

    def with_slope(self, z: complex) -> tuple[complex, complex]:
        """L and dL/dz at one point."""
        shifted = z * np.eye(len(self.b)) - self.a
        first = np.linalg.solve(shifted, self.b.astype(np.complex128))
        second = np.linalg.solve(shifted, first)
        return complex(self.c @ first) + self.d, -complex(self.c @ second)

    def closed(self, gain: complex = 1.0) -> Complex:
        """The closed loop's eigenvalues with L multiplied by `gain`."""
        factor = gain / (1.0 + gain * self.d)
        changed = self.a - factor * np.outer(self.b, self.c)
        return np.asarray(np.linalg.eigvals(changed), dtype=np.complex128)

    def closed_at(self, gains: Complex) -> Complex:
        """The same for many gains (N,) at once: (N, n)."""
        factors = gains / (1.0 + gains * self.d)
        changed = self.a - factors[:, None, None] * np.outer(self.b, self.c)
        numbers = np.linalg.eigvals(changed if np.any(changed.imag) else changed.real)
        return np.asarray(numbers, dtype=np.complex128)

    @cached_property
    def poles(self) -> Complex:
        return np.asarray(np.linalg.eigvals(self.a), dtype=np.complex128)

    def _solved(self, z: Complex) -> Complex:
        """(zI - a)^-1 b as (n, *z.shape)."""
        flat = np.atleast_1d(z).reshape(-1)
        n = len(self.b)
        shifted = flat[:, None, None] * np.eye(n) - self.a
        right = np.broadcast_to(self.b.astype(np.complex128)[:, None], (len(flat), n, 1))
        try:
            solved = np.linalg.solve(shifted, right)[..., 0]
        except np.linalg.LinAlgError:
            # A grid point on a pole: all others still count.
            solved = np.full((len(flat), n), np.nan, dtype=np.complex128)
            for i, matrix in enumerate(shifted):
                if np.linalg.cond(matrix) < 1e15:
                    solved[i] = np.linalg.solve(matrix, self.b)
        return np.ascontiguousarray(solved.T.reshape(n, *np.shape(z)))


def angles(realisation: Realisation, count: int = 1200) -> Real:
    """A grid of angles up to pi, dense at low ones and around the poles of open and closed loop."""
    parts = [np.geomspace(1e-6, np.pi, count // 2), np.linspace(0.0, np.pi, count // 2 + 1)[1:]]
    spread = np.concatenate(
        [-np.geomspace(1e-3, 30.0, 15)[::-1], [0.0], np.geomspace(1e-3, 30, 15)]
    )
    parts += [
        np.angle(pole) + spread * max(abs(1.0 - abs(pole)), 1e-6)
        for pole in (*realisation.poles, *realisation.closed())
        if pole.imag >= 0 and abs(pole) > 0.3
    ]
    whole = np.unique(np.concatenate(parts))
    return np.asarray(whole[(whole > 0.0) & (whole <= np.pi)], dtype=np.float64)


def gain_crossings(realisation: Realisation, level: float = 1.0, count: int = 1200) -> list[float]:
    """The angles in (0, pi] where |L| = level.

    They are zeros of level^2 - L(z) L(1/z), which are eigenvalues of a pencil, and sign changes on
    a grid of about `count` angles; each is then refined.
    """
    a, b, c, d = realisation.a, realisation.b[:, None], realisation.c[None, :], realisation.d
    n = len(realisation.b)
    eye, wide, tall = np.eye(n), np.zeros((n, n)), np.zeros((n, 1))
    left = np.block([
        [a, wide, b],
        [-b @ c, eye, -b * d],
        [-d * c, tall.T, np.array([[level**2 - d**2]])],
    ])  # fmt: skip
    right = np.block([[eye, wide, tall], [wide, a, tall], [tall.T, c, np.zeros((1, 1))]])

    def size(theta: float) -> tuple[float, float]:
        z = complex(np.exp(1j * theta))
        value, slope = realisation.with_slope(z)
        return float(np.log(abs(value) / level)), float((slope / value * 1j * z).real)

    with np.errstate(all="ignore"):
        return _refined(
            realisation,
            _on_circle(left, right),
            size,
            lambda values: np.log(np.abs(values) / level),
            angles(realisation, count),
        )


def phase_crossings(realisation: Realisation) -> list[tuple[float, float]]:
    """The angles in [0, pi] where L is real and negative, with the gain that brings L to -1 there.

    They are zeros of L(z) - L(1/z). Gains beyond 1e9 and below 1e-9 are left out: L has a zero
    or a pole there.
    """
    a, b, c = realisation.a, realisation.b[:, None], realisation.c[None, :]
    n = len(realisation.b)
    eye, wide, tall = np.eye(n), np.zeros((n, n)), np.zeros((n, 1))
    left = np.block([[a, wide, b], [wide, eye, -b], [c, tall.T, np.zeros((1, 1))]])
    right = np.block([[eye, wide, tall], [wide, a, tall], [tall.T, c, np.zeros((1, 1))]])

    def height(theta: float) -> tuple[float, float]:
        z = complex(np.exp(1j * theta))
        value, slope = realisation.with_slope(z)
        return value.imag / abs(value), float((slope * 1j * z).imag) / abs(value)

    with np.errstate(all="ignore"):
        found = _refined(
            realisation,
            _on_circle(left, right),
            height,
            lambda v: v.imag / np.abs(v),
            angles(realisation),
        )
        # Always real there, and no change of sign.
        found = [0.0, *(theta for theta in found if 1e-9 < theta < np.pi - 1e-9), np.pi]
        values = realisation.at(np.exp(1j * np.array(found)))
    return [
        (theta, -1.0 / float(value.real))
        for theta, value in zip(found, values, strict=True)
        if np.isfinite(value) and value.real < 0.0 and 1e-9 < abs(value) < 1e9
    ]


def _on_circle(left: Real, right: Real) -> list[float]:
    """The angles of a pencil's eigenvalues near the upper half of the unit circle."""
    import scipy.linalg

    numbers = scipy.linalg.eigvals(left, right)
    numbers = numbers[np.isfinite(numbers)]
    near = numbers[np.abs(np.abs(numbers) - 1.0) < _NEAR]
    return sorted({abs(float(np.angle(z))) for z in near})


def _refined(
    realisation: Realisation,
    starts: list[float],
    function: Height,
    values: Callable[[Complex], Real],
    grid: Real,
) -> list[float]:
    """Roots of a function of the angle, from starts and from sign changes on a grid."""
    from scipy.optimize import brentq

    found: list[float] = []
    for theta in starts:
        root = _newton(theta, function)
        if root is not None:
            found.append(root)
    heights = values(realisation.at(np.exp(1j * grid)))
    found += [
        float(brentq(lambda t: function(t)[0], grid[i], grid[i + 1], xtol=1e-15))
        for i in np.flatnonzero(heights[:-1] * heights[1:] < 0)
        if abs(heights[i]) + abs(heights[i + 1]) < 1.0
    ]
    if abs(values(realisation.at(np.array([-1.0 + 0j])))[0]) < 1e-12:
        found.append(np.pi)
    distinct: list[float] = []
    for theta in sorted(found):
        if not distinct or theta - distinct[-1] > 1e-9 * max(theta, 1e-3):
            distinct.append(theta)
    return distinct


def _newton(start: float, function: Height) -> float | None:
    """A root near `start`, or None where Newton's method leaves it."""
    theta = start
    try:
        for _ in range(_STEPS):
            value, slope = function(theta)
            step = value / slope
            theta -= step
            if not abs(theta - start) < 2e-2 * max(start, 1e-2):
                return None
            if abs(step) <= 4e-16 * max(abs(theta), 1e-3):
                break
        value, _ = function(theta)
    except (np.linalg.LinAlgError, ZeroDivisionError, FloatingPointError):
        return None
    return theta if abs(value) < 1e-9 and 0.0 < theta <= np.pi + 1e-12 else None
