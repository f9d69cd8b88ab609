"""Filters that are PID controllers, and what remains of an error at rest."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction

from pirlc.analyze.findings import Filter, PidForm, Recall

RestGain = Callable[[str, str], float | None]
"""The plant's gain at rest from an action to a sensor; inf: it integrates; None: unknown."""


def pid_forms(
    action: str,
    filters: tuple[Filter, ...],
    recalls: tuple[Recall, ...],
    offset: Fraction,
    rest_gain: RestGain | None,
) -> tuple[tuple[PidForm, ...], tuple[str, ...]]:
    """The filters with the shape of a PID, and notes on their reading.

    A single reading of one of several sensors (a state feedback) is not called one.
    """
    own = sum((r.coefficient for r in recalls if r.action == action), Fraction(0))
    forms: list[PidForm] = []
    notes: list[str] = []
    for filter_ in filters:
        if len(filters) > 1 and len(filter_.coefficients) == 1:
            continue
        gains = pid_gains(filter_.coefficients)
        if gains is None:
            continue
        kp, ki, kd, window = gains
        dc = kp + window * ki
        setpoint = offset / dc if dc and len(filters) == 1 else None
        gain = 1.0 if rest_gain is None else rest_gain(action, filter_.sensor)
        share = error_share(float(dc), float(own), gain)
        words = steady_state(kp, ki, window, own, gain, share, rest_gain is not None)
        forms.append(PidForm(filter_.sensor, kp, ki, kd, setpoint, window, dc, gain, share, words))
        if len(filter_.coefficients) == 2:
            notes.append(
                f"over two readings of {filter_.sensor} a sum and a difference cannot be told "
                "apart: written with a difference"
            )
    return tuple(forms), tuple(notes)


def pid_gains(
    coefficients: tuple[Fraction, ...],
) -> tuple[Fraction, Fraction, Fraction, int] | None:
    """kp, ki, kd and the length n of the sum, or None where no PID has these coefficients.

    The coefficients of kp e0 + ki (e0 + ... + e[n-1]) + kd (e0 - e1), e = -reading, are
    -(kp + ki + kd), kd - ki, -ki, ..., -ki. The error's sign is such that it is setpoint - reading;
    gains that are all negative mean a law that acts the other way round.
    """
    first, *rest = coefficients
    if not rest:
        return -first, Fraction(0), Fraction(0), 1
    second, *tail = rest
    ki = -tail[0] if tail else Fraction(0)
    if any(-coefficient != ki for coefficient in tail):
        return None
    kd = second + ki
    return -first - ki - kd, ki, kd, len(coefficients) if ki else 1


def error_share(dc: float, own: float, gain: float | None) -> float | None:
    """What remains at rest of a setpoint change, with a loop of gain `dc / (1 - own) * gain`."""
    if gain is None:
        return None
    if own == 1.0 or math.isinf(gain):
        return 0.0 if dc and gain else 1.0
    loop = dc / (1.0 - own) * gain
    return None if loop == -1.0 else 1.0 / (1.0 + loop)


def steady_state(
    kp: Fraction,
    ki: Fraction,
    window: int,
    own: Fraction,
    gain: float | None,
    share: float | None,
    plant: bool,
) -> str:
    dc = kp + window * ki
    if own == 1:
        return "true integral action through `previous`: no error remains at rest"
    parts = []
    if ki:
        parts.append(
            f"the integral is a sum over {window} readings: the gain at rest is "
            f"kp + {window} ki = {float(dc):.6g}, not infinite"
        )
    else:
        parts.append(f"no integral: the gain at rest is kp = {float(dc):.6g}")
    if own:
        parts.append(f"divided by 1 - {float(own):.6g} through `previous`")
    whose = "the plant's gain at rest of" if plant else "a plant of gain"
    if gain is None:
        parts.append("the plant has no gain at rest from here to the sensor that is known")
    elif math.isinf(gain):
        parts.append("the plant itself integrates: no error remains at rest")
    elif share is None:
        parts.append(f"with {whose} {gain:.6g} there is no rest")
    else:
        parts.append(
            f"with {whose} {gain:.6g}, {share:.3%} of a change of the setpoint remains as an error"
        )
    return "; ".join(parts)
