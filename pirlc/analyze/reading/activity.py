"""Which branches a program takes, counted over simulated steps."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING

from pirlc.analyze.paths import Path, paths
from pirlc.analyze.reading.findings import ProgramReading, Simulated
from pirlc.ir.policy import Program
from pirlc.semantics.interpreter import Scope, evaluate, initial_state, step
from pirlc.semantics.precision import BINARY64
from pirlc.simulation.environments import facts_of, make, require_environment
from pirlc.simulation.native import is_deterministic
from pirlc.simulation.rollout import run_episode

if TYPE_CHECKING:
    from pirlc.ir.observation import Observation


def with_shares(
    reading: ProgramReading, program: Program, episodes: int, first_seed: int, *, trust: bool
) -> ProgramReading:
    """The reading with the share of steps of each branch, over episodes from ascending seeds.

    A deterministic environment has only one episode. Raises PirlcError E0501 to E0518, E0513 for a
    program that names no environment.
    """
    environment = require_environment(program.interface)
    simulator = make(environment, trust)
    try:
        count = 1 if is_deterministic(simulator) else episodes
        seconds = reading.sample_time or facts_of(simulator, environment).sample_time
        watched = _Watched(program)
        for seed in range(first_seed, first_seed + count):
            run_episode(simulator, watched, seed)
    finally:
        simulator.close()
    actions = []
    for action, taken, changes in zip(reading.actions, watched.taken, watched.changes, strict=True):
        branches = tuple(
            replace(branch, taken=taken[branch.number] / max(1, watched.steps))
            for branch in action.branches
        )
        rate = changes / max(1, watched.steps) / (seconds or 1.0)
        actions.append(replace(action, branches=branches, switches=rate))
    simulated = Simulated(
        environment.id, count, first_seed, watched.steps, None if seconds is None
        else watched.steps * seconds,
    )  # fmt: skip
    return replace(reading, sample_time=seconds, actions=tuple(actions), simulated=simulated)


class _Watched:
    """The program as the reference interpreter runs it; counts, by action, the branch of each step.

    `taken[i][k]`: steps on branch k (from 1) of action i; `changes[i]`: how often it was another
    than in the step before.
    """

    def __init__(self, program: Program) -> None:
        self.program = program
        self.ways: list[tuple[Path, ...]] = [paths(body)[0] for body in program.bodies]
        self.taken: list[Counter[int]] = [Counter() for _ in self.ways]
        self.changes = [0 for _ in self.ways]
        self.steps = 0
        actions = program.interface.actions
        self._order = sorted(range(len(actions)), key=lambda i: actions[i].component)
        self.reset()

    def reset(self) -> None:
        self._state = initial_state(self.program)
        self._last: list[int | None] = [None for _ in self.ways]

    def act(self, observation: Observation) -> tuple[float, ...]:
        before = self._state.previous
        result = step(self.program, self._state, observation)
        self._state = result.state
        interface = self.program.interface
        scope = Scope(
            parameters=self.program.values,
            windows={
                sensor.name: found.buffer[: interface.window]
                for sensor, found in zip(interface.sensors, result.state.sensors, strict=True)
            },
            previous={a.name: value for a, value in zip(interface.actions, before, strict=True)},
            locals={},
        )
        for i, ways in enumerate(self.ways):
            number = next((k for k, way in enumerate(ways, start=1) if _on(way, scope)), 0)
            self.taken[i][number] += 1
            self.changes[i] += self._last[i] not in (None, number)
            self._last[i] = number
        self.steps += 1
        return tuple(result.actions[i] for i in self._order)


def _on(way: Path, scope: Scope) -> bool:
    return all(evaluate(c.term, scope, BINARY64) == c.holds for c in way.conditions)
