"""Margins of a stable loop in discrete time, to rounding.

python-control looks for crossings among the roots of polynomials or on a grid and leaves out z = 1
and z = -1; here they are eigenvalues of pencils, refined, and both ends count: at the Nyquist
frequency L is real, and a gain that brings it to -1 makes a loop ring at half the sample rate.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from pirlc.analyze.findings import Crossover, Margins
from pirlc.analyze.realisation import (
    Real,
    Realisation,
    angles,
    gain_crossings,
    phase_crossings,
)

_REST = 1e-7
"""Below this angle a crossing is at rest: L is 1 there, half a turn from the edge."""


def margins_of(loop: Realisation, sample_time: float | None) -> Margins:
    """The margins of a loop whose closed poles all lie inside the unit circle."""
    rate = 1.0 / (sample_time or 1.0)
    factors = [(factor, theta) for theta, factor in phase_crossings(loop)]
    phases = []
    for theta in gain_crossings(loop):
        if theta < _REST:
            continue
        value = loop.at(np.array([np.exp(1j * theta)]))[0]
        phases.append((lag_to_edge(complex(value)), theta))
    up = min(((k, t) for k, t in factors if k > 1.0), default=(math.inf, None))
    down = max(((k, t) for k, t in factors if k < 1.0), default=(0.0, None))
    phase = min(((min(lag, 2.0 * math.pi - lag), t) for lag, t in phases), default=(math.inf, None))
    delay = min((lag / theta for lag, theta in phases), default=math.inf)
    if abs(loop.at(np.array([-1.0 + 0.0j]))[0]) > 1.0:
        # At z = -1 a further delay of one sample turns L from one side of -1 to the other.
        delay = min(delay, 1.0)
    disk, disk_theta = peak(half_difference(loop))
    sensitive, sensitive_theta = peak(sensitivity(loop))
    complementary, complementary_theta = peak(complement(loop))
    alpha = 1.0 / disk
    return Margins(
        gain_up=up[0],
        gain_up_frequency=_scaled(up[1], rate),
        gain_down=down[0],
        gain_down_frequency=_scaled(down[1], rate),
        phase=math.degrees(phase[0]),
        phase_frequency=_scaled(phase[1], rate),
        delay_samples=delay,
        delay_seconds=None if sample_time is None else delay * sample_time,
        disk=alpha,
        disk_gain=disk_gains(alpha),
        disk_phase=math.degrees(2.0 * math.atan(alpha / 2.0)),
        disk_frequency=disk_theta * rate,
        sensitivity_peak=sensitive,
        sensitivity_frequency=sensitive_theta * rate,
        complementary_peak=complementary,
        complementary_frequency=complementary_theta * rate,
        crossovers=tuple(
            sorted(
                (
                    *(Crossover("phase", theta * rate, k) for k, theta in factors),
                    *(Crossover("gain", theta * rate, _wrapped(lag)) for lag, theta in phases),
                ),
                key=lambda crossover: crossover.frequency,
            )
        ),
    )


def lag_to_edge(value: complex) -> float:
    """The lag in (0, 2 pi] that turns a number of size 1 to -1."""
    lag = (math.atan2(value.imag, value.real) + math.pi) % (2.0 * math.pi)
    return lag or 2.0 * math.pi


def _wrapped(lag: float) -> float:
    """In degrees, above -180 and up to 180."""
    return math.degrees(lag if lag <= math.pi else lag - 2.0 * math.pi)


def _scaled(theta: float | None, rate: float) -> float | None:
    return None if theta is None else theta * rate


def disk_gains(alpha: float) -> tuple[float, float]:
    """The factors of gain that a symmetric disk of this size covers."""
    half = alpha / 2.0
    if half >= 1.0:
        return 0.0, math.inf
    return (1.0 - half) / (1.0 + half), (1.0 + half) / (1.0 - half)


def sensitivity(loop: Realisation) -> Realisation:
    """1 / (1 + L). The minus of `complement` and its 1 come from L = c (zI - a)^-1 b + d."""
    return_ratio = 1.0 / (1.0 + loop.d)
    return Realisation(
        loop.a - return_ratio * np.outer(loop.b, loop.c),
        loop.b * return_ratio,
        -loop.c * return_ratio,
        return_ratio,
    )


def complement(loop: Realisation) -> Realisation:
    """L / (1 + L) = 1 - 1 / (1 + L)."""
    s = sensitivity(loop)
    return Realisation(s.a, s.b, -s.c, 1.0 - s.d)


def half_difference(loop: Realisation) -> Realisation:
    """(S - T) / 2 = S - 1/2, whose peak is one over the symmetric disk margin."""
    s = sensitivity(loop)
    return Realisation(s.a, s.b, s.c, s.d - 0.5)


def peak(system: Realisation) -> tuple[float, float]:
    """The largest |G| on the unit circle of a stable system and its angle in [0, pi].

    Bruinsma and Steinbuch's method (Systems & Control Letters 14, 1990): the level is raised until
    |G| crosses it nowhere; the crossings are those of `gain_crossings`. The last step climbs.
    """
    ends = np.array([0.0, np.pi])
    grid = np.concatenate([ends, angles(system, 400)])
    best = _top(lambda t: np.abs(system.at(np.exp(1j * t))), grid)
    for _ in range(20):
        best = _climb(system, best)
        level = best[0] * (1.0 + 1e-7)
        crossings = gain_crossings(system, level, 300)
        if not crossings:
            break
        points = np.array([0.0, *crossings, np.pi])
        between = _top(
            lambda t: np.abs(system.at(np.exp(1j * t))), (points[1:] + points[:-1]) / 2.0
        )
        if between[0] <= level:
            break
        best = between
    return best


def _top(size: Callable[[Real], Real], at: Real) -> tuple[float, float]:
    sizes = size(at)
    i = int(np.argmax(sizes))
    return float(sizes[i]), float(at[i])


def _climb(system: Realisation, start: tuple[float, float]) -> tuple[float, float]:
    """The local top near a point: the ends of [0, pi] have slope 0, so all tops are inside or
    there."""
    value, theta = start
    width = 1e-2
    while width > 1e-9:
        near = np.clip(np.linspace(theta - width, theta + width, 21), 0.0, np.pi)
        found = _top(lambda t: np.abs(system.at(np.exp(1j * t))), near)
        at_edge = found[1] in (near[0], near[-1]) and found[1] not in (0.0, np.pi)
        if found[0] > value:
            value, theta = found
        else:
            at_edge = False
        width *= 1.0 if at_edge else 0.2
    return value, theta
