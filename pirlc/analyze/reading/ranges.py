"""What a sum can be while readings are in their ranges: intervals, sound but not the tightest."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import assert_never

from pirlc.analyze.reading.sums import Atom, Compare, Every, Function, Guard, Relation, Some, Sum
from pirlc.analyze.tangent import Earlier, Reading
from pirlc.ir.policy import Choice, Continuous, Interface

Interval = tuple[float, float]
EVERYTHING: Interval = (-math.inf, math.inf)


@dataclass(frozen=True)
class Box:
    """The sensors' and the actions' ranges; `narrowed`: what else is known of single atoms."""

    sensors: Mapping[str, Interval]
    actions: Mapping[str, Interval]
    narrowed: Mapping[Atom, Interval]

    def of(self, atom: Atom) -> Interval:
        match atom:
            case Reading(sensor):
                found = self.sensors[sensor]
            case Earlier(action):
                found = self.actions[action]
            case Function():
                found = _of_function(atom, self)
            case _:
                assert_never(atom)
        low, high = self.narrowed.get(atom, EVERYTHING)
        return max(found[0], low), min(found[1], high)


def box_of(interface: Interface) -> Box:
    actions: dict[str, Interval] = {}
    for action in interface.actions:
        match action.domain:
            case Continuous(lower, upper):
                actions[action.name] = lower, upper
            case Choice(values):
                actions[action.name] = min(values), max(values)
            case _:
                assert_never(action.domain)
    return Box({s.name: (s.lower, s.upper) for s in interface.sensors}, actions, {})


def range_of(total: Sum, box: Box) -> Interval:
    low = high = float(total.constant)
    for atom, weight in total.terms:
        a, b = box.of(atom)
        one, other = _times(float(weight), a), _times(float(weight), b)
        low, high = low + min(one, other), high + max(one, other)
    return (low, high) if not math.isnan(low + high) else EVERYTHING


def verdict(guard: Guard, box: Box) -> bool | None:
    """Whether the guard always holds (or never) in the box; None where that is not seen."""
    match guard:
        case Compare(total, relation):
            return _compared(range_of(total, box), relation)
        case Every(parts):
            found = [verdict(part, box) for part in parts]
            return False if False in found else None if None in found else True
        case Some(parts):
            found = [verdict(part, box) for part in parts]
            return True if True in found else None if None in found else False
        case _:
            assert_never(guard)


def _compared(found: Interval, relation: Relation) -> bool | None:
    low, high = found
    match relation:
        case Relation.GREATER:
            return True if low > 0.0 else False if high <= 0.0 else None
        case Relation.GREATER_EQUAL:
            return True if low >= 0.0 else False if high < 0.0 else None
        case Relation.LESS | Relation.LESS_EQUAL:
            return _compared((-high, -low), relation.turned)
        case Relation.EQUAL:
            return True if low == high == 0.0 else False if low > 0.0 or high < 0.0 else None
        case Relation.NOT_EQUAL:
            return True if low > 0.0 or high < 0.0 else False if low == high == 0.0 else None
        case _:
            assert_never(relation)


def _times(a: float, b: float) -> float:
    return 0.0 if a == 0.0 or b == 0.0 else a * b


def _of_function(function: Function, box: Box) -> Interval:
    parts = [range_of(argument, box) for argument in function.arguments]
    match function.name, parts:
        case "abs", [(low, high)]:
            least = 0.0 if low <= 0.0 <= high else min(abs(low), abs(high))
            return least, max(abs(low), abs(high))
        case "min", _:
            return min(low for low, _ in parts), min(high for _, high in parts)
        case "max", _:
            return max(low for low, _ in parts), max(high for _, high in parts)
        case "clip", [x, least, most]:
            return max(min(x[0], most[0]), least[0]), min(max(x[1], least[1]), most[1])
        case "*", [(a, b), (c, d)]:
            products = [_times(x, y) for x in (a, b) for y in (c, d)]
            return min(products), max(products)
        case "sqrt", [(low, high)] if high >= 0.0:
            return math.sqrt(max(low, 0.0)), math.sqrt(high) if high < math.inf else math.inf
        case "exp", [(low, high)]:
            return _exp(low), _exp(high)
        case "tanh", [(low, high)]:
            return math.tanh(low), math.tanh(high)
        case "sign", [(low, high)]:
            return float((low > 0) - (low < 0)), float((high > 0) - (high < 0))
        case "if", _:
            return min(low for low, _ in parts), max(high for _, high in parts)
        case _:
            return EVERYTHING


def _exp(x: float) -> float:
    return math.exp(x) if x < 709.0 else math.inf
