"""Finding a plant: by known equations, by differences in the simulator, or from rollouts."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import assert_never

import numpy as np

from pirlc.analyze.findings import Origin, Plant
from pirlc.analyze.plants.differences import differences, find_rest
from pirlc.analyze.plants.dithered import Rollouts, shortened
from pirlc.analyze.plants.equations import Equations, OperatingPoint, known_equations
from pirlc.analyze.plants.identified import identify_plant
from pirlc.analyze.plants.linear import from_differences, from_equations, largest_miss
from pirlc.analyze.plants.problems import NoEquations, UnknownOperatingPoint, failure
from pirlc.analyze.plants.states import Resettable, Vector, middle_action, resettable
from pirlc.analyze.plants.subject import Subject, make_simulator, sample_time, subject_of
from pirlc.diagnostics import PirlcError
from pirlc.ir.policy import Environment, Program
from pirlc.semantics.policies import InterpretedPolicy
from pirlc.simulation.environments import Simulator, check_interface, facts_of, make
from pirlc.simulation.rollout import run_episode

_EPISODES = 5

AGREES = 1e-6
"""Equations are taken for the simulator's own where no checked step differs by more (relatively):
some of Gymnasium's environments compute in binary32."""


def find_plant(
    program: Program,
    environment: Environment,
    origin: Origin | None = None,
    operating_point: str | OperatingPoint | None = None,
    *,
    trust: bool = False,
    rollouts: Rollouts | None = None,
) -> Plant:
    """The plant between a program's actions and the sensors that they answer.

    `origin` None: linearised equations where they are known and the simulator steps as they do,
    else differences where the simulator can be put into a state, else identified from `rollouts` of
    the program; the notes say what was not possible. `operating_point`: the name of an equilibrium
    of known equations ("upright"), or a state and action; None: the equations' default, or where
    the program leads the simulator.

    Raises PirlcError E0501 to E0518 for the environment, E0930 to E0936 where there is no such
    plant; ValueError for a plant given in a file, which is none of this module's.
    """
    with warnings.catch_warnings():
        # Gymnasium warns of steps from states in which an episode would have ended.
        warnings.simplefilter("ignore")
        return _found(
            subject_of(program, environment), origin, operating_point, trust, rollouts or Rollouts()
        )


def _found(
    subject: Subject,
    origin: Origin | None,
    operating_point: str | OperatingPoint | None,
    trust: bool,
    rollouts: Rollouts,
) -> Plant:
    program, environment = subject.program, subject.environment
    simulator = make_simulator(subject, trust)
    try:
        misfits = check_interface(program.interface, facts_of(simulator, environment))
        errors = [misfit for misfit in misfits if misfit.severity.value == "error"]
        if errors:
            raise PirlcError(errors)
        match origin:
            case Origin.EQUATIONS:
                return _by_equations(subject, simulator, operating_point)
            case Origin.SIMULATOR:
                return _by_simulator(subject, simulator, operating_point)
            case Origin.IDENTIFIED:
                return _by_rollouts(subject, simulator, rollouts, trust)
            case Origin.GIVEN:
                raise ValueError("a plant given in a file is not to be found")
            case None:
                return _automatic(subject, simulator, operating_point, rollouts, trust)
            case _:
                assert_never(origin)
    finally:
        simulator.close()


def _automatic(
    subject: Subject,
    simulator: Simulator,
    operating_point: str | OperatingPoint | None,
    rollouts: Rollouts,
    trust: bool,
) -> Plant:
    refused: list[str] = []
    for attempt in (_by_equations, _by_simulator):
        try:
            plant = attempt(subject, simulator, operating_point)
        except PirlcError as error:
            codes = {diagnostic.code for diagnostic in error.diagnostics}
            named = isinstance(operating_point, str) and known_equations(subject.environment)
            if not codes <= {"E0930", "E0931", "E0932", "E0933"} or (named and "E0930" in codes):
                raise
            refused.extend(_words(diagnostic) for diagnostic in error.diagnostics)
        else:
            return _with_notes(plant, refused)
    return _with_notes(_by_rollouts(subject, simulator, rollouts, trust), refused)


def _by_rollouts(subject: Subject, simulator: Simulator, rollouts: Rollouts, trust: bool) -> Plant:
    limit = facts_of(simulator, subject.environment).max_episode_steps
    shorter = make(shortened(subject.environment, rollouts.most_steps, limit), trust)
    try:
        return identify_plant(subject, shorter, rollouts)
    finally:
        shorter.close()


def _words(diagnostic: object) -> str:
    message = str(getattr(diagnostic, "message", ""))
    notes = tuple(getattr(diagnostic, "notes", ()))
    return f"{message}: {notes[0]}" if notes else message


def _with_notes(plant: Plant, notes: list[str]) -> Plant:
    return replace(plant, notes=(*plant.notes, *notes))


def _equations(subject: Subject) -> Equations:
    equations = known_equations(subject.environment)
    if equations is None:
        raise failure(NoEquations(subject.environment.id))
    return equations


def _point(
    subject: Subject, equations: Equations, chosen: str | OperatingPoint | None
) -> OperatingPoint:
    match chosen:
        case None:
            return equations.points[0]
        case OperatingPoint():
            return chosen
        case str():
            point = equations.point(chosen)
            if point is None:
                known = tuple(other.name for other in equations.points)
                raise failure(UnknownOperatingPoint(subject.environment.id, chosen, known))
            return point
        case _:
            assert_never(chosen)


def _by_equations(
    subject: Subject, simulator: Simulator, chosen: str | OperatingPoint | None
) -> Plant:
    equations = _equations(subject)
    point = _point(subject, equations, chosen)
    system = resettable(simulator, subject.environment.id)
    miss = largest_miss(equations, point, system)
    if not miss <= AGREES:
        # Someone else's environment by the same name, or a version that is not known.
        raise failure(NoEquations(subject.environment.id))
    return from_equations(subject, equations, point, sample_time(subject, simulator), miss)


def _most_settled(
    subject: Subject, simulator: Simulator, system: Resettable
) -> tuple[Vector, Vector]:
    """Of some episodes' ends the state and action at which least changes in a step."""
    ends: list[tuple[float, Vector, Vector]] = []
    space = simulator.action_space
    for seed in range(_EPISODES):
        episode = run_episode(simulator, InterpretedPolicy(subject.program), seed)
        state = system.state()
        last = episode.actions[-1] if hasattr(space, "low") else middle_action(space)
        action = np.array(last, np.float64)
        after, _ = system.advance(state, action)
        ends.append((float(np.max(np.abs(after - state))), state, action))
    _, state, action = min(ends, key=lambda end: end[0])
    return state, action


def _by_simulator(
    subject: Subject, simulator: Simulator, chosen: str | OperatingPoint | None
) -> Plant:
    name = subject.environment.id
    system = resettable(simulator, name)
    if isinstance(chosen, str):
        equations = known_equations(subject.environment)
        if equations is None:
            raise failure(UnknownOperatingPoint(name, chosen, ()))
        chosen = _point(subject, equations, chosen)
    if chosen is None:
        state, action = _most_settled(subject, simulator, system)
        chosen = find_rest(system, state, action, name)
    return from_differences(
        subject, differences(system, chosen), chosen, sample_time(subject, simulator)
    )
