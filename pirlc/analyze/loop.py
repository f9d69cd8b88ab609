"""The loop of an action with one of its leaves in it, around a linear plant.

The loop is broken at the actuator. The other actions keep their own leaves closed, those whose path
is taken at the operating point; an action without a linear law there is held.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from pirlc.analyze.assembly import Assembly, assemble, composed
from pirlc.analyze.checks import checks_of, failed
from pirlc.analyze.closed_loop import parts_of
from pirlc.analyze.findings import (
    WEAK,
    Check,
    FrequencyResponse,
    Leaf,
    LoopFinding,
    Margins,
    PidForm,
    Plant,
    Pole,
    StepResponse,
)
from pirlc.analyze.margins import margins_of
from pirlc.analyze.problems import Disagreement, error
from pirlc.analyze.realisation import Complex, Real, Realisation, angles, phase_crossings
from pirlc.analyze.schur import decided
from pirlc.ir.evidence import Evidence, Kind, unknown

MOST_LOOPS = 24
"""Different ones: the others of a program with more are left out, and named."""

_SHOWN = 500
"""Samples of a frequency response, about."""

_LONGEST_STEP = 1000
_SETTLED = 0.02
_CIRCLE = 1e-9
"""Eigenvalues within this of the unit circle are on it, in floating point."""


def loops_of(
    leaves: Sequence[Leaf], plant: Plant, latency: int, sample_time: float | None
) -> tuple[tuple[LoopFinding, ...], tuple[str, ...]]:
    """A loop for each leaf that the plant's sensors close, and notes on those that none do.

    Raises PirlcError E0921 where two ways to a figure disagree.
    """
    found: list[LoopFinding] = []
    notes: list[str] = []
    parts = parts_of(plant, leaves)
    known: dict[object, LoopFinding] = {}
    for leaf in leaves:
        why = _unclosed(leaf, plant)
        if why:
            notes.append(f"no loop of {leaf.name}: {why}")
            continue
        # What this loop neither moves nor shows is no part of it, and may be unstable by itself.
        around, together = next(part for part in parts if leaf.action in part[0].inputs)
        others = [
            other
            for other in together
            if other.action != leaf.action and other.active and not _unclosed(other, around)
        ]
        # Leaves that differ in their offsets alone are one loop: the offset moves its rest.
        law = leaf.action, leaf.filters, leaf.recalls, bool(_setpoint(leaf))
        if law not in known and len(known) == MOST_LOOPS:
            notes.append(f"no loop of {leaf.name}: {MOST_LOOPS} loops are looked at")
            continue
        if law not in known:
            known[law] = loop_of(leaf, others, around, latency, sample_time)
        found.append(replace(known[law], leaf=leaf.name))
    return tuple(found), tuple(notes)


def _weakness(leaf: Leaf, plant: Plant) -> Iterator[str]:
    """What an identified plant does not explain of the readings that the leaf is made of."""
    read = {filter_.sensor for filter_ in leaf.filters}
    poor = [f"{name} {fit:.0f} %" for name, fit in plant.fit.items() if name in read and fit < WEAK]
    if poor:
        yield (
            f"the identified plant explains little of what happens ({', '.join(poor)} in free "
            "runs): this is so of the model, and may not be of what it models"
        )


def _setpoint(leaf: Leaf) -> PidForm | None:
    """The PID of the leaf that has a setpoint."""
    return next((form for form in leaf.pids if form.setpoint is not None), None)


def _unclosed(leaf: Leaf, plant: Plant) -> str:
    """Why a leaf closes no loop around a plant; empty where it does."""
    if leaf.action not in plant.inputs:
        return f"{leaf.action} does not act on the plant"
    if leaf.evidence.kind is Kind.UNKNOWN:
        return leaf.evidence.reason
    if not any(filter_.sensor in plant.outputs for filter_ in leaf.filters):
        return "it reads nothing that the plant answers"
    return ""


def loop_of(
    leaf: Leaf, others: Sequence[Leaf], plant: Plant, latency: int, sample_time: float | None
) -> LoopFinding:
    """Poles, margins and responses of one loop. Raises PirlcError E0921 as `loops_of` does."""
    parts = assemble(plant, leaf, others, latency)
    whole = parts.loop
    loop, hidden = parts.hidden()
    poles = whole.closed()
    visible = bool(np.all(np.abs(loop.closed()) < 1.0 - _CIRCLE))
    stable, how = _stability(parts, poles)

    def by_parts(z: Complex) -> Complex:
        return composed(plant, leaf, others, latency, z)

    notes = [
        *_weakness(leaf, plant),
        *(
            f"{filter_.sensor} is not answered by the plant and stays at rest"
            for filter_ in leaf.filters
            if filter_.sensor not in plant.outputs
        ),
    ]
    outside = [pole for pole in hidden if abs(pole) >= 1.0 - _CIRCLE]
    if outside:
        where = ", ".join(_number(pole) for pole in outside)
        notes.append(
            f"the plant's poles at {where} are not moved by this loop; the margins are those of "
            "the rest"
        )
    margins: Margins | None = None
    checks: tuple[Check, ...] = ()
    if not len(loop.b):
        notes.append("the action does not move what it reads: nothing to lose or to gain")
    elif visible:
        margins = margins_of(loop, sample_time)
        checks = checks_of(loop, by_parts, margins, sample_time)
        wrong = [check for check in checks if failed(check)]
        if wrong:
            raise error(Disagreement(leaf.name, tuple(wrong)))
    if len(loop.b) and not visible:
        notes.append(_mending(loop))
    held = [name for name in plant.inputs if name not in {leaf.action, *(o.action for o in others)}]
    return LoopFinding(
        action=leaf.action,
        leaf=leaf.name,
        others={**{o.action: o.name for o in others}, **dict.fromkeys(held, "")},
        latency=latency,
        poles=poles_of(poles, sample_time),
        open_poles=poles_of(whole.poles, sample_time),
        stable=stable,
        margins=margins,
        response=frequency_response(loop, sample_time),
        step=step_response(parts, leaf, plant, loop, sample_time) if margins and stable else None,
        checks=checks,
        evidence=how,
        notes=tuple(notes),
    )


def _mending(loop: Realisation) -> str:
    """Which factors of gain would make an unstable loop stable."""
    edges = [0.0, *sorted(factor for _, factor in phase_crossings(loop)), math.inf]
    ranges = []
    for low, high in pairwise(edges):
        middle = 2.0 * low + 1.0 if math.isinf(high) else 0.5 * (low + high)
        if np.all(np.abs(loop.closed(middle)) < 1.0 - _CIRCLE):
            ranges.append(f"between {low:.4g} and {high:.4g}")
    if not ranges:
        return "no factor of gain makes this loop stable"
    return f"with its gain multiplied by a factor {' or '.join(ranges)} this loop would be stable"


def _number(z: complex) -> str:
    return f"{z.real:.6g}" if abs(z.imag) < 1e-12 else f"{z.real:.6g}{z.imag:+.6g}i"


def _stability(parts: Assembly, poles: Complex) -> tuple[bool, Evidence]:
    """Whether the closed loop is stable: exactly, where that can be."""
    stable, by = decided(parts.closed)
    if stable is not None:
        return stable, Evidence(Kind.LINEARISED, f"stability by {by}")
    stable = bool(np.all(np.abs(poles) < 1.0 - _CIRCLE))
    return stable, unknown(
        "by eigenvalues in floating point alone: too many states, or too near the edge"
    )


def poles_of(numbers: Complex, sample_time: float | None) -> tuple[Pole, ...]:
    """The slowest first; of a pair the one above the real axis first."""
    ordered = sorted(numbers, key=lambda z: (-round(abs(z), 12), -z.real, -z.imag))
    return tuple(_pole(complex(z), sample_time or 1.0) for z in ordered)


def _pole(z: complex, sample_time: float) -> Pole:
    size = abs(z)
    if size < 1e-12:
        return Pole(z.real, z.imag, size, None, None)
    s = complex(math.log(size), math.atan2(z.imag, z.real)) / sample_time
    frequency = abs(s)
    damping = -s.real / frequency if frequency else None
    return Pole(z.real, z.imag, size, frequency, damping)


def frequency_response(loop: Realisation, sample_time: float | None) -> FrequencyResponse:
    """L on a grid that follows its poles, without points on one."""
    import control

    if not len(loop.b):
        return FrequencyResponse((), (), ())
    grid = angles(loop, _SHOWN)
    grid = grid[grid > 1e-4]
    step = sample_time or 1.0
    system = control.ss(loop.a, loop.b[:, None], loop.c[None, :], loop.d, step)
    with np.errstate(all="ignore"):
        values = np.asarray(system(np.exp(1j * grid), squeeze=True, warn_infinite=False))
    good = np.isfinite(values) & (np.abs(values) < 1e12)
    return FrequencyResponse(
        tuple((grid[good] / step).tolist()),
        tuple(values.real[good].tolist()),
        tuple(values.imag[good].tolist()),
    )


def step_response(
    parts: Assembly, leaf: Leaf, plant: Plant, loop: Realisation, sample_time: float | None
) -> StepResponse:
    """After a step of the setpoint where the leaf has one, else of a disturbance at the action.

    It is as long as the poles of `loop`, the part that answers, need to die away.
    """
    import control

    pid = _setpoint(leaf)
    b = np.array(parts.b, dtype=np.float64)
    inner = np.array(parts.inner, dtype=np.float64)
    row = np.array(parts.row, dtype=np.float64)
    gain = 1.0 if pid is None else float(pid.dc_gain)
    # A setpoint shifts the leaf's offset, at once; a disturbance comes in behind the leaf.
    entry = b * gain if pid is None else (b + inner) * gain
    closed = np.array(parts.closed, dtype=np.float64) if not np.any(inner) else None
    if closed is None:
        closed = np.array(parts.a, dtype=np.float64) + np.outer(b, row)
    outputs = np.vstack([np.array(parts.c, dtype=np.float64), row])
    through = np.zeros(len(outputs))
    through[-1] = gain
    step = sample_time or 1.0
    system = control.ss(closed, entry[:, None], outputs, through[:, None], step)
    count = _horizon(loop.closed())
    times: Real = np.arange(count + 1, dtype=np.float64) * step
    answer = control.forced_response(system, times, np.ones(count + 1))
    values = np.asarray(answer.outputs).reshape(len(outputs), -1)
    rest = outputs @ np.linalg.solve(np.eye(len(b)) - closed, entry) + through
    sensor = (
        pid.sensor if pid else next(f.sensor for f in leaf.filters if f.sensor in plant.outputs)
    )
    which = plant.outputs.index(sensor)
    settling, overshoot = _figures(values[which], float(rest[which]), times)
    return StepResponse(
        what=f"the setpoint of {sensor}" if pid else f"a disturbance at {leaf.action}",
        sensor=sensor,
        times=tuple(times.tolist()),
        outputs={name: tuple(values[i].tolist()) for i, name in enumerate(plant.outputs)},
        action=tuple(values[-1].tolist()),
        final=float(rest[which]),
        settling_time=settling,
        overshoot=overshoot if pid else None,
    )


def _horizon(poles: Complex) -> int:
    slowest = float(np.max(np.abs(poles), initial=0.0))
    if slowest < 1e-3:
        return 20
    steps = math.log(1e-3) / math.log(slowest) * 1.3
    return int(min(max(steps, 20), _LONGEST_STEP))


def _figures(values: Real, final: float, times: Real) -> tuple[float | None, float | None]:
    """The settling time and the overshoot in percent."""
    largest = float(np.max(np.abs(values)))
    at_rest = abs(final) <= 1e-4 * max(largest, 1e-300)
    band = _SETTLED * (largest if at_rest else abs(final))
    outside = np.flatnonzero(np.abs(values - final) > band)
    last = int(outside[-1]) + 1 if len(outside) else 0
    settling = float(times[last]) if last < len(times) else None
    if at_rest:
        return settling, None
    over = max(0.0, float(np.max(values * np.sign(final))) - abs(final))
    return settling, 100.0 * over / abs(final)
