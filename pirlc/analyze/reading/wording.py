"""Sums and comparisons in words an engineer would use: few digits, inequalities solved."""

from __future__ import annotations

from fractions import Fraction
from typing import assert_never

from pirlc.analyze.pid import pid_gains
from pirlc.analyze.reading.ranges import Interval
from pirlc.analyze.reading.sums import (
    Atom,
    Compare,
    Every,
    Function,
    Guard,
    Some,
    Sum,
    scaled,
)
from pirlc.analyze.tangent import Earlier, Reading

Part = tuple[Fraction, str]
"""A weight and what it weighs ("" for a constant)."""


def number(value: Fraction | float) -> str:
    """To six significant digits."""
    return f"{float(value):.6g}"


def atom_text(atom: Atom) -> str:
    match atom:
        case Reading(sensor, age):
            return sensor if not age else f"{sensor}(k-{age})"
        case Earlier(action):
            return f"previous {action}"
        case Function("abs", (inside,), _):
            return f"|{sum_text(inside)}|"
        case Function("*" | "/" as name, (a, b), _):
            return f"{_factor(a)} {name} {_factor(b)}"
        case Function("if", (a, b), condition) if condition is not None:
            return f"({sum_text(a)} if {guard_text(condition)}, else {sum_text(b)})"
        case Function(name, arguments, _):
            return f"{name}({', '.join(map(sum_text, arguments))})"
        case _:
            assert_never(atom)


def _factor(part: Sum) -> str:
    text = sum_text(part)
    return text if len(part.terms) + bool(part.constant) <= 1 and text[0] != "-" else f"({text})"


def sum_text(total: Sum) -> str:
    """``70 Angle + 10 AngularVelocity``; the readings of a sensor that make a PID as its parts."""
    parts, constant = sum_parts(total), (total.constant, "")
    first = bool(parts) and parts[0][0] < 0 < total.constant
    return parts_text([constant, *parts] if first else [*parts, constant])


def parts_text(parts: list[Part]) -> str:
    text = ""
    for weight, name in parts:
        if not weight:
            continue
        size = number(abs(weight))
        shown = f"{size} {name}".strip() if size != "1" or not name else name
        sign = "-" if weight < 0 else "+"
        text += f" {sign} {shown}" if text else f"{'-' if weight < 0 else ''}{shown}"
    return text or "0"


def sum_parts(total: Sum) -> list[Part]:
    """The terms, each sensor's together where its first is; pairs of sensors as a difference."""
    waiting = list(total.terms)
    found: list[Part] = []
    while waiting:
        atom, weight = waiting.pop(0)
        if not isinstance(atom, Reading):
            found.append((weight, atom_text(atom)))
            continue
        own = [(a, w) for a, w in waiting if isinstance(a, Reading) and a.sensor == atom.sensor]
        if own:
            waiting = [entry for entry in waiting if entry not in own]
            found += _window_parts(atom.sensor, dict([(atom, weight), *own]))
            continue
        partner = _opposite(atom, weight, waiting) if abs(weight) != 1 else None
        if partner is None:
            found.append((weight, atom_text(atom)))
        else:
            waiting.remove((partner, -weight))
            found.append((weight, f"({atom_text(atom)} - {atom_text(partner)})"))
    return found


def _opposite(atom: Reading, weight: Fraction, terms: list[tuple[Atom, Fraction]]) -> Atom | None:
    """Another sensor that alone has the opposite weight: Left - Right."""
    alone = [a for a, w in terms if w == -weight and isinstance(a, Reading) and a.age == atom.age]
    others = [a for a, w in terms if w == weight and isinstance(a, Reading)]
    return alone[0] if len(alone) == 1 and not others else None


def _window_parts(sensor: str, weights: dict[Atom, Fraction]) -> list[Part]:
    """Several readings of one sensor: as newest, sum and change where that describes them."""
    dense = dense_weights(sensor, weights)
    gains = gains_in(dense)
    if gains is None:
        return [(w, atom_text(Reading(sensor, age))) for age, w in enumerate(dense) if w]
    kp, ki, kd, n = gains
    return [
        (-kp, sensor),
        (-ki, f"(sum of the last {n} {sensor})"),
        (-kd, f"(change of {sensor})"),
    ]


def gains_in(
    weights: tuple[Fraction, ...],
) -> tuple[Fraction, Fraction, Fraction, int] | None:
    """kp, ki, kd and n of a PID with these weights; None where it would take more parts than there
    are readings: any three weights are a PID's."""
    found = pid_gains(weights)
    if found is None or sum(map(bool, weights)) < sum(map(bool, found[:3])):
        return None
    return found


def dense_weights(sensor: str, weights: dict[Atom, Fraction]) -> tuple[Fraction, ...]:
    """Of a sensor's readings, the newest first."""
    by_age = {a.age: w for a, w in weights.items() if isinstance(a, Reading) and a.sensor == sensor}
    return tuple(by_age.get(age, Fraction(0)) for age in range(max(by_age) + 1))


def compare_text(compare: Compare) -> str:
    """The weighted readings on the left, the constant on the right."""
    total, relation = compare.sum, compare.relation
    if not total.terms:
        return f"{number(total.constant)} {relation.value} 0"
    if len(total.terms) == 1:
        atom, weight = total.terms[0]
        relation = relation.turned if weight < 0 else relation
        return f"{atom_text(atom)} {relation.value} {number(-total.constant / weight)}"
    if all(weight < 0 for _, weight in total.terms):
        total, relation = scaled(total, Fraction(-1)), relation.turned
    return f"{parts_text(sum_parts(total))} {relation.value} {number(-total.constant)}"


def solved_text(compare: Compare) -> str | None:
    """The comparison solved for a sensor of which it has one reading: the last such one.

    None where it says nothing more: of a single atom, or without such a sensor.
    """
    total = compare.sum
    sensors = [atom.sensor for atom, _ in total.terms if isinstance(atom, Reading)]
    alone = [a for a, _ in total.terms if isinstance(a, Reading) and sensors.count(a.sensor) == 1]
    if len(total.terms) < 2 or not alone:
        return None
    atom = alone[-1]
    weight = total.weights[atom]
    rest = Sum(total.constant, tuple((a, w) for a, w in total.terms if a != atom))
    relation = compare.relation.turned if weight < 0 else compare.relation
    return f"{atom_text(atom)} {relation.value} {sum_text(scaled(rest, -1 / weight))}"


def guard_text(guard: Guard) -> str:
    """On one line, with brackets where `and` and `or` meet."""
    match guard:
        case Compare():
            return compare_text(guard)
        case Every(()):
            return "always"
        case Some(()):
            return "never"
        case Every(parts):
            return " and ".join(_bracketed(part, Some) for part in parts)
        case Some(parts):
            return " or ".join(_bracketed(part, Every) for part in parts)
        case _:
            assert_never(guard)


def _bracketed(guard: Guard, other: type[Every] | type[Some]) -> str:
    inside = isinstance(guard, other) and len(guard.parts) > 1
    return f"({guard_text(guard)})" if inside else guard_text(guard)


def interval_text(name: str, found: Interval, strict: tuple[bool, bool]) -> str:
    """``-0.001 < x < 0.001``; an end that is infinite is left out."""
    low, high = found
    left = "<" if strict[0] else "<="
    right = "<" if strict[1] else "<="
    if low == high:
        return f"{name} = {number(low)}"
    if low > float("-inf") and high < float("inf"):
        return f"{number(low)} {left} {name} {right} {number(high)}"
    if high < float("inf"):
        return f"{name} {right} {number(high)}"
    return f"{name} {'>' if strict[0] else '>='} {number(low)}"
