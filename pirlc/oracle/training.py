"""What a training is, and what is said of it under way; `train` and `attempt` do the work."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pirlc.ir.policy import Environment
from pirlc.oracle.network import NetworkOracle
from pirlc.oracle.settings import Settings
from pirlc.simulation.environments import EnvironmentFacts


@dataclass(frozen=True)
class Training:
    """All that determines an oracle, but for the versions of the libraries."""

    environment: Environment
    facts: EnvironmentFacts
    algorithm: str
    settings: Settings
    seed: int


Candidate = tuple[float, NetworkOracle]
"""A policy with its mean return over the episodes that policies are selected by."""
FINALISTS = 3
"""How many candidates each attempt hands on, and how many meet in the run-off."""


@dataclass(frozen=True)
class Progress:
    """How far a training is.

    `fraction` of the steps that this attempt (counted from 1) may take, 0 to 1: it may end sooner.
    `steps`: taken in all attempts. `recent`: the mean return of the last exploring episodes,
    `best`: of the best evaluation so far; None before there is one.
    """

    fraction: float
    steps: int
    attempt: int
    recent: float | None
    best: float | None


Report = Callable[[Progress], None]

Tell = Callable[[int, float | None, float | None], None]
"""What an attempt calls with its steps, recent return and best evaluation."""
