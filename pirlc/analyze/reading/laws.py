"""A branch's law: what kind it is, its gains, where it saturates."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction

from pirlc.analyze.reading.findings import Gain, Kind, Law, Limit
from pirlc.analyze.reading.ranges import Box, Interval, range_of
from pirlc.analyze.reading.sums import Function, Sum, scaled
from pirlc.analyze.reading.wording import dense_weights, gains_in, number, sum_text
from pirlc.analyze.tangent import Earlier, Reading
from pirlc.ir.policy import ActionSpec, Continuous


def law_of(total: Sum, action: ActionSpec, box: Box) -> Law:
    """Of a branch whose value is the sum."""
    gains = gains_of(total)
    rest = Sum(Fraction(0), tuple((a, w) for a, w in total.terms if isinstance(a, Function)))
    own = total.weights.get(Earlier(action.name), Fraction(0))
    kind = _kind(total, gains, rest)
    setpoint = _setpoint(total, gains) if kind in (Kind.PID, Kind.GENERAL) else None
    moving = setpoint is not None and bool(setpoint.terms)
    found = range_of(total, box)
    return Law(
        kind=kind,
        text=sum_text(total),
        value=float(total.constant) if kind is Kind.CONSTANT else None,
        gains=gains,
        setpoint=None if setpoint is None or moving else float(setpoint.constant),
        setpoint_text="" if setpoint is None else sum_text(setpoint),
        offset=float(total.constant),
        rest=sum_text(rest) if rest.terms else "",
        range=found,
        clipped=_clipped(found, action),
        limits=tuple(_limits(gains, action, box, setpoint)),
        at_rest=_at_rest(gains, own) if setpoint is not None else "",
        notes=tuple(_notes(total, gains)),
    )


def gains_of(total: Sum) -> tuple[Gain, ...]:
    """Of each sensor with readings in the sum, in their order."""
    weights = total.weights
    sensors = dict.fromkeys(a.sensor for a in weights if isinstance(a, Reading))
    found = []
    for sensor in sensors:
        dense = dense_weights(sensor, weights)
        gains = gains_in(dense)
        kp, ki, kd, window = gains or (None, None, None, len(dense))
        found.append(
            Gain(
                sensor,
                None if kp is None else float(kp),
                None if ki is None else float(ki),
                None if kd is None else float(kd),
                window,
                float(-sum(dense)),
                tuple(map(float, dense)),
            )
        )
    return tuple(found)


def _kind(total: Sum, gains: Sequence[Gain], rest: Sum) -> Kind:
    if not total.terms:
        return Kind.CONSTANT
    if rest.terms:
        return Kind.GENERAL
    return Kind.PID if len(gains) == 1 and gains[0].kp is not None else Kind.FEEDBACK


def _setpoint(total: Sum, gains: Sequence[Gain]) -> Sum | None:
    """Where the law of a single sensor is 0, as a sum of what else is in it."""
    if len(gains) != 1 or gains[0].kp is None:
        return None
    own = [(a, w) for a, w in total.terms if isinstance(a, Reading)]
    at_rest = -sum((w for _, w in own), Fraction(0))
    if not at_rest:
        return None
    rest = tuple(
        (a, w)
        for a, w in total.terms
        if not isinstance(a, Reading | Earlier) and not _about(a, gains[0].sensor)
    )
    same = any(isinstance(a, Function) and _about(a, gains[0].sensor) for a, _ in total.terms)
    return None if same else scaled(Sum(total.constant, rest), 1 / at_rest)


def _about(function: Function, sensor: str) -> bool:
    """Whether a function depends on a sensor."""
    return any(
        (isinstance(a, Reading) and a.sensor == sensor)
        or (isinstance(a, Function) and _about(a, sensor))
        for argument in function.arguments
        for a, _ in argument.terms
    )


def _clipped(found: Interval, action: ActionSpec) -> bool:
    """Whether clipping can play a part."""
    match action.domain:
        case Continuous(lower, upper):
            return found[0] < lower or found[1] > upper
        case _:
            return False


def _limits(
    gains: Sequence[Gain], action: ActionSpec, box: Box, setpoint: Sum | None
) -> Iterator[Limit]:
    """What takes the action to its limits by itself: readings, or, with a setpoint, errors."""
    if not isinstance(action.domain, Continuous):
        return
    lower, upper = action.domain.lower, action.domain.upper
    for gain in gains:
        if gain.kp is None:
            continue
        low, high = box.sensors[gain.sensor]
        sign, (one, many) = (
            (-1.0, (gain.sensor, gain.sensor)) if setpoint is None else (1.0, ("error", "errors"))
        )
        reach = max(abs(low), abs(high))
        if setpoint is not None:
            least, most = range_of(setpoint, box)
            reach = max(abs(most - low), abs(high - least))
        parts = (
            (one, gain.kp, reach),
            (f"mean of {gain.window} {many}", (gain.ki or 0.0) * gain.window, reach),
            (f"change of the {one} in one step", gain.kd or 0.0, high - low),
        )
        for what, weight, furthest in parts:
            if weight:
                at = [limit / (sign * weight) if limit else None for limit in (lower, upper)]
                nearest = min((abs(x) for x in at if x is not None), default=math.inf)
                yield Limit(what, at[0], at[1], nearest <= furthest)


def _at_rest(gains: Sequence[Gain], own: Fraction) -> str:
    gain = gains[0]
    ki, window = gain.ki or 0.0, gain.window
    if own == 1:
        return "it adds to its own last value: true integral action, no error remains at rest"
    if ki:
        return (
            f"P + {window} I = {number(gain.at_rest)}: the integral is a sum over {window} "
            "readings, no true integral action; an error remains at rest unless the plant "
            "integrates"
        )
    return (
        f"P = {number(gain.at_rest)}: no integral; an error remains at rest unless the plant "
        "integrates"
    )


def _notes(total: Sum, gains: Sequence[Gain]) -> Iterator[str]:
    for atom, weight in total.terms:
        if isinstance(atom, Earlier):
            yield _recalled(atom.action, weight)
    for gain in gains:
        if len(gain.weights) == 2 and gain.kp is not None:
            yield (
                f"over two readings of {gain.sensor} a sum and a difference cannot be told apart: "
                "read as a difference"
            )


def _recalled(action: str, weight: Fraction) -> str:
    share = float(weight)
    if weight == 1:
        return (
            f"adds to the last {action} (velocity form): an integrator; what is added to is the "
            "clipped value, so it does not wind up"
        )
    if 0 < share < 1:
        return (
            f"keeps {number(share)} of the last {action}: a lag of "
            f"{-1.0 / math.log(share):.3g} steps"
        )
    return f"adds {number(share)} of the last {action}"
