"""Plants from published equations, discretised exactly as Gymnasium's environments integrate them.

Angles are not wrapped (wrapping changes no derivative). An action is the environment's own number
also where it is discrete: a push of CartPole is 0 or 1, and the force 20 a - 10 newtons.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca

from pirlc.ir.policy import Environment, Scalar

SX = Any
"""A `casadi.SX`: CasADi has no type stubs."""


@dataclass(frozen=True)
class OperatingPoint:
    """Where a plant is linearised: a state and the environment's action there."""

    name: str
    state: tuple[float, ...]
    action: tuple[float, ...]


@dataclass(frozen=True)
class Equations:
    """`step(x, u) -> (x of the next step, the readings of x)`: a CasADi function of column vectors.

    `points`: equilibria, the default first. It is the one that the task holds or, where reaching
    the goal ends the episode, the one that episodes start near. `angles`: the states that
    are angles. `source`: where the equations are published. States have names that no sensor can
    have.
    """

    states: tuple[str, ...]
    angles: tuple[str, ...]
    step: Any
    points: tuple[OperatingPoint, ...]
    source: str

    def point(self, name: str) -> OperatingPoint | None:
        return next((point for point in self.points if point.name == name), None)


_IDLE = frozenset({"render_mode", "max_episode_steps", "goal_velocity", "sutton_barto_reward"})
"""Arguments that no equation depends on."""


def known_equations(environment: Environment) -> Equations | None:
    """The equations of a classic-control environment; None for any other, or for arguments that
    they know nothing of."""
    arguments = {key: value for key, value in environment.arguments if key not in _IDLE}
    match environment.id:
        case "CartPole-v1" | "CartPole-v0" if not arguments:
            return cart_pole()
        case "Pendulum-v1" if set(arguments) <= {"g"}:
            gravity = _number(arguments, "g", 10.0)
            return None if gravity is None else pendulum(gravity)
        case "MountainCar-v0" if not arguments:
            return mountain_car()
        case "MountainCarContinuous-v0" if not arguments:
            return mountain_car_continuous()
        case "Acrobot-v1" if not arguments:
            return acrobot()
        case _:
            return None


def _number(arguments: Mapping[str, Scalar], name: str, default: float) -> float | None:
    value = arguments.get(name, default)
    numeric = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if numeric and math.isfinite(float(value)) else None


def _made(
    states: tuple[str, ...],
    angles: tuple[str, ...],
    dynamics: Callable[[SX, SX], tuple[SX, SX]],
    points: tuple[OperatingPoint, ...],
    source: str,
) -> Equations:
    x, u = ca.SX.sym("x", len(states)), ca.SX.sym("u", 1)
    following, readings = dynamics(x, u)
    step = ca.Function("step", [x, u], [following, readings], ["x", "u"], ["next", "readings"])
    return Equations(states, angles, step, points, source)


def _parts(x: SX) -> tuple[SX, ...]:
    return tuple(ca.vertsplit(x))


def _clip(value: SX, low: float, high: float) -> SX:
    return ca.fmin(ca.fmax(value, low), high)


def cart_pole() -> Equations:
    """Cart and pole without friction; explicit Euler steps of 0.02 s."""
    gravity, cart, pole, half, newtons, tau = 9.8, 1.0, 0.1, 0.5, 10.0, 0.02

    def dynamics(x: SX, u: SX) -> tuple[SX, SX]:
        _, speed, angle, turning = _parts(x)
        force = newtons * (2.0 * u[0] - 1.0)
        total = cart + pole
        push = (force + pole * half * turning**2 * ca.sin(angle)) / total
        turn = (gravity * ca.sin(angle) - ca.cos(angle) * push) / (
            half * (4.0 / 3.0 - pole * ca.cos(angle) ** 2 / total)
        )
        acceleration = push - pole * half * turn * ca.cos(angle) / total
        return x + tau * ca.vertcat(speed, acceleration, turning, turn), x

    return _made(
        ("cart position", "cart speed", "pole angle", "pole speed"),
        ("pole angle",),
        dynamics,
        (
            OperatingPoint("upright", (0.0, 0.0, 0.0, 0.0), (0.5,)),
            OperatingPoint("hanging", (0.0, 0.0, math.pi, 0.0), (0.5,)),
        ),
        "Barto, Sutton and Anderson 1983, corrected by Florian 2007",
    )


def pendulum(gravity: float = 10.0) -> Equations:
    """A rod of 1 m and 1 kg on a pivot; semi-implicit Euler steps of 0.05 s; 0 is upright."""
    mass, length, dt, most_torque, most_speed = 1.0, 1.0, 0.05, 2.0, 8.0

    def dynamics(x: SX, u: SX) -> tuple[SX, SX]:
        angle, speed = _parts(x)
        torque = _clip(u[0], -most_torque, most_torque)
        turn = 3 * gravity / (2 * length) * ca.sin(angle) + 3.0 / (mass * length**2) * torque
        faster = _clip(speed + turn * dt, -most_speed, most_speed)
        readings = ca.vertcat(ca.cos(angle), ca.sin(angle), speed)
        return ca.vertcat(angle + faster * dt, faster), readings

    return _made(
        ("rod angle", "rod speed"),
        ("rod angle",),
        dynamics,
        (
            OperatingPoint("upright", (0.0, 0.0), (0.0,)),
            OperatingPoint("hanging", (math.pi, 0.0), (0.0,)),
        ),
        "a uniform rod on a pivot, as Gymnasium documents Pendulum-v1",
    )


def _car(force: Callable[[SX], SX], idle: float) -> Equations:
    low, high, most_speed = -1.2, 0.6, 0.07

    def dynamics(x: SX, u: SX) -> tuple[SX, SX]:
        position, velocity = _parts(x)
        faster = velocity + force(u[0]) - 0.0025 * ca.cos(3 * position)
        faster = _clip(faster, -most_speed, most_speed)
        moved = _clip(position + faster, low, high)
        stopped = ca.logic_and(moved <= low, faster < 0)
        return ca.vertcat(moved, ca.if_else(stopped, 0.0, faster)), x

    return _made(
        ("car position", "car speed"),
        (),
        dynamics,
        (OperatingPoint("valley", (-math.pi / 6, 0.0), (idle,)),),
        "Moore 1990; Sutton and Barto, example 10.1",
    )


def mountain_car() -> Equations:
    """A car in a valley, pushed by 0.001 (a - 1); semi-implicit Euler, a step the unit of time."""
    return _car(lambda u: 0.001 * (u - 1.0), 1.0)


def mountain_car_continuous() -> Equations:
    """A car in a valley, pushed by 0.0015 a; semi-implicit Euler, one step the unit of time."""
    return _car(lambda u: 0.0015 * _clip(u, -1.0, 1.0), 0.0)


def acrobot() -> Equations:
    """Two links of 1 m and 1 kg with a torque a - 1 between them; Runge-Kutta steps of 0.2 s."""
    mass, length, center, inertia, gravity, dt = 1.0, 1.0, 0.5, 1.0, 9.8, 0.2

    def slope(x: SX, torque: SX) -> SX:
        first, second, turning, bending = _parts(x)
        d1 = (
            mass * center**2
            + mass * (length**2 + center**2 + 2 * length * center * ca.cos(second))
            + 2 * inertia
        )
        d2 = mass * (center**2 + length * center * ca.cos(second)) + inertia
        coupling = mass * length * center * ca.sin(second)
        phi2 = mass * center * gravity * ca.cos(first + second - math.pi / 2)
        phi1 = (
            -coupling * bending**2
            - 2 * coupling * bending * turning
            + (mass * center + mass * length) * gravity * ca.cos(first - math.pi / 2)
            + phi2
        )
        bend = (torque + d2 / d1 * phi1 - coupling * turning**2 - phi2) / (
            mass * center**2 + inertia - d2**2 / d1
        )
        return ca.vertcat(turning, bending, -(d2 * bend + phi1) / d1, bend)

    def dynamics(x: SX, u: SX) -> tuple[SX, SX]:
        torque = u[0] - 1.0
        k1 = slope(x, torque)
        k2 = slope(x + dt / 2 * k1, torque)
        k3 = slope(x + dt / 2 * k2, torque)
        k4 = slope(x + dt * k3, torque)
        moved = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        first, second, turning, bending = _parts(x)
        after = ca.vertcat(
            moved[0],
            moved[1],
            _clip(moved[2], -4 * math.pi, 4 * math.pi),
            _clip(moved[3], -9 * math.pi, 9 * math.pi),
        )
        angles = (ca.cos(first), ca.sin(first), ca.cos(second), ca.sin(second))
        return after, ca.vertcat(*angles, turning, bending)

    return _made(
        ("angle of link 1", "angle of link 2", "speed of link 1", "speed of link 2"),
        ("angle of link 1", "angle of link 2"),
        dynamics,
        (
            OperatingPoint("hanging", (0.0, 0.0, 0.0, 0.0), (1.0,)),
            OperatingPoint("upright", (math.pi, 0.0, 0.0, 0.0), (1.0,)),
        ),
        "Sutton 1996; Sutton and Barto, section 11.3 of the first edition",
    )
