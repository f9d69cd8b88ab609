"""What is known of environments that many use without making them."""

from __future__ import annotations

from collections.abc import Mapping

from pirlc.ir.policy import Environment

_KNOWN: Mapping[str, Mapping[int, str]] = {
    "CartPole": {0: "push left", 1: "push right"},
    "MountainCar": {0: "push left", 1: "do not push", 2: "push right"},
    "Acrobot": {0: "torque -1", 1: "torque 0", 2: "torque +1"},
}
"""Of Gymnasium's environments, whatever their version (its documentation, Action Space)."""


def meanings_of(environment: Environment | None) -> Mapping[int, str]:
    """Words for an environment's actions; nothing where none are known."""
    name = "" if environment is None else environment.id.partition("-v")[0]
    return _KNOWN.get(name, {})


_STEPS = {"CartPole": 0.02, "Pendulum": 0.05, "Acrobot": 0.2, "pirlc/Torcs": 0.02}
"""Seconds a step."""


def sample_time_of(environment: Environment | None) -> float | None:
    """Seconds a step; None where it is not known."""
    return None if environment is None else _STEPS.get(environment.id.partition("-v")[0])
