"""What is settled about guards in a box of parameters, for all histories at once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pirlc.tune.maxsmt.piecewise import Affine, Both, Cases, Guard, Known, Not, Real, Truth

Vector = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Box:
    """Parameters (P,) from `lower` to `upper`; `centre` is among them."""

    centre: Vector
    lower: Vector
    upper: Vector


def at(left: Affine, theta: Vector) -> Vector:
    """The value at parameters theta, (N,) or (1,)."""
    with np.errstate(all="ignore"):
        value = left.offset
        for j, slope in left.slopes.items():
            value = value + slope * theta[j]
        return value


def _extremes(left: Affine, box: Box) -> tuple[Vector, Vector]:
    middle, half = (box.lower + box.upper) / 2.0, (box.upper - box.lower) / 2.0
    with np.errstate(all="ignore"):
        reach = np.zeros(1)
        for j, slope in left.slopes.items():
            reach = reach + np.abs(slope) * half[j]
        value = at(left, middle)
        return value - reach, value + reach


def settled(truth: Truth, box: Box) -> tuple[Flags, Flags]:
    """Where a formula holds in the whole box, and where it may hold, each (N,) or (1,).

    Guards are taken one by one: where they hang together more may be settled than is told.
    """
    known: dict[int, tuple[Flags, Flags]] = {}

    def go(t: Truth) -> tuple[Flags, Flags]:
        if id(t) not in known:
            known[id(t)] = make(t)
        return known[id(t)]

    def make(t: Truth) -> tuple[Flags, Flags]:
        match t:
            case Known(values):
                return values, values
            case Not(of):
                must, may = go(of)
                return ~may, ~must
            case Both(a, b):
                (must_a, may_a), (must_b, may_b) = go(a), go(b)
                return must_a & must_b, may_a & may_b
            case Guard(left, at_zero):
                low, high = _extremes(left, box)
                # Comparisons with a NaN are false: what is not finite is never settled to hold.
                return (low >= 0.0, high >= 0.0) if at_zero else (low > 0.0, high > 0.0)

    return go(truth)


def guards_of(truths: list[Truth]) -> list[Guard]:
    """Every guard once, in the order of the formulas."""
    found: dict[int, Guard] = {}
    seen: set[int] = set()
    waiting = list(reversed(truths))
    while waiting:
        here = waiting.pop()
        if id(here) in seen:
            continue
        seen.add(id(here))
        match here:
            case Guard():
                found[id(here)] = here
            case Not(of):
                waiting.append(of)
            case Both(a, b):
                waiting.extend((b, a))
            case Known():
                pass
    return list(found.values())


def features(results: list[Real], guards: list[Guard], count: int) -> Vector:
    """All that a template can tell histories apart by, (N, F), each of unit spread.

    The columns are the coefficients of guards, and what is decided by the histories alone.
    """
    columns: dict[bytes, Vector] = {}

    def keep(column: NDArray[np.generic]) -> None:
        values = np.asarray(column, dtype=np.float64)
        if len(values) != count or not np.isfinite(values).all():
            return
        spread = float(values.std())
        if spread > 1e-12 * float(np.abs(values).max()):
            scaled = (values - values.mean()) / spread
            columns.setdefault(np.round(scaled, 9).tobytes(), scaled)

    for guard in guards:
        keep(guard.left.offset)
        for slope in guard.left.slopes.values():
            keep(slope)
    for known in _decided(results):
        keep(known.values)
    if not columns:
        return np.zeros((count, 1))
    return np.stack(list(columns.values()), axis=1)


def _decided(results: list[Real]) -> Iterator[Known]:
    waiting: list[Real | Truth] = list(results)
    seen: set[int] = set()
    while waiting:
        here = waiting.pop()
        if id(here) in seen:
            continue
        seen.add(id(here))
        match here:
            case Known():
                yield here
            case Cases(condition, yes, no):
                waiting.extend((no, yes, condition))
            case Not(of):
                waiting.append(of)
            case Both(a, b):
                waiting.extend((b, a))
            case Affine() | Guard():
                pass


def usable(guards: list[Guard], count: int) -> Flags:
    """Where all coefficients are finite, (N,)."""
    good = np.ones(count, dtype=np.bool_)
    for guard in guards:
        good &= np.isfinite(guard.left.offset)
        for slope in guard.left.slopes.values():
            good &= np.isfinite(slope)
    return good
