"""What the linear loop predicts beside what the simulator does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pirlc.analyze.closed_loop import (
    Mode,
    Shape,
    closed_loop,
    law,
    parts_of,
    shape_of,
    why_not,
    within,
)
from pirlc.analyze.findings import Leaf, Origin, Plant, ResponseFinding
from pirlc.analyze.simulated import from_episodes, from_states, with_offset
from pirlc.ir.evidence import tested, unknown
from pirlc.ir.policy import Continuous, Environment, Fill, Program

Real = NDArray[np.float64]

SHARE = 0.05
"""A setpoint steps by this share of its sensor's range, if the action has room for that."""

ROOM = 0.5
"""The share of the action's room around the operating point that a predicted action may take."""

_SHORTEST, _LONGEST = 20, 200

_WITH_STATES = (Origin.EQUATIONS, Origin.SIMULATOR)
"""Plants whose states are those of the simulator."""


@dataclass(frozen=True)
class Change:
    """What is done to the loop: the leaf's offset steps by `offset`, and the state starts at
    `state` (over the shape's states). `what` says it."""

    what: str
    offset: float
    state: Real


def response_of(
    program: Program,
    environment: Environment,
    plant: Plant,
    leaf: Leaf,
    others: Sequence[Leaf] = (),
    *,
    trust: bool = False,
) -> ResponseFinding:
    """The loop of one leaf, with `others` closed (one a further action), predicted and simulated.

    Where the leaf has a setpoint, after a step of that; else from a state off the operating point,
    where the simulator can be put into a state, or after a step of the action. Raises PirlcError
    E0501 to E0518 for the environment.
    """
    latency = program.interface.latency
    every, _ = within(plant, [leaf, *others])
    if not every or every[0].action != leaf.action or not every[0].filters:
        return _nothing(leaf, f"{leaf.name} closes no loop around the plant")
    against = why_not(plant, every)
    if against is not None:
        return _nothing(leaf, against)
    whole, leaf = plant, every[0]
    plant, leaves = next(part for part in parts_of(whole, every) if leaf.action in part[0].inputs)
    shape = shape_of(plant, leaves, latency)
    mode = Mode(leaf.name, {each.action: each for each in leaves})
    matrix = np.array(closed_loop(shape, mode), dtype=np.float64)
    change = _change(program, shape, leaf, matrix)
    predicted = _predicted(shape, leaf, matrix, change, _LONGEST)
    fastest = float(np.max(np.abs(np.linalg.eigvals(matrix))))
    if fastest > 1.0 and _grows(predicted):
        return _nothing(leaf, f"the linear loop is unstable (spectral radius {fastest:.4g})")
    steps = _settled(predicted)
    if plant.origin in _WITH_STATES:
        off = dict(zip(plant.states, change.state, strict=False))
        start = [whole.operating[name] + off.get(name, 0.0) for name in whole.states]
        moved = with_offset(program, leaf.action, change.offset) if change.offset else program
        runs = from_states(program, moved, environment, whole, np.array(start), steps, trust)
    else:
        moved = with_offset(program, leaf.action, change.offset)
        runs = from_episodes(program, moved, environment, steps, trust)
    names = (*plant.outputs, *plant.inputs)
    usable = [run for run in runs if len(run) >= _SHORTEST]
    if not usable:
        return _nothing(leaf, f"{change.what}: no episode is long enough to show it")
    length = min(steps, *(len(run) for run in usable))
    columns = _columns(program, plant)
    simulated = np.mean([run[:length] for run in usable], axis=0)[:, columns]
    return _finding(leaf, plant, change, names, predicted[:length], simulated, len(usable))


def _nothing(leaf: Leaf, reason: str) -> ResponseFinding:
    return ResponseFinding(leaf.action, leaf.name, "", (), {}, {}, {}, unknown(reason))


def _grows(predicted: Real) -> bool:
    """Whether a response goes on growing: a pole that it neither moves nor shows does no harm."""
    size = np.max(np.abs(predicted), axis=1)
    half = len(size) // 2
    return bool(np.max(size[half:]) > 2.0 * np.max(size[:half]) or not np.all(np.isfinite(size)))


def _settled(predicted: Real) -> int:
    """Steps after which a response stays within a thousandth of where it is going."""
    gap = np.abs(predicted - predicted[-1]) > 1e-3 * np.max(np.abs(predicted), axis=0)
    last = int(np.flatnonzero(gap.any(axis=1)).max(initial=0))
    return int(np.clip(last + 1, _SHORTEST, _LONGEST))


def _change(program: Program, shape: Shape, leaf: Leaf, matrix: Real) -> Change:
    """As large as linearity may be hoped for."""
    plant, size = shape.plant, len(shape.states)
    pid = next((form for form in leaf.pids if form.setpoint is not None and form.dc_gain), None)
    if pid is not None:
        sensor = program.interface.sensor(pid.sensor)
        step = SHARE * (sensor.upper - sensor.lower)
        gain = float(pid.dc_gain)
        unit = Change("", gain * step, np.zeros(size))
        share = _fitting(program, shape, leaf, matrix, unit)
        step *= share
        what = f"a step of the setpoint of {pid.sensor} by {step:.3g}"
        return Change(what, gain * step, np.zeros(size))
    if plant.origin not in _WITH_STATES:
        spec = next(a for a in program.interface.actions if a.name == leaf.action)
        assert isinstance(spec.domain, Continuous)
        step = SHARE * (spec.domain.upper - spec.domain.lower)
        unit = Change("", step, np.zeros(size))
        step *= _fitting(program, shape, leaf, matrix, unit)
        return Change(f"a step of {leaf.action} by {step:.3g}", step, np.zeros(size))
    read = next(
        (f for f in leaf.filters if f.dc_gain and any(_row(plant, f.sensor))),
        leaf.filters[0],
    )
    row = np.array(_row(plant, read.sensor))
    sensor = program.interface.sensor(read.sensor)
    step = SHARE * (sensor.upper - sensor.lower)
    direction = row / float(row @ row) if np.any(row) else np.eye(len(row))[0]
    start = _started(program, shape, direction * step)
    step *= _fitting(program, shape, leaf, matrix, Change("", 0.0, start))
    what = f"released where {read.sensor} is {step:.3g} off"
    return Change(what, 0.0, _started(program, shape, direction * step))


def _row(plant: Plant, sensor: str) -> tuple[float, ...]:
    return plant.c[plant.outputs.index(sensor)]


def _started(program: Program, shape: Shape, state: Real) -> Real:
    """The whole state at reset in a plant's state: what the windows hold then."""
    whole = np.zeros(len(shape.states))
    n = len(state)
    whole[:n] = state
    if program.interface.fill is Fill.FIRST:
        readings = np.array(shape.plant.c) @ state
        at = n
        for name, value in zip(shape.plant.outputs, readings, strict=True):
            whole[at : at + shape.depth[name]] = value
            at += shape.depth[name]
    return whole


def _fitting(program: Program, shape: Shape, leaf: Leaf, matrix: Real, unit: Change) -> float:
    """The share of a change, at most 1, at which the predicted action stays inside its range."""
    plant = shape.plant
    predicted = _predicted(shape, leaf, matrix, unit, _LONGEST)
    column = len(plant.outputs) + plant.inputs.index(leaf.action)
    largest = float(np.max(np.abs(predicted[:, column])))
    spec = next(a for a in program.interface.actions if a.name == leaf.action)
    assert isinstance(spec.domain, Continuous)
    at = plant.operating.get(leaf.action, spec.safe)
    room = min(spec.domain.upper - at, at - spec.domain.lower)
    if room <= 0.0:
        room = spec.domain.upper - spec.domain.lower
    return min(1.0, ROOM * room / largest) if largest > 0.0 else 1.0


def _predicted(shape: Shape, leaf: Leaf, matrix: Real, change: Change, steps: int) -> Real:
    """Deviations (steps, outputs and inputs) of the linear closed loop."""
    plant, size, n = shape.plant, len(shape.states), len(shape.plant.states)
    entry = np.zeros(size)
    entry[:n] = np.array(plant.b)[:, plant.inputs.index(leaf.action)]
    if leaf.action in shape.recalled:
        entry[size - len(shape.recalled) + shape.recalled.index(leaf.action)] = 1.0
    row = np.array(law(shape, leaf), dtype=np.float64)
    c = np.array(plant.c)
    found = np.zeros((steps, len(plant.outputs) + len(plant.inputs)))
    z = change.state.copy()
    for k in range(steps):
        found[k, : len(c)] = c @ z[:n]
        found[k, len(c) + plant.inputs.index(leaf.action)] = row @ z + change.offset
        z = matrix @ z + entry * change.offset
    return found


def _columns(program: Program, plant: Plant) -> list[int]:
    """Where outputs and inputs stand in a run's rows: all of the observation, then the actions."""
    sensors = {sensor.name: sensor.index for sensor in program.interface.sensors}
    components = {action.name: -1 - action.component for action in program.interface.actions}
    return [sensors[name] for name in plant.outputs] + [components[name] for name in plant.inputs]


def _finding(
    leaf: Leaf,
    plant: Plant,
    change: Change,
    names: Sequence[str],
    predicted: Real,
    simulated: Real,
    runs: int,
) -> ResponseFinding:
    unit = plant.sample_time or 1.0
    largest = np.max(np.abs(predicted), axis=0)
    shown = [i for i, size in enumerate(largest) if size > 1e-9]
    gap = np.max(np.abs(simulated - predicted), axis=0)
    error = {names[i]: float(gap[i] / largest[i]) for i in shown}
    # Of deviations: zero is where they are measured from, not their mean.
    miss = np.linalg.norm(simulated - predicted, axis=0)
    size = np.maximum(np.linalg.norm(simulated, axis=0), 1e-300)
    fit = {names[i]: float(100.0 * (1.0 - miss[i] / size[i])) for i in shown}
    words = ", ".join(f"{name} {value:.1f} %" for name, value in fit.items())
    where = "one run" if runs == 1 else f"the mean of {runs} places in an episode"
    notes = [f"fit of the prediction to {where}: {words}"]
    far = [name for name, value in fit.items() if value < 50.0]
    if far:
        notes.append(
            f"prediction and simulator disagree in {', '.join(far)}: saturation, another branch, "
            "or a plant that is not linear or not known well enough there"
        )
    return ResponseFinding(
        action=leaf.action,
        leaf=leaf.name,
        what=change.what,
        times=tuple((np.arange(len(predicted)) * unit).tolist()),
        predicted={names[i]: tuple(predicted[:, i].tolist()) for i in shown},
        simulated={names[i]: tuple(simulated[:, i].tolist()) for i in shown},
        error=error,
        evidence=tested(runs * len(predicted), "steps of the simulator"),
        notes=tuple(notes),
        fit=fit,
    )
