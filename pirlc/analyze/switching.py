"""Whether a program may switch between its leaves in any order and stay stable.

The statement is about the linear part: modes that rest elsewhere (other setpoints) move where the
loop goes, not whether two trajectories under the same switching come together. Saturation is left
out, and so are the guards: where no order of the modes does harm, the guards' own does none.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from itertools import product

import numpy as np

from pirlc.analyze.closed_loop import (
    MOST_MODES,
    Mode,
    closed_loop,
    modes_of,
    parts_of,
    shape_of,
    why_not,
    within,
)
from pirlc.analyze.exact import Rational
from pirlc.analyze.findings import Leaf, Plant, SwitchingFinding
from pirlc.analyze.lyapunov import MOST_ROWS, Lyapunov, lyapunov, radius
from pirlc.ir.evidence import Evidence, Kind, unknown

_LONGEST_CYCLE = 6
_MOST_CYCLES = 4000
_KINDS = (
    "one quadratic function for all modes",
    "a quadratic function for each mode",
    "a quadratic function for each two modes in turn",
    "a quadratic function for each three modes in turn",
    "a quadratic function for each four modes in turn",
)
_NOT_EVERY_ORDER = (
    "what is refuted is that every order of the modes does; the guards choose an order of their own"
)
_BEYOND = 1e-7
"""A spectral radius is on the border where it is no farther from 1 than this."""


def switching_of(
    plant: Plant, leaves: Sequence[Leaf], latency: int
) -> tuple[SwitchingFinding, ...]:
    """What is known of all orders of the leaves of the plant's inputs.

    One finding for each part of the loop that has nothing to do with the others and in which some
    action has two leaves. `leaves` are those of the continuous actions; an action without any is
    held.
    """
    leaves, notes = within(plant, leaves)
    against = why_not(plant, leaves)
    if against is not None:
        names = tuple(mode.name for mode in modes_of(plant, leaves)[:MOST_MODES])
        return (SwitchingFinding(names, (), None, None, unknown(against)),) if names[1:] else ()
    found = (_in_part(part, some, latency, notes) for part, some in parts_of(plant, leaves))
    return tuple(finding for finding in found if finding is not None)


def _in_part(
    plant: Plant, leaves: Sequence[Leaf], latency: int, notes: Sequence[str]
) -> SwitchingFinding | None:
    modes = modes_of(plant, leaves)
    if len(modes) < 2:
        return None
    names = tuple(mode.name for mode in modes)
    if len(modes) > MOST_MODES:
        reason = f"more than {MOST_MODES} modes"
        return SwitchingFinding(names[:MOST_MODES], (), None, None, unknown(reason))
    shape = shape_of(plant, leaves, latency)
    matrices = [closed_loop(shape, mode) for mode in modes]
    return decide(names, shape.states, matrices, (*notes, *_notes(modes, matrices)))


def decide(
    names: Sequence[str],
    states: Sequence[str],
    matrices: Sequence[Rational],
    notes: Sequence[str] = (),
) -> SwitchingFinding:
    """What is known of z(k+1) = A_i z(k), i in any order. The matrices are exact."""
    distinct: dict[Rational, str] = {}
    for name, matrix in zip(names, matrices, strict=True):
        distinct.setdefault(matrix, name)
    modes, called = list(distinct), list(distinct.values())
    tried: list[str] = []

    def finding(evidence: Evidence, found: Lyapunov | None = None) -> SwitchingFinding:
        refuted = (_NOT_EVERY_ORDER,) if evidence.kind is Kind.REFUTED else ()
        pieces = {} if found is None else dict(zip(found.words, found.matrices, strict=True))
        return SwitchingFinding(
            modes=tuple(names),
            states=tuple(states),
            lyapunov=pieces.get(()),
            decay=None if found is None else found.decay,
            evidence=evidence,
            tried=tuple(tried),
            notes=(*notes, *refuted),
            pieces={
                ", then ".join(called[i] for i in word): matrix
                for word, matrix in pieces.items()
                if word
            },
        )

    radii = [radius(mode) for mode in modes]
    for name, value in zip(called, radii, strict=True):
        tried.append(f"{name} alone: spectral radius {value:.6g}")
    unstable = [n for n, value in zip(called, radii, strict=True) if value > 1.0 + _BEYOND]
    if unstable:
        listed = ", ".join(unstable)
        tried.append("no Lyapunov function: a mode that is unstable by itself has none")
        return finding(
            Evidence(Kind.REFUTED, f"unstable by itself, for the linearisation: {listed}")
        )
    border = [n for n, value in zip(called, radii, strict=True) if value > 1.0 - _BEYOND]
    if border:
        tried.append("no Lyapunov function: one falls along every mode, and these do not settle")
        return finding(unknown(f"on the border of stability by itself: {', '.join(border)}"))
    cycle = _worst_cycle(modes, called)
    if cycle is not None:
        order, growth = cycle
        tried.append(
            f"cycles of up to {_LONGEST_CYCLE} steps: {order} has spectral radius {growth:.6g}"
        )
        return finding(Evidence(Kind.REFUTED, f"for the linearisation, {order} in turn diverges"))
    if len(modes) > 1:
        tried.append(f"cycles of up to {_LONGEST_CYCLE} steps: none diverges")
    for length, what in enumerate(_KINDS):
        rows = len(modes) ** length * len(states)
        if length and (len(modes) == 1 or rows > MOST_ROWS):
            break
        found = lyapunov(modes, length)
        if found is not None:
            tried.append(f"{what}: found, confirmed in exact rationals")
            holds = "stable in any order of the modes; saturation left out"
            return finding(Evidence(Kind.LINEARISED, holds), found)
        by = "too many states for an LMI" if rows > MOST_ROWS else "LMI"
        tried.append(f"{what} ({by}): none found")
    return finding(unknown("no Lyapunov function was found, and no order of the modes diverges"))


def _worst_cycle(modes: Sequence[Rational], names: Sequence[str]) -> tuple[str, float] | None:
    """An order of the modes, repeated for ever, that diverges."""
    numbers = [np.array([[float(v) for v in row] for row in mode]) for mode in modes]
    tried = 0
    for length in range(2, _LONGEST_CYCLE + 1):
        for order in product(range(len(modes)), repeat=length):
            if order[0] != min(order) or len(set(order)) == 1:
                continue
            tried += 1
            if tried > _MOST_CYCLES:
                return None
            whole = np.eye(len(numbers[0]))
            for i in order:
                whole = numbers[i] @ whole
            growth = float(np.max(np.abs(np.linalg.eigvals(whole))))
            if growth > 1.0 + _BEYOND:
                return ", ".join(names[i] for i in order), growth
    return None


def _notes(modes: Sequence[Mode], matrices: Sequence[Rational]) -> tuple[str, ...]:
    notes: list[str] = []
    if len(set(matrices)) < len(matrices):
        notes.append(
            f"the {len(modes)} modes have {len(set(matrices))} linear parts: some differ only in "
            "where they rest"
        )
    offsets: dict[str, set[Fraction]] = {}
    for mode in modes:
        for action, leaf in mode.leaves.items():
            offsets.setdefault(action, set()).add(leaf.offset)
    moved = [action for action, values in offsets.items() if len(values) > 1]
    if moved:
        notes.append(
            f"the modes rest at different points (the offsets of {', '.join(moved)} differ): the "
            "statement is that trajectories under the same switching come together, not that they "
            "come to one point"
        )
    return tuple(notes)
