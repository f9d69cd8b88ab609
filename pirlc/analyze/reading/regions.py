"""Where a branch is taken: its conditions joined, single readings as intervals.

The conditions on a path are simplified for readings in their ranges: parts that always hold there
are left out, bounds on one reading become one interval, and a path that none can take is found.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from pirlc.analyze.reading.ranges import EVERYTHING, Box, Interval, verdict
from pirlc.analyze.reading.sums import (
    Atom,
    Compare,
    Every,
    Function,
    Guard,
    Relation,
    Some,
    Sum,
)
from pirlc.analyze.reading.wording import atom_text, guard_text, interval_text, solved_text


@dataclass(frozen=True)
class Bounds:
    """Of one atom: strict where the end itself is left out."""

    interval: Interval = EVERYTHING
    strict: tuple[bool, bool] = (True, True)

    @property
    def empty(self) -> bool:
        low, high = self.interval
        return low > high or (low == high and any(self.strict))

    def met(self, other: Bounds) -> Bounds:
        (a, b), (c, d) = self.interval, other.interval
        low = self.strict[0] if a > c else other.strict[0] if c > a else any(_firsts(self, other))
        high = self.strict[1] if b < d else other.strict[1] if d < b else any(_lasts(self, other))
        return Bounds((max(a, c), min(b, d)), (low, high))


def _firsts(one: Bounds, other: Bounds) -> tuple[bool, bool]:
    return one.strict[0], other.strict[0]


def _lasts(one: Bounds, other: Bounds) -> tuple[bool, bool]:
    return one.strict[1], other.strict[1]


@dataclass(frozen=True)
class Region:
    """`bounds` of single atoms and, in `guards`, all else that must hold. `never` says why no good
    readings are there (empty: some may be)."""

    bounds: tuple[tuple[Atom, Bounds], ...]
    guards: tuple[Guard, ...]
    never: str = ""


def region_of(conditions: Iterable[Guard], box: Box) -> Region:
    """The region in which all conditions hold, for readings in the box."""
    bounds: dict[Atom, Bounds] = {}
    others: list[Guard] = []
    for guard in _flat(conditions):
        found = bound_of(guard)
        if found is None:
            others.append(guard)
            continue
        atom, one = found
        bounds[atom] = bounds[atom].met(one) if atom in bounds else one
    for atom, one in bounds.items():
        text = _bounded(atom, one)
        if one.empty:
            parts = " and ".join(guard_text(g) for g in _flat(conditions) if _of(g) == atom)
            return Region((), (), f"{parts} exclude each other")
        low, high = box.of(atom)
        if Bounds((low, high), (False, False)).met(one).empty:
            return Region((), (), f"{text} is outside the range [{low:g}, {high:g}]")
    inside = replace(box, narrowed={atom: one.interval for atom, one in bounds.items()})
    kept: list[Guard] = []
    for guard in others:
        simple = simplified(guard, inside)
        if simple == Some(()):
            where = " and ".join(_bounded(atom, one) for atom, one in bounds.items())
            never = f"{guard_text(guard)} cannot be" + (f" where {where}" if where else "")
            return Region((), (), never)
        kept += list(_flat((simple,)))
    narrower = [(a, one) for a, one in bounds.items() if not _implied(box.of(a), one)]
    return Region(tuple(narrower), tuple(dict.fromkeys(kept)))


def simplified(guard: Guard, box: Box) -> Guard:
    """The guard without parts whose truth the box tells."""
    known = verdict(guard, box)
    if known is not None:
        return Every(()) if known else Some(())
    if isinstance(guard, Compare):
        return guard
    parts = tuple(simplified(part, box) for part in guard.parts)
    if isinstance(guard, Every):
        parts = tuple(_flat(parts))
        kept: tuple[Guard, ...] = tuple(part for part in parts if part != Every(()))
        return kept[0] if len(kept) == 1 else Every(kept)
    kept = tuple(part for part in _spread(parts) if part != Some(()))
    return kept[0] if len(kept) == 1 else Some(kept)


def _spread(parts: Iterable[Guard]) -> Iterator[Guard]:
    for part in parts:
        if isinstance(part, Some) and part.parts:
            yield from _spread(part.parts)
        else:
            yield part


def _flat(guards: Iterable[Guard]) -> Iterator[Guard]:
    for guard in guards:
        if isinstance(guard, Every) or (isinstance(guard, Some) and len(guard.parts) == 1):
            yield from _flat(guard.parts)
        else:
            yield guard


def _of(guard: Guard) -> Atom | None:
    found = bound_of(guard)
    return None if found is None else found[0]


def bound_of(guard: Guard) -> tuple[Atom, Bounds] | None:
    """A comparison that bounds a single atom; `|x - c| < r` bounds x from both sides."""
    match guard:
        case Compare(Sum(constant, ((atom, weight),)), relation):
            if relation in (Relation.LESS, Relation.LESS_EQUAL):
                constant, weight, relation = -constant, -weight, relation.turned
            limit = float(-constant / weight)
            strict = relation is Relation.GREATER
            if relation is Relation.NOT_EQUAL:
                return None
            if relation is Relation.EQUAL:
                return atom, Bounds((limit, limit), (False, False))
            if weight > 0:
                return atom, Bounds((limit, math.inf), (strict, True))
            match atom:
                case Function("abs", (Sum(middle, ((inner, by),)),)):
                    low = float((-middle - constant / -weight) / by)
                    high = float((-middle + constant / -weight) / by)
                    return inner, Bounds((min(low, high), max(low, high)), (strict, strict))
                case _:
                    return atom, Bounds((-math.inf, limit), (True, strict))
        case _:
            return None


def _bounded(atom: Atom, one: Bounds) -> str:
    return interval_text(atom_text(atom), one.interval, one.strict)


def _implied(known: Interval, one: Bounds) -> bool:
    """Whether the bounds say no more than the range does."""
    (low, high), (a, b) = known, one.interval
    above = a < low or (a == low and not one.strict[0])
    below = b > high or (b == high and not one.strict[1])
    return above and below


def region_texts(region: Region) -> tuple[str, ...]:
    """What must hold, in words; nothing: always."""
    return (
        *(_bounded(atom, one) for atom, one in region.bounds),
        *(guard_text(guard) for guard in region.guards),
    )


def boundaries(region: Region) -> tuple[tuple[str, str], ...]:
    """Comparisons of several readings in the region's guards, each with what it is solved for one
    of them."""
    found: dict[str, str] = {}
    waiting = list(region.guards)
    while waiting:
        guard = waiting.pop(0)
        if isinstance(guard, Compare):
            solved = solved_text(guard)
            if solved is not None:
                found.setdefault(guard_text(guard), solved)
        else:
            waiting = [*guard.parts, *waiting]
    return tuple(found.items())
