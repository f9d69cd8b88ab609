"""An action as filters of its readings: one affine law for each path through its `if`s."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction

from pirlc.analyze.findings import Filter, Leaf, Recall
from pirlc.analyze.paths import Condition, Path, condition_text, paths, written
from pirlc.analyze.pid import RestGain, pid_forms
from pirlc.analyze.tangent import (
    Earlier,
    NoTangentError,
    OperatingPoint,
    Reading,
    Real,
    holds,
    tangent,
)
from pirlc.ir.evidence import PROVED, Evidence, Kind, unknown
from pirlc.ir.policy import ActionSpec, Program
from pirlc.ir.terms import Term


def operating_point(program: Program, at: Mapping[str, float]) -> OperatingPoint:
    """The readings and actions to linearise at: those of `at` (sensors and actions by name), else
    the middle of a sensor's range and an action's safe value."""
    interface = program.interface
    return OperatingPoint(
        {
            s.name: Fraction(at.get(s.name, s.lower * 0.5 + s.upper * 0.5))
            for s in interface.sensors
        },
        {a.name: Fraction(at.get(a.name, a.safe)) for a in interface.actions},
    )


def leaves_of(
    program: Program, at: OperatingPoint, rest_gain: RestGain | None = None
) -> tuple[tuple[Leaf, ...], tuple[str, ...]]:
    """The leaves of all actions in declaration order, and notes on what is left out.

    `rest_gain(action, sensor)` is the plant's gain at rest (None: unknown), where there is a plant.
    """
    leaves: list[Leaf] = []
    notes: list[str] = []
    for action, body in zip(program.interface.actions, program.bodies, strict=True):
        found, complete = paths(body)
        if not complete:
            notes.append(
                f"{action.name} has more than {len(found)} paths; the first {len(found)} are shown"
            )
        leaves += _numbered(program, action, found, at, rest_gain)
    return tuple(leaves), tuple(notes)


def _numbered(
    program: Program,
    action: ActionSpec,
    found: tuple[Path, ...],
    at: OperatingPoint,
    rest_gain: RestGain | None,
) -> list[Leaf]:
    name = action.name
    return [
        _leaf(program, name, name if len(found) == 1 else f"{name} {i + 1}", path, at, rest_gain)
        for i, path in enumerate(found)
    ]


def _leaf(
    program: Program,
    action: str,
    name: str,
    path: Path,
    at: OperatingPoint,
    rest_gain: RestGain | None,
) -> Leaf:
    conditions = tuple(condition_text(c, program) for c in path.conditions)
    text = written(path.term, program)
    active = all(_met(condition, program, at) for condition in path.conditions)
    try:
        law = tangent(path.term, program, at)
    except NoTangentError as reason:
        why = f"no tangent at the operating point: {reason}"
        return Leaf(
            name, action, conditions, text, (), (), Fraction(0), (), False, unknown(why),
            _readings(path.term, at), str(reason), active,
        )  # fmt: skip
    filters, recalls, offset = split(law, program, at)
    pids, notes = pid_forms(action, filters, recalls, offset, rest_gain)
    bent = ", ".join(sorted(law.bent))
    evidence = Evidence(Kind.LINEARISED, f"tangent of {bent}") if law.bent else PROVED
    return Leaf(
        name, action, conditions, text, filters, recalls, offset, pids, not law.bent, evidence,
        _readings(path.term, at) if law.bent else {}, bent, active, notes,
    )  # fmt: skip


def split(
    law: Real, program: Program, at: OperatingPoint
) -> tuple[tuple[Filter, ...], tuple[Recall, ...], Fraction]:
    """A law as filters (in the order of the sensors), recalls and an offset."""
    by_sensor: dict[str, dict[int, Fraction]] = {}
    recalled: dict[str, Fraction] = {}
    offset = law.value
    for which, slope in law.gradient.items():
        offset -= slope * at.of(which)
        match which:
            case Reading(sensor, age):
                by_sensor.setdefault(sensor, {})[age] = slope
            case Earlier(name):
                recalled[name] = slope
    filters = tuple(
        Filter(s.name, _dense(by_sensor[s.name]))
        for s in program.interface.sensors
        if s.name in by_sensor
    )
    recalls = tuple(
        Recall(a.name, recalled[a.name]) for a in program.interface.actions if a.name in recalled
    )
    return filters, recalls, offset


def _dense(by_age: Mapping[int, Fraction]) -> tuple[Fraction, ...]:
    return tuple(by_age.get(age, Fraction(0)) for age in range(max(by_age) + 1))


def _met(condition: Condition, program: Program, at: OperatingPoint) -> bool:
    try:
        return holds(condition.term, program, at) == condition.holds
    except NoTangentError:
        return False


def _readings(term: Term, at: OperatingPoint) -> dict[str, float]:
    """The readings that a term is linearised at."""
    from pirlc.ir.terms import SensorRef, subterms

    names = {t.name for t in subterms(term) if isinstance(t, SensorRef)}
    return {name: float(value) for name, value in at.readings.items() if name in names}
