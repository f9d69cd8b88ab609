"""What a change of a program, or of where it starts, does in the simulator.

Always the difference of two runs that share everything else: what disturbs both alike is no part of
it. A run's rows are all of the observation, then the action's components, the last one first.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirlc.analyze.findings import Plant
from pirlc.analyze.plants.dithered import shortened
from pirlc.analyze.plants.equations import known_equations
from pirlc.analyze.plants.states import Resettable, resettable
from pirlc.ir.operators import Operator
from pirlc.ir.policy import Environment, Program
from pirlc.ir.terms import Apply, Literal
from pirlc.semantics.policies import InterpretedPolicy
from pirlc.simulation.environments import facts, make
from pirlc.simulation.rollout import run_episode

Real = NDArray[np.float64]

STARTS = 6
"""Places in an episode at which a change is tried."""

_EPISODE = 1500

_SETTLED = 0.4
"""The share of an episode, from its start, in which the loop is not yet about its operating
point."""


def with_offset(program: Program, action: str, offset: float) -> Program:
    """The program with a number added to an action (before it is clipped)."""
    bodies = tuple(
        Apply(Operator.ADD, (body, Literal(offset))) if spec.name == action else body
        for spec, body in zip(program.interface.actions, program.bodies, strict=True)
    )
    return replace(program, bodies=bodies)


def _rows(observations: Real, actions: Real) -> Real:
    return np.concatenate([observations, actions[:, ::-1]], axis=1)


class _Changing:
    """A program that is another one from a step on, with the windows of the first."""

    def __init__(self, first: Program, second: Program, at: int) -> None:
        self._first, self._second = InterpretedPolicy(first), InterpretedPolicy(second)
        self._at = at
        self._step = 0

    def reset(self) -> None:
        self._first.reset()
        self._step = 0

    def act(self, observation: Real) -> tuple[float, ...]:
        policy = self._first if self._step < self._at else self._second
        if self._step == self._at:
            self._second.state = self._first.state
        self._step += 1
        return policy.act(observation)


def from_episodes(
    program: Program, moved: Program, environment: Environment, steps: int, trust: bool
) -> list[Real]:
    """The differences (steps, columns) that it makes to go on with `moved`, from several places of
    an episode on. Raises PirlcError E0501 to E0518."""
    limit = facts(environment, trust).max_episode_steps
    simulator = make(shortened(environment, _EPISODE, limit), trust)
    try:
        plain = run_episode(simulator, InterpretedPolicy(program), 0)
        before = _rows(plain.observations, plain.actions)
        first = int(_SETTLED * len(before))
        last = max(len(before) - steps, first)
        found = []
        for place in sorted({int(place) for place in np.linspace(first, last, STARTS)}):
            episode = run_episode(simulator, _Changing(program, moved, place), 0)
            after = _rows(episode.observations, episode.actions)
            end = min(len(before), len(after), place + steps)
            found.append(after[place:end] - before[place:end])
        return found
    finally:
        simulator.close()


def from_states(
    program: Program,
    moved: Program,
    environment: Environment,
    plant: Plant,
    start: Real,
    steps: int,
    trust: bool,
) -> list[Real]:
    """The difference (steps, columns) between `moved` from the state `start` and `program` from the
    plant's operating point. Raises PirlcError E0501 to E0504."""
    simulator = make(environment, trust)
    rest = np.array([plant.operating[name] for name in plant.states])
    try:
        with warnings.catch_warnings():
            # Gymnasium warns of steps from states in which an episode would have ended.
            warnings.simplefilter("ignore")
            system = resettable(simulator, environment.id)
            before, after = (
                _run(which, environment, system, plant, state, steps)
                for which, state in ((program, rest), (moved, start))
            )
        return [after - before]
    finally:
        simulator.close()


def _run(
    program: Program,
    environment: Environment,
    system: Resettable,
    plant: Plant,
    state: Real,
    steps: int,
) -> Real:
    system.simulator.reset(seed=0)
    observation = _reading_of(program, environment, system, plant, state)
    policy = InterpretedPolicy(program)
    observations, actions = [], []
    for _ in range(steps):
        action = policy.act(observation)
        observations.append(observation)
        actions.append(action)
        state, observation = system.advance(state, np.array(action))
    return _rows(np.array(observations), np.array(actions))


def _reading_of(
    program: Program, environment: Environment, system: Resettable, plant: Plant, state: Real
) -> Real:
    """The observation of a state that no step has led to."""
    space: Any = system.simulator.observation_space
    equations = known_equations(environment)
    if equations is not None:
        action = np.zeros(equations.step.numel_in(1))
        values = np.array(equations.step(state, action)[1], np.float64).reshape(-1)
        return np.asarray(values.astype(space.dtype), dtype=np.float64)
    observation = np.zeros(space.shape)
    rest = np.array([plant.operating[name] for name in plant.states])
    readings = np.array(plant.c) @ (state - rest)
    for name, value in zip(plant.outputs, readings, strict=True):
        place = program.interface.sensor(name).index
        observation[place] = plant.operating[name] + value
    return observation
