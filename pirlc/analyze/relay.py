"""Actions that switch between values: no linear loop, but a switching function.

Where a comparison decides between two values, the action is a relay in s(readings). With a linear
plant two things can be told of it: how the plant moves while the relay keeps s at 0 (the zero
dynamics from the action to s, by the equivalent control: Utkin, Sliding Modes in Control and
Optimization, 1992, ch. 2), and the limit cycle that the relay's describing function 4 M / (pi a)
predicts (Astrom and Murray, Feedback Systems, 2nd ed., 10.5).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import product

import numpy as np

from pirlc.analyze.assembly import assemble
from pirlc.analyze.findings import Filter, Leaf, LimitCycle, Plant, RelayFinding
from pirlc.analyze.loop import poles_of
from pirlc.analyze.paths import Path, paths, written
from pirlc.analyze.realisation import Complex, Realisation, phase_crossings
from pirlc.analyze.tangent import NoTangentError, OperatingPoint, tangent
from pirlc.analyze.transfer import split
from pirlc.ir.evidence import PROVED, Evidence, Kind, unknown
from pirlc.ir.operators import Operator
from pirlc.ir.policy import Program
from pirlc.ir.terms import Apply, Let, Term

_MOST_COMPARISONS = 8
_RISING = (Operator.GREATER, Operator.GREATER_EQUAL)
_CONNECTIVES = (Operator.AND, Operator.OR, Operator.NOT, Operator.IMPLIES)
_FALLING = (Operator.LESS, Operator.LESS_EQUAL)


def switches(leaves: Sequence[Leaf]) -> bool:
    """Whether the leaves of one action are constants, and not all the same."""
    plain = all(leaf.linear and not leaf.filters and not leaf.recalls for leaf in leaves)
    return plain and len({leaf.offset for leaf in leaves}) > 1


def relays_of(
    program: Program,
    leaves: Sequence[Leaf],
    at: OperatingPoint,
    plant: Plant | None,
    latency: int,
    sample_time: float | None,
) -> tuple[tuple[RelayFinding, ...], tuple[str, ...]]:
    """The relays of all actions that switch between constants, and notes."""
    found: list[RelayFinding] = []
    notes: list[str] = []
    for spec, body in zip(program.interface.actions, program.bodies, strict=True):
        own = [leaf for leaf in leaves if leaf.action == spec.name]
        if not switches(own):
            continue
        notes.append(
            f"{spec.name} switches between values: it has no linear loop, and no gain or phase "
            "margin; its switching functions are given instead"
        )
        ways, _ = paths(body)
        atoms = _atoms(ways)
        if len(atoms) > _MOST_COMPARISONS:
            notes.append(
                f"{spec.name} has {len(atoms)} comparisons; only the first "
                f"{_MOST_COMPARISONS} are looked at"
            )
            atoms = atoms[:_MOST_COMPARISONS]
        for atom in atoms:
            values = _decided(ways, own, atoms, atom)
            if values is not None:
                found.append(
                    _relay(program, spec.name, atom, values, at, plant, latency, sample_time)
                )
    return tuple(found), tuple(notes)


def _atoms(ways: Sequence[Path]) -> list[Term]:
    """The comparisons in the conditions, each with the `let`s around it, in the order met."""
    found: dict[Term, None] = {}
    for way in ways:
        for condition in way.conditions:
            found |= dict.fromkeys(_comparisons(_spread(condition.term)))
    return list(found)


def _spread(term: Term) -> Term:
    """A condition with its `let`s moved inward, to its comparisons."""
    match term:
        case Let(name, value, body):
            match _spread(body):
                case Apply(operator, arguments) if operator in _CONNECTIVES:
                    return Apply(operator, tuple(_spread(Let(name, value, a)) for a in arguments))
                case inner:
                    return Let(name, value, inner)
        case Apply(operator, arguments) if operator in _CONNECTIVES:
            return Apply(operator, tuple(map(_spread, arguments)))
        case _:
            return term


def _comparisons(term: Term) -> Iterator[Term]:
    match term:
        case Apply(operator, arguments) if operator in _CONNECTIVES:
            for argument in arguments:
                yield from _comparisons(argument)
        case _ if _difference(term) is not None:
            yield term
        case _:
            pass


def _difference(atom: Term) -> Term | None:
    """The term s that is positive where a comparison of reals holds; None for other conditions."""
    match atom:
        case Let(name, value, body):
            inner = _difference(body)
            return None if inner is None else Let(name, value, inner)
        case Apply(operator, (left, right)) if operator in _RISING:
            return Apply(Operator.SUBTRACT, (left, right))
        case Apply(operator, (left, right)) if operator in _FALLING:
            return Apply(Operator.SUBTRACT, (right, left))
        case _:
            return None


def _truth(term: Term, given: Mapping[Term, bool]) -> bool | None:
    """A spread condition's value, given its comparisons' (None: it has others)."""
    match term:
        case Apply(operator, arguments) if operator in _CONNECTIVES:
            below = [_truth(argument, given) for argument in arguments]
            if None in below:
                return None
            match operator:
                case Operator.NOT:
                    return not below[0]
                case Operator.AND:
                    return all(below)
                case Operator.OR:
                    return any(below)
                case _:
                    return not below[0] or bool(below[1])
        case _:
            return given.get(term)


def _decided(
    ways: Sequence[Path], own: Sequence[Leaf], atoms: Sequence[Term], atom: Term
) -> tuple[float, float] | None:
    """The action where the comparison does not hold and where it does, for other comparisons that
    let it decide; None where it never does."""
    others = [other for other in atoms if other != atom]

    def value(given: Mapping[Term, bool]) -> Fraction | None:
        for way, leaf in zip(ways, own, strict=True):
            if all(_truth(_spread(c.term), given) == c.holds for c in way.conditions):
                return leaf.offset
        return None

    for held in product((False, True), repeat=len(others)):
        rest = dict(zip(others, held, strict=True))
        low, high = value({**rest, atom: False}), value({**rest, atom: True})
        if low is not None and high is not None and low != high:
            return float(low), float(high)
    return None


def _relay(
    program: Program,
    action: str,
    atom: Term,
    values: tuple[float, float],
    at: OperatingPoint,
    plant: Plant | None,
    latency: int,
    sample_time: float | None,
) -> RelayFinding:
    low, high = values
    text = written(atom, program)
    difference = _difference(atom)
    assert difference is not None
    try:
        law = tangent(difference, program, at)
    except NoTangentError as reason:
        why = unknown(f"no tangent at the operating point: {reason}")
        return RelayFinding(action, text, low, high, (), Fraction(0), None, None, (), why)
    filters, recalls, offset = split(law, program, at)
    if plant is None or action not in plant.inputs:
        evidence = Evidence(Kind.LINEARISED, f"tangent of {', '.join(sorted(law.bent))}")
        return RelayFinding(
            action, text, low, high, filters, offset, None, None, (),
            evidence if law.bent else PROVED,
        )  # fmt: skip
    surface = Leaf(
        "s", action, (), text, filters, recalls, offset, (), not law.bent,
        Evidence(Kind.LINEARISED),
    )  # fmt: skip
    loop = assemble(plant, surface, (), latency).loop
    degree = _relative_degree(loop)
    if degree is None:
        note = "the action does not move s: the plant's sensors do not answer it"
        return RelayFinding(
            action, text, low, high, filters, offset, None, None, (), unknown(note), (note,)
        )
    zeros = _zeros(loop, degree)
    notes = [_direction(loop, degree, high - low)]
    if degree > 1:
        notes.append(
            f"s answers the action after {degree} steps: it cannot be held at 0 from one step to "
            "the next"
        )
    reach = _reach(program, filters, offset)
    every = _cycles(loop, (high - low) / 2.0, sample_time)
    cycles = tuple(cycle for cycle in every if cycle.amplitude <= reach)
    if not cycles:
        notes.append(
            "the describing function predicts no limit cycle"
            + (" within the sensors' ranges" if every else "")
        )
    return RelayFinding(
        action, text, low, high, filters, offset,
        poles_of(zeros, sample_time),
        bool(np.all(np.abs(zeros) < 1.0 - 1e-9)),
        cycles,
        Evidence(Kind.LINEARISED, "a relay around the plant's linearisation; the limit cycle is an "
                 "estimate by the describing function"),
        tuple(notes),
    )  # fmt: skip


def _reach(program: Program, filters: Sequence[Filter], offset: Fraction) -> float:
    """The largest |s| that readings within their ranges can give."""
    sensors = {sensor.name: sensor for sensor in program.interface.sensors}
    return abs(float(offset)) + sum(
        abs(float(weight)) * max(abs(sensors[f.sensor].lower), abs(sensors[f.sensor].upper))
        for f in filters
        for weight in f.coefficients
    )


def _relative_degree(loop: Realisation) -> int | None:
    """After how many steps s answers the action; None: never."""
    moved = loop.b
    scale = float(np.linalg.norm(loop.c))
    for degree in range(1, len(loop.b) + 1):
        if abs(loop.c @ moved) > 1e-12 * scale * max(float(np.linalg.norm(moved)), 1e-300):
            return degree
        moved = loop.a @ moved
    return None


def _zeros(loop: Realisation, degree: int) -> Complex:
    """The eigenvalues of the plant held on s = 0: the zeros from the action to s."""
    import scipy.linalg

    n = len(loop.b)
    left = np.block([[loop.a, loop.b[:, None]], [loop.c[None, :], np.zeros((1, 1))]])
    right = np.zeros((n + 1, n + 1))
    right[:n, :n] = np.eye(n)
    with np.errstate(all="ignore"):
        numbers = scipy.linalg.eigvals(left, right)
    numbers = numbers[np.isfinite(numbers)]
    order = np.argsort(np.abs(numbers))[: n - degree]
    return np.asarray(numbers[order], dtype=np.complex128)


def _direction(loop: Realisation, degree: int, height: float) -> str:
    moved = loop.b
    for _ in range(degree - 1):
        moved = loop.a @ moved
    toward = float(loop.c @ moved) * height > 0.0  # c holds -s
    return "the action pushes s toward 0" if toward else "the action pushes s away from 0"


def _cycles(loop: Realisation, half: float, sample_time: float | None) -> tuple[LimitCycle, ...]:
    """Where the plant turns s back in phase: the relay acts as the gain 4 M / (pi amplitude)."""
    sign = 1.0 if half > 0.0 else -1.0
    turned = Realisation(loop.a, loop.b * sign, loop.c)
    found = []
    for theta, gain in phase_crossings(turned):
        if theta == 0.0:
            continue
        found.append(
            LimitCycle(
                frequency=theta / (sample_time or 1.0),
                period=2.0 * math.pi / theta,
                amplitude=4.0 * abs(half) / (math.pi * gain),
                stable=_outside(turned, gain * 1.001) > _outside(turned, gain * 0.999),
            )
        )
    return tuple(found)


def _outside(loop: Realisation, gain: float) -> int:
    return int(np.count_nonzero(np.abs(loop.closed(gain)) > 1.0 + 1e-9))
