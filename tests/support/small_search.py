"""A search on CartPole with an oracle written by hand, small enough for tests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pirlc.frontend import parse_sketch
from pirlc.ir.policy import Environment
from pirlc.search.candidate import Candidate
from pirlc.search.context import Search
from pirlc.search.imitation import create_histories
from pirlc.search.journal import Journal
from pirlc.search.ndps import ndps
from pirlc.search.settings import Progress, Settings
from pirlc.simulation.workers import ALONE, Workers
from pirlc.source import SourceText
from pirlc.tune.how import Optimizer

SKETCH = parse_sketch(
    SourceText(
        "cartpole",
        """
policy cartpole
environment "CartPole-v1"
sensor Position        : [-2.4, 2.4]   = 0
sensor Velocity        : [-3, 3]       = 1
sensor Angle           : [-0.21, 0.21] = 2
sensor AngularVelocity : [-3.5, 3.5]   = 3
window 2
action Push : {0, 1} = if Law > 0 then 1 else 0
rule Term(x) = ?k * peek(x, -1) | ?k * fold(+, x)
rule Law = Term(Angle) | Law + Term(AngularVelocity) | Law + Term(Position)
""",
    )
)

SETTINGS = Settings(
    largest=30,
    create_episodes=3,
    update_episodes=2,
    histories=400,
    pool=8,
    neighbours=5,
    per_move=4,
    iterations=2,
    simulated=3,
    episodes=8,
    refined=2,
    refine_episodes=800,
    optimizer=Optimizer.CASADI,
)

SHORT = Environment("CartPole-v1", (("max_episode_steps", 12),))
"""Long enough to tell falling at once from standing."""


@dataclass(frozen=True)
class ByHand:
    """A policy that balances the pole for all 500 steps."""

    def actions(self, observations: NDArray[np.float64]) -> NDArray[np.float64]:
        law = observations @ np.array([0.3, 0.6, 6.0, 1.5])
        return (law > 0.0).astype(np.float64)[:, np.newaxis]

    def values(self, observations: NDArray[np.float64]) -> None:  # noqa: ARG002
        return

    def reset(self) -> None:
        pass

    def act(self, observation: NDArray[np.float64]) -> tuple[float, ...]:
        return tuple(self.actions(np.asarray(observation)[np.newaxis])[0].tolist())


@dataclass
class Run:
    """A search with what it told and recorded."""

    search: Search
    told: list[Progress]
    recorded: list[tuple[str, Candidate]]


def search_in(
    journal: Journal,
    environment: Environment | None = None,
    settings: Settings = SETTINGS,
    workers: Workers = ALONE,
) -> Run:
    told: list[Progress] = []
    recorded: list[tuple[str, Candidate]] = []
    search = Search(
        SKETCH,
        environment or Environment("CartPole-v1"),
        settings,
        journal,
        workers,
        told.append,
        lambda stage, candidate: recorded.append((stage, candidate)),
    )
    return Run(search, told, recorded)


def imitate(run: Run) -> Candidate:
    objective = create_histories(run.search, ByHand())
    return ndps(run.search, objective, augment=True)
