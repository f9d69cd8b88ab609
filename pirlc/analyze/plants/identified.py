"""Plants identified from rollouts of the program with a small dither on its actions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from pirlc.analyze.findings import Origin, Plant
from pirlc.analyze.identification import (
    Arx,
    Chosen,
    Record,
    choose,
    fit_percent,
    free_run,
    one_step,
)
from pirlc.analyze.plants.dithered import Rollout, Rollouts, roll_out
from pirlc.analyze.plants.linear import rows
from pirlc.analyze.plants.problems import NotExcited, TooShort, failure
from pirlc.analyze.plants.subject import Subject, sample_time, sensors_of
from pirlc.ir.evidence import tested
from pirlc.ir.policy import ActionSpec, Sensor
from pirlc.simulation.environments import Simulator

Vector = NDArray[np.float64]

LEAST_STEPS = 50
"""A rollout with fewer usable steps is left out."""

LONGEST_RUN = 50
"""Steps after which a free run is started anew; fewer for an unstable plant (`horizon_of`)."""

_GROWTH = 3.0


def identify_plant(subject: Subject, simulator: Simulator, rollouts: Rollouts) -> Plant:
    """ARX models of the actions with the sensors that they read, side by side in one plant.

    Actions that read a sensor in common are identified together. For each, the other actions go on
    as the program has them: they are part of what it meets.

    Raises PirlcError E0514 to E0518 for the rollouts, E0934 or E0935 where they do not serve.
    """
    usable = [r for r in roll_out(subject, simulator, rollouts) if len(r) >= LEAST_STEPS]
    name = subject.environment.id
    if len(usable) < 4:
        found = sum(map(len, usable))
        raise failure(TooShort(name, found, 4 * LEAST_STEPS))
    models = [
        _identified(subject, actions, sensors, usable) for actions, sensors in _groups(subject)
    ]
    seen = np.mean(np.concatenate([rollout.observations for rollout in usable]), axis=0)
    return _joined(subject, simulator, rollouts, models, seen)


@dataclass(frozen=True)
class Identified:
    actions: tuple[ActionSpec, ...]
    sensors: tuple[Sensor, ...]
    chosen: Chosen
    one_step: Vector
    free_run: Vector
    horizon: int
    steps: int


def _groups(
    subject: Subject,
) -> list[tuple[tuple[ActionSpec, ...], tuple[Sensor, ...]]]:
    """Actions with the sensors that they read, put together where these meet."""
    groups: list[tuple[list[ActionSpec], set[str]]] = []
    for action, body in zip(subject.actions, subject.program.bodies, strict=True):
        names = {sensor.name for sensor in sensors_of(subject, body)}
        if not names and action is subject.actions[0] and len(subject.actions) == 1:
            names = {sensor.name for sensor in subject.sensors}
        meeting = [group for group in groups if group[1] & names]
        members = [action]
        for group in meeting:
            groups.remove(group)
            members = [*group[0], *members]
            names |= group[1]
        if names:
            groups.append((members, names))
    return [
        (tuple(members), tuple(s for s in subject.sensors if s.name in names))
        for members, names in groups
    ]


def _identified(
    subject: Subject,
    actions: tuple[ActionSpec, ...],
    sensors: tuple[Sensor, ...],
    usable: Sequence[Rollout],
) -> Identified:
    columns = [sensor.index for sensor in sensors]
    components = [action.component for action in actions]
    records = [
        Record(r.observations[:, columns], r.actions[:, components], r.dither[:, components])
        for r in usable
    ]
    for what, names, data in (
        ("action", [a.name for a in actions], [r.u for r in records]),
        ("sensor", [s.name for s in sensors], [r.y for r in records]),
    ):
        for place, which in enumerate(names):
            if all(np.ptp(values[:, place]) == 0.0 for values in data):
                raise failure(NotExcited(subject.environment.id, what, which))
    half, quarter = len(records) // 2, len(records) // 4
    estimation, selection = records[:half], records[half : half + quarter]
    held_out = records[half + quarter :]
    chosen = choose(estimation, selection)
    ahead = [one_step(chosen.model, record) for record in held_out]
    horizon = horizon_of(chosen.model)
    free = [free_run(chosen.model, record, horizon) for record in held_out]
    steps = sum(map(len, held_out))
    return Identified(actions, sensors, chosen, _fit(ahead), _fit(free), horizon, steps)


def horizon_of(model: Arx) -> int:
    """Steps in which the model's own unstable poles magnify an error threefold, at most
    `LONGEST_RUN`: longer free runs of any model leave the plant."""
    fastest = float(np.max(np.abs(np.linalg.eigvals(model.state_space()[0]))))
    if fastest <= _GROWTH ** (1.0 / LONGEST_RUN):
        return LONGEST_RUN
    return max(3, int(np.log(_GROWTH) / np.log(fastest)))


def _fit(pairs: Sequence[tuple[Vector, Vector]]) -> Vector:
    return fit_percent(
        np.concatenate([predicted for predicted, _ in pairs]),
        np.concatenate([measured for _, measured in pairs]),
    )


def _joined(
    subject: Subject,
    simulator: Simulator,
    rollouts: Rollouts,
    models: Sequence[Identified],
    seen: Vector,
) -> Plant:
    """`seen` (d,): the mean observation, for the sensors that only conditions read."""
    systems = [model.chosen.model.state_space() for model in models]
    inputs = [action for model in models for action in model.actions]
    outputs = [sensor for model in models for sensor in model.sensors]
    columns = [inputs.index(a) if a in inputs else None for a in subject.actions]
    order = [outputs.index(sensor) for sensor in subject.sensors if sensor in outputs]
    a, c = block_diag(*(s[0] for s in systems)), block_diag(*(s[2] for s in systems))
    b = block_diag(*(s[1] for s in systems))
    zero = np.zeros(len(a))
    b = np.stack([zero if column is None else b[:, column] for column in columns], axis=1)
    c = c[order]
    states: list[str] = []
    operating: dict[str, float] = {}
    fit: dict[str, float] = {}
    notes: list[str] = []
    for model in models:
        arx = model.chosen.model
        readings = [sensor.name for sensor in model.sensors]
        states += [
            name if lag == 0 else f"{name}, part {lag + 1}"
            for lag in range(arx.order)
            for name in (f"model of {reading}" for reading in readings)
        ]
        operating.update(zip(readings, map(float, arx.y_mean), strict=True))
        operating.update(zip((a.name for a in model.actions), map(float, arx.u_mean), strict=True))
        fit.update(zip(readings, map(float, model.free_run), strict=True))
        notes.append(_note(model))
    notes.append(
        f"from {rollouts.episodes} rollouts of the program with a random dither of "
        f"{rollouts.dither:.3g} of each action's range, without the first {rollouts.settled:.0%} "
        "of each; a linear model of what happens there, with the other actions as the program has "
        "them"
    )
    for state in states:
        operating.setdefault(state, 0.0)
    for sensor in subject.program.interface.sensors:
        operating.setdefault(sensor.name, float(seen[sensor.index]))
    for action in subject.actions:
        operating.setdefault(action.name, float(action.safe))
    kept: list[Any] = [outputs[place] for place in order]
    steps = min(model.steps for model in models)
    return Plant(
        name=f"{subject.environment.id} (identified)",
        origin=Origin.IDENTIFIED,
        a=rows(a),
        b=rows(b),
        c=rows(c),
        d=rows(np.zeros((len(c), b.shape[1]))),
        states=tuple(states),
        inputs=tuple(action.name for action in subject.actions),
        outputs=tuple(sensor.name for sensor in kept),
        sample_time=sample_time(subject, simulator),
        operating=operating,
        evidence=tested(steps, "held-out steps; the fit is of free runs from the actions alone"),
        fit=fit,
        notes=tuple(notes),
    )


def _note(model: Identified) -> str:
    names = " and ".join(action.name for action in model.actions)
    fits = ", ".join(
        f"{sensor.name} {ahead:.1f} % one step ahead, {free:.1f} % in free runs of "
        f"{model.horizon} steps"
        for sensor, ahead, free in zip(model.sensors, model.one_step, model.free_run, strict=True)
    )
    how = "instrumental variables (the dither)" if model.chosen.instruments else "least squares"
    order = model.chosen.model.order
    return f"{names}: ARX of order {order} by {how}; fit on held-out rollouts: {fits}"
