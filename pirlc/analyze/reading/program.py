"""Reading a program: every action's branches, when each is taken, and what each does."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import assert_never

from pirlc.analyze.findings import Analysis, LoopFinding, RelayFinding
from pirlc.analyze.paths import Path, paths
from pirlc.analyze.reading import findings
from pirlc.analyze.reading.findings import (
    ActionReading,
    Branch,
    ProgramReading,
    SensorUse,
    Settling,
)
from pirlc.analyze.reading.laws import law_of
from pirlc.analyze.reading.meanings import meanings_of, sample_time_of
from pirlc.analyze.reading.previous import atoms_in, atoms_of, previous_texts
from pirlc.analyze.reading.ranges import Box, box_of
from pirlc.analyze.reading.regions import boundaries, region_of, region_texts
from pirlc.analyze.reading.sums import (
    Compare,
    Guard,
    Relation,
    Sum,
    guard_of,
    negation,
    sum_of,
)
from pirlc.analyze.reading.wording import compare_text, number
from pirlc.analyze.tangent import Earlier, Reading
from pirlc.ir.policy import (
    ActionSpec,
    Choice,
    Continuous,
    Fill,
    Hold,
    Interface,
    Program,
    Sensor,
    Zero,
)
from pirlc.ir.printer import environment_text


@dataclass(frozen=True)
class _Leaf:
    """A path as sums: its conditions and its value."""

    guards: tuple[Guard, ...]
    law: Sum


def read_program(program: Program, analysis: Analysis) -> ProgramReading:
    """What a program does. `analysis` (of the same program, with or without a plant) gives how its
    loops settle; nothing is simulated."""
    interface = program.interface
    box = box_of(interface)
    leaves: dict[str, tuple[_Leaf, ...]] = {}
    notes: list[str] = []
    for action, body in zip(interface.actions, program.bodies, strict=True):
        ways, complete = paths(body)
        leaves[action.name] = tuple(_leaf(way, program) for way in ways)
        if not complete:
            notes.append(f"{action.name} has more than {len(ways)} branches; the first are read")
    sensors = tuple(_use(sensor, leaves) for sensor in interface.sensors)
    environment = interface.environment
    seconds = analysis.sample_time or sample_time_of(environment)
    analysis = replace(analysis, sample_time=seconds)
    return ProgramReading(
        program=interface.name,
        environment=""
        if environment is None
        else " ".join(environment_text(environment).removeprefix("environment ").split()),
        size=program.size,
        window=interface.window,
        needed=max((1 + age for sensor in sensors for age in sensor.readings), default=0),
        latency=analysis.latency,
        sample_time=seconds,
        warm_up=_warm_up(interface),
        sensors=sensors,
        actions=tuple(
            _action(action, leaves[action.name], interface, box, analysis)
            for action in interface.actions
        ),
        plant="" if analysis.plant is None else analysis.plant.name,
        simulated=None,
        notes=tuple(notes),
    )


def _leaf(way: Path, program: Program) -> _Leaf:
    guards = (guard_of(c.term, program) if c.holds else negation(guard_of(c.term, program))
              for c in way.conditions)  # fmt: skip
    return _Leaf(tuple(guards), sum_of(way.term, program))


# Actions


def _action(
    action: ActionSpec, leaves: Sequence[_Leaf], interface: Interface, box: Box, analysis: Analysis
) -> ActionReading:
    discrete = isinstance(action.domain, Choice)
    branches = tuple(
        _branch(k, leaf, action, len(leaves), box, analysis)
        for k, leaf in enumerate(leaves, start=1)
    )
    numbered = ((k, guard) for k, leaf in enumerate(leaves, start=1) for guard in leaf.guards)
    return ActionReading(
        name=action.name,
        domain=_domain(action),
        discrete=discrete,
        safe=action.safe,
        branches=branches,
        choices=_choices(action, branches, interface) if discrete else (),
        previous=previous_texts(action.name, (leaf.law for leaf in leaves), numbered),
        notes=tuple(n for r in analysis.relays if r.action == action.name
                    for n in _switching(r, analysis)),
    )  # fmt: skip


def _domain(action: ActionSpec) -> str:
    match action.domain:
        case Continuous(lower, upper):
            return f"[{number(lower)}, {number(upper)}]"
        case Choice(values):
            return f"{{{', '.join(map(str, values))}}}"
        case _:
            assert_never(action.domain)


def _branch(
    place: int, leaf: _Leaf, action: ActionSpec, count: int, box: Box, analysis: Analysis
) -> Branch:
    region = region_of(leaf.guards, box)
    name = action.name if count == 1 else f"{action.name} {place}"
    law = law_of(leaf.law, action, box)
    loop = next((found for found in analysis.loops if found.leaf == name), None)
    forms = next((leaf.pids for leaf in analysis.leaves if leaf.name == name), ())
    if analysis.plant is not None and law.at_rest and len(forms) == 1:
        # With the plant's own gain at rest more can be said.
        law = replace(law, at_rest=forms[0].steady_state)
    constant = law.kind is findings.Kind.CONSTANT
    return Branch(
        number=place,
        when=region_texts(region),
        boundaries=boundaries(region),
        never=region.never,
        law=law,
        settling=None if constant else _settling(leaf.law, action, analysis, loop),
    )


def _choices(
    action: ActionSpec, branches: Sequence[Branch], interface: Interface
) -> tuple[findings.Choice, ...]:
    meanings = meanings_of(interface.environment)
    found = []
    taken = [branch for branch in branches if not branch.never]
    last = taken[-1].law.value if taken else None
    assert isinstance(action.domain, Choice)
    for value in action.domain.values:
        own = [branch for branch in taken if branch.law.value == value]
        if not own:
            when = "never"
        elif len(own) == len(taken):
            when = "always"
        elif last == value:
            when = "otherwise"
        else:
            ways = [_joined(branch.when) for branch in own]
            when = ways[0] if len(ways) == 1 else " or ".join(f"({way})" for way in ways)
        numbers = tuple(branch.number for branch in own)
        found.append(findings.Choice(value, meanings.get(value, ""), numbers, when))
    return tuple(found)


def _joined(conditions: Sequence[str]) -> str:
    if len(conditions) == 1:
        return conditions[0]
    return " and ".join(f"({text})" if " or " in text else text for text in conditions)


def _switching(relay: RelayFinding, analysis: Analysis) -> Iterable[str]:
    """How a switching line behaves in the plant's linearisation."""
    unit = "steps" if analysis.sample_time is None else "s"
    step = analysis.sample_time or 1.0
    line = _line(relay)
    if relay.sliding_poles:
        slowest = max(pole.magnitude for pole in relay.sliding_poles)
        if relay.sliding_stable:
            time = settling_time(slowest) * step
            held = f"it comes to rest along it (to 2 % in {time:.3g} {unit})"
        else:
            held = (
                f"it does not come to rest along it (a pole of magnitude {slowest:.4g}): what the "
                "line leaves out drifts"
            )
        yield f"held on the line {line}, the linearised plant: {held}"
    for cycle in relay.cycles:
        kind = "a" if cycle.stable else "an unstable"
        yield (
            f"around the line {line} the linearised plant has {kind} limit cycle of "
            f"{cycle.period:.3g} steps ({cycle.period * step:.3g} {unit})"
        )


def _line(relay: RelayFinding) -> str:
    """The line at which a relay switches."""
    terms = tuple(
        (Reading(filter_.sensor, age), weight)
        for filter_ in relay.filters
        for age, weight in enumerate(filter_.coefficients)
        if weight
    )
    return compare_text(Compare(Sum(relay.offset, terms), Relation.EQUAL))


# Settling


def _settling(
    law: Sum, action: ActionSpec, analysis: Analysis, loop: LoopFinding | None
) -> Settling:
    ages = [atom.age for atom in atoms_of(law) if isinstance(atom, Reading)]
    memory = 1 + max(ages, default=-1)
    own = law.weights.get(Earlier(action.name))
    recalls = any(isinstance(a, Earlier) and a.action == action.name for a in atoms_of(law))
    kept = float(own) if own is not None else math.nan if recalls else None
    seconds = None if analysis.sample_time is None else memory * analysis.sample_time
    alone = Settling(memory, seconds, None if kept is None or math.isnan(kept) else kept)
    if loop is None:
        why = "no plant is known here" if analysis.plant is None else "no loop of this branch"
        return Settling(alone.memory, alone.seconds, alone.kept, why=why)
    slowest = max((pole.magnitude for pole in loop.poles), default=0.0)
    step = loop.step
    margins = loop.margins
    time = None if step is None else step.settling_time
    if time is None and loop.stable:
        time = settling_time(slowest) * (analysis.sample_time or 1.0)
    return Settling(
        memory=memory,
        seconds=seconds,
        kept=alone.kept,
        stable=loop.stable,
        slowest_pole=slowest,
        settling_time=time,
        overshoot=None if step is None else step.overshoot,
        gain_margin=None if margins is None else margins.gain_up,
        phase_margin=None if margins is None else margins.phase,
        delay_margin=None if margins is None else margins.delay_samples,
    )


def settling_time(magnitude: float) -> float:
    """Steps until what decays as magnitude^k is within 2 %."""
    if magnitude <= 0.0:
        return 0.0
    return math.inf if magnitude >= 1.0 else math.log(0.02) / math.log(magnitude)


# Sensors


def _use(sensor: Sensor, leaves: dict[str, tuple[_Leaf, ...]]) -> SensorUse:
    def own(atom: object) -> bool:
        return isinstance(atom, Reading) and atom.sensor == sensor.name

    guards, laws, ages = [], [], set()
    for action, ways in leaves.items():
        in_guards = [a for leaf in ways for g in leaf.guards for a in atoms_in(g) if own(a)]
        in_laws = [a for leaf in ways for a in atoms_of(leaf.law) if own(a)]
        guards += [action] if in_guards else []
        laws += [action] if in_laws else []
        ages |= {a.age for a in (*in_guards, *in_laws) if isinstance(a, Reading)}
    return SensorUse(
        sensor.name, sensor.lower, sensor.upper, sensor.index, tuple(sorted(ages)),
        tuple(guards), tuple(laws), _missing(sensor),
    )  # fmt: skip


def _missing(sensor: Sensor) -> str:
    match sensor.missing:
        case Zero():
            return "counts as 0"
        case Hold(None):
            return "held"
        case Hold(0):
            return "held, and every action takes its safe value"
        case Hold(limit):
            return f"held; after {limit} in a row every action takes its safe value"
        case _:
            assert_never(sensor.missing)


def _warm_up(interface: Interface) -> str:
    match interface.fill:
        case Fill.FIRST:
            return (
                "a sensor's first good reading fills its window (changes start at 0); before it "
                "readings are the middle of the range"
            )
        case Fill.ZERO:
            return "windows start with zeros, so the first changes and sums are of those"
        case _:
            assert_never(interface.fill)
