"""From equations or differences at an operating point to a `Plant` for a program."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from pirlc.analyze.findings import Matrix, Origin, Plant
from pirlc.analyze.plants.differences import Derivatives
from pirlc.analyze.plants.equations import Equations, OperatingPoint
from pirlc.analyze.plants.states import Resettable
from pirlc.analyze.plants.subject import Subject
from pirlc.ir.evidence import Evidence, tested

Vector = NDArray[np.float64]

CHECKED_STATES = 16
"""States at which equations are compared with a step of the simulator."""


def rows(matrix: Vector) -> Matrix:
    return tuple(tuple(float(value) for value in row) for row in np.atleast_2d(matrix))


def jacobians(equations: Equations, point: OperatingPoint) -> Derivatives:
    """Exact derivatives of the discretised equations, by CasADi."""
    x, u = (
        ca.SX.sym("x", len(point.state)),
        ca.SX.sym("u", len(point.action)),
    )
    following, readings = equations.step(x, u)
    function = ca.Function(
        "jacobians",
        [x, u],
        [ca.jacobian(following, x), ca.jacobian(following, u), ca.jacobian(readings, x), readings],
    )
    a, b, c, y = (np.array(value, np.float64) for value in function(point.state, point.action))
    return Derivatives(a, b, c, y.reshape(-1), 0.0)


def largest_miss(
    equations: Equations, point: OperatingPoint, system: Resettable, spread: float = 0.05
) -> float:
    """The largest difference between a step of the equations and of the simulator.

    From states around `point`; relative to max(1, |x|), angles up to whole turns.
    """
    generator = np.random.default_rng(0)
    space = system.simulator.action_space
    turning = np.array([name in equations.angles for name in equations.states])
    worst = 0.0
    for _ in range(CHECKED_STATES):
        state = np.array(point.state) + spread * generator.uniform(-1.0, 1.0, system.size)
        action = np.atleast_1d(np.array(space.sample(), np.float64))
        after, observation = system.advance(state, action)
        # The simulator may have rounded the state that it was given.
        predicted = np.array(equations.step(state, action)[0], np.float64).reshape(-1)
        readings = np.array(equations.step(after, action)[1], np.float64).reshape(-1)
        gap = after - predicted
        gap[turning] = np.remainder(gap[turning] + np.pi, 2.0 * np.pi) - np.pi
        for difference, size in ((gap, predicted), (observation - readings, readings)):
            worst = max(worst, float(np.max(np.abs(difference) / np.maximum(1.0, np.abs(size)))))
    return worst


def assemble(
    subject: Subject,
    derivatives: Derivatives,
    point: OperatingPoint,
    states: tuple[str, ...],
    sample_time: float | None,
    origin: Origin,
    evidence: Evidence,
    notes: tuple[str, ...],
) -> Plant:
    """The plant from the program's actions to the sensors that it reads."""
    c = derivatives.c[subject.readings]
    b = derivatives.b[:, subject.components]
    # Those of conditions too: they tell which branch is taken there.
    every = subject.program.interface.sensors
    operating: Mapping[str, float] = {
        **dict(zip(states, point.state, strict=True)),
        **{a.name: point.action[a.component] for a in subject.actions},
        **{s.name: float(derivatives.observation[s.index]) for s in every},
    }
    return Plant(
        name=f"{subject.environment.id} ({point.name})",
        origin=origin,
        a=rows(derivatives.a),
        b=rows(b),
        c=rows(c),
        d=rows(np.zeros((len(subject.sensors), len(subject.actions)))),
        states=states,
        inputs=tuple(action.name for action in subject.actions),
        outputs=tuple(sensor.name for sensor in subject.sensors),
        sample_time=sample_time,
        operating=operating,
        evidence=evidence,
        notes=notes,
    )


def from_equations(
    subject: Subject,
    equations: Equations,
    point: OperatingPoint,
    sample_time: float | None,
    miss: float,
) -> Plant:
    start = np.array(point.state)
    after = np.array(equations.step(point.state, point.action)[0], np.float64).reshape(-1)
    drift = float(np.max(np.abs(after - start)))
    others = ", ".join(other.name for other in equations.points if other.name != point.name)
    also = f" (also known: {others})" if others else ""
    notes: tuple[str, ...] = (
        f"linearised at {point.name}{also}, by the derivatives of the equations as the environment "
        f"integrates them ({equations.source})",
    )
    if drift > 1e-9:
        notes += (
            f"{point.name} is no equilibrium: a step changes the state by up to {drift:.3g}, so "
            "the linear model is of the changes about a trajectory, and of its first step only",
        )
    evidence = tested(
        CHECKED_STATES, f"steps of the simulator near there; the equations miss them by {miss:.1g}"
    )
    return assemble(
        subject,
        jacobians(equations, point),
        point,
        equations.states,
        sample_time,
        Origin.EQUATIONS,
        evidence,
        notes,
    )


def from_differences(
    subject: Subject,
    derivatives: Derivatives,
    point: OperatingPoint,
    sample_time: float | None,
) -> Plant:
    states = tuple(f"state {i}" for i in range(len(point.state)))
    shown = ", ".join(f"{value:.4g}" for value in point.state)
    notes = (
        f"central differences of one step of the simulator at the state ({shown}), a state of rest "
        "near where the program leads it; two widths of the differences agree to "
        f"{derivatives.error:.1g}",
    )
    count = len(point.state) + len(point.action)
    return assemble(
        subject,
        derivatives,
        point,
        states,
        sample_time,
        Origin.SIMULATOR,
        tested(count, "directions of one step of the simulator"),
        notes,
    )
