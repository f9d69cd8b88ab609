"""Program templates that compute the same function, told by what they compute on probes.

Two templates are observationally equal if they give the same outputs on random histories for the
same parameters. Parameters correspond by the order in which the canonical form meets them, and up
to a change of sign of all parameters of a comparison (`a + b*x > 0` in `if` with its branches
swapped is the same choice of programs, since the bounds allow both signs).
"""

from __future__ import annotations

from hashlib import sha256
from itertools import product

import numpy as np

from pirlc.ir.operators import COMPARISONS
from pirlc.ir.policy import Choice, Interface, ProgramTemplate
from pirlc.ir.terms import Apply, ParameterRef, subterms
from pirlc.search.canonical import canonical_order
from pirlc.semantics.histories import HistorySet, histories_of
from pirlc.semantics.vectorised import compile_plan

_PROBES = 48
GLANCE, LOOK = 4, 40
"""Draws of parameters: a glance tells most templates apart. To take two for equal needs a long
look, since guards that hold nearly always or never make different templates look alike, the more
so as signs may be flipped."""

_MOST_FLIPPED = 4


def probes(interface: Interface, seed: int = 0) -> HistorySet:
    """Random histories: half with readings in their ranges, half far outside."""
    rng = np.random.default_rng(seed)
    trajectories = []
    for far in (False, True):
        width = 1 + max(sensor.index for sensor in interface.sensors)
        readings = np.zeros((_PROBES, width))
        for sensor in interface.sensors:
            inside = rng.uniform(sensor.lower, sensor.upper, _PROBES)
            readings[:, sensor.index] = rng.normal(0.0, 100.0, _PROBES) if far else inside
        actions = np.column_stack(
            [
                rng.choice(np.array(spec.domain.values, dtype=np.float64), _PROBES)
                if isinstance(spec.domain, Choice)
                else rng.uniform(spec.domain.lower, spec.domain.upper, _PROBES)
                for spec in interface.actions
            ]
        )
        trajectories.append((readings, actions))
    return histories_of(interface, trajectories)


def fingerprint(template: ProgramTemplate, histories: HistorySet, draws: int = LOOK) -> str:
    """Equal for templates that are observationally equal on these histories."""
    order = canonical_order(template)
    bounds = {p.name: (p.lower, p.upper) for p in template.free}
    plan = compile_plan(template, histories.precision, histories.layout)
    groups = _flippable(template)[:_MOST_FLIPPED]
    digests = []
    for signs in product((1.0, -1.0), repeat=len(groups)):
        flipped = {name: sign for group, sign in zip(groups, signs, strict=True) for name in group}
        digest = sha256()
        for draw_number in range(draws):
            rng = np.random.default_rng(draw_number)
            values = {}
            for name in order:
                lower, upper = bounds[name]
                # Spread over magnitudes, so that some draws make each sensor matter; and over the
                # bounds, so that templates that allow different numbers are different.
                draw = rng.choice((-1.0, 1.0)) * 10.0 ** rng.uniform(-2.0, 2.0)
                part = rng.random()
                inside = draw_number % 5 != 4 and lower < draw * flipped.get(name, 1.0) < upper
                values[name] = draw if inside else lower * (1.0 - part) + upper * part
                values[name] *= flipped.get(name, 1.0)
            outputs = plan.run(values, histories)
            with np.errstate(over="ignore"):
                rounded = np.ascontiguousarray(outputs.astype(np.float32))
            digest.update(rounded.tobytes())
        digests.append(digest.hexdigest())
    return min(digests)


def _flippable(template: ProgramTemplate) -> list[tuple[str, ...]]:
    """For each comparison the parameters that occur in it alone and allow both signs."""
    symmetric = {p.name for p in template.free if p.lower == -p.upper}
    total: dict[str, int] = {}
    for body in template.bodies:
        for sub in subterms(body):
            if isinstance(sub, ParameterRef):
                total[sub.name] = total.get(sub.name, 0) + 1
    groups = []
    for body in template.bodies:
        for sub in subterms(body):
            if isinstance(sub, Apply) and sub.operator in COMPARISONS:
                names = [s.name for s in subterms(sub) if isinstance(s, ParameterRef)]
                own = set(names)
                if own and own <= symmetric and all(total[n] == names.count(n) for n in own):
                    groups.append(tuple(dict.fromkeys(names)))
    return groups
