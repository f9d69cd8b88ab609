"""Bounds of what runs: the bounds over the reals, carried over to a precision.

Results may be off by the bound on their rounding, and guards turn where their sides are closer than
rounding may move them; the supremum of that holds for everything computed in the precision.
"""

from __future__ import annotations

import math
from fractions import Fraction

from pirlc.ir.policy import ActionSpec, Program
from pirlc.semantics.precision import Precision
from pirlc.symbolic import z3_terms as exact
from pirlc.symbolic.z3_terms import Real
from pirlc.verify.bounds.extremes import greatest, limited
from pirlc.verify.findings import AsComputed
from pirlc.verify.model import Model, unroll
from pirlc.verify.properties.asking import Limits
from pirlc.verify.properties.deciding import perturbation
from pirlc.verify.ranges import running_ranges


def as_computed(
    part: Program, spec: ActionSpec, precision: Precision, limits: Limits
) -> AsComputed:
    """Sound bounds, not the tightest: of one action in the part of a program that it needs."""
    off = perturbation(part, precision)
    ends = running_ranges(part, precision).get(spec.name)
    low = None if ends is None else ends.low
    high = None if ends is None else ends.high
    change = None if ends is None else _upward(Fraction(ends.high) - Fraction(ends.low))
    applied: float | None = None
    one, two = (unroll(part, steps, perturbation=off) for steps in (1, 2))
    if not (one.functions.nonlinear or one.functions.axioms):
        raw = one.steps[0].raw[spec.name].value
        high = _least(high, _most(one, raw, limits))
        below = _most(one, exact.negate(raw), limits)
        low = low if below is None else -below if low is None else max(low, -below)
        change = _least(change, _change(two, spec.name, limits, applied=False))
        applied = _change(two, spec.name, limits, applied=True)
    return AsComputed(low, high, change, applied)


def _change(model: Model, action: str, limits: Limits, *, applied: bool) -> float | None:
    first, second = ((step.applied if applied else step.raw)[action].value for step in model.steps)
    up = _most(model, exact.subtract(second, first), limits)
    down = _most(model, exact.subtract(first, second), limits)
    return None if up is None or down is None else max(up, down)


def _most(model: Model, term: Real, limits: Limits) -> float | None:
    found, _ = greatest(model, limited(model, limits), term, (), limits)
    return None if found is None else _upward(found)


def _least(a: float | None, b: float | None) -> float | None:
    return b if a is None else a if b is None else min(a, b)


def _upward(x: Fraction) -> float:
    near = float(x)
    return near if Fraction(near) >= x else math.nextafter(near, math.inf)
