"""What is measured: the stages of a search, each prepared for a size and then worked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from itertools import islice

import numpy as np

from benchmarks.growth import workloads as given
from pirlc.backend.emit import emit
from pirlc.backend.policies import python_policy
from pirlc.frontend import parse_sketch
from pirlc.ir.expansion import Expansion, expand
from pirlc.ir.policy import Environment, ProgramTemplate
from pirlc.search.candidate import Candidate
from pirlc.search.canonical import canonical_form
from pirlc.search.context import Search
from pirlc.search.enumeration import Enumeration
from pirlc.search.imitation import create_histories
from pirlc.search.journal import Budget, Journal
from pirlc.search.ndps import ndps
from pirlc.search.neighbourhood import neighbourhood
from pirlc.search.observation import fingerprint, probes
from pirlc.search.settings import Settings
from pirlc.semantics.histories import histories_of, join
from pirlc.semantics.interpreter import initial_state, step
from pirlc.semantics.vectorised import apply_actions, compile_plan, distance
from pirlc.simulation.workers import ALONE
from pirlc.source import SourceText
from pirlc.symbolic.smooth import SmoothedObjective
from pirlc.tune import TuningProblem
from pirlc.tune.smoothed import tune

Work = Callable[[], object]


class Axis(Enum):
    """What grows."""

    HISTORIES = "histories (8 sensors, window 5)"
    WIDE = "histories (8 sensors, window 64)"
    WINDOW = "window (8 sensors)"
    SENSORS = "sensors (window 5)"
    GUARDS = "nested ifs (8 sensors, window 5)"
    PARAMETERS = "free parameters (8 sensors)"
    NODES = "nodes of a template"
    SAMPLE = "Settings.histories of a whole search"


@dataclass(frozen=True)
class Stage:
    """`prepare(size)` does what is not measured, and returns what is.

    `limit` is the bar on the exponent, where there is one. A stage that is `long` is worked once.
    """

    name: str
    axis: Axis
    sizes: tuple[int, ...]
    prepare: Callable[[int], Work]
    limit: float | None = None
    long: bool = False


# History sets and scores


def making(histories: int, sensors: int, window: int) -> Work:
    interface = given.every_sensor(sensors, window).interface
    trajectories = given.trajectories(histories, sensors)
    return lambda: histories_of(interface, trajectories)


def joining(histories: int) -> Work:
    template = given.every_sensor(8, 5)
    half = given.history_set(template, histories // 2)
    return lambda: join([half, half])


def selecting(histories: int, window: int) -> Work:
    """Every other history."""
    whole = given.history_set(given.switched_pid(8, window), histories)
    chosen = np.arange(0, len(whole), 2)
    return lambda: whole.select(chosen)


def scoring(template: ProgramTemplate, histories: int, selected: bool = False) -> Work:
    """The distance of a template closed with parameters; `selected`: of every other history."""
    given_set = given.history_set(template, histories)
    if selected:
        given_set = given_set.select(np.arange(0, len(given_set), 2))
    labels, values = given.labels_for(given_set), given.values_of(template)
    plan = compile_plan(template, given_set.precision, given_set.layout)

    def work() -> float:
        actions = apply_actions(plan.run(values, given_set), given_set).actions
        return distance(actions, labels, template.interface.actions)

    return work


# Tuning


def building_objective(template: ProgramTemplate, histories: int) -> Work:
    given_set = given.history_set(template, histories)
    labels = given.labels_for(given_set)
    return lambda: SmoothedObjective(template, given_set, labels)


def objective(template: ProgramTemplate, histories: int) -> Work:
    """The smoothed objective with its gradient, once."""
    given_set = given.history_set(template, histories)
    smoothed = SmoothedObjective(template, given_set, given.labels_for(given_set))
    theta = np.array(list(given.values_of(template).values()))
    return lambda: smoothed(theta, 0.3)


def tuning(template: ProgramTemplate, histories: int) -> Work:
    given_set = given.history_set(template, histories)
    problem = TuningProblem(template, given_set, given.labels_for(given_set))
    return lambda: tune(problem, 0)


# A step


def interpreting(template: ProgramTemplate) -> Work:
    program = given.closed(template)
    ((observations, _),) = given.trajectories(20, len(template.interface.sensors))

    def work() -> None:
        state = initial_state(program)
        for observation in observations:
            state = step(program, state, observation).state

    return work


def simulating(template: ProgramTemplate) -> Work:
    """Steps of emitted Python, which a search simulates."""
    policy = python_policy(given.closed(template))
    ((observations, _),) = given.trajectories(200, len(template.interface.sensors))

    def work() -> None:
        policy.reset()
        for observation in observations:
            policy.act(observation)

    return work


# Templates


def emitting(template: ProgramTemplate) -> Work:
    program = given.closed(template)
    return lambda: emit(program, ("c",))


def telling_apart(template: ProgramTemplate) -> Work:
    histories = probes(template.interface)
    return lambda: (canonical_form(template), fingerprint(template, histories, 4))


def of_size(size: int) -> Expansion:
    """A template of about so many nodes with as many `if`s as fit."""
    of = given.laws_and_guards()
    enumeration = Enumeration(of)
    found = next(
        derivation
        for total in range(size, size + 10)
        for derivation in islice(enumeration.derivations(total), 1)
    )
    return expand(of, found)


def enumerating(size: int) -> Work:
    """A hundred templates of exactly this size, expanded, from empty tables."""

    def work() -> None:
        of = given.laws_and_guards()
        for derivations in islice(Enumeration(of).derivations(size), 100):
            expand(of, derivations)

    return work


def counting(size: int) -> Work:
    """How many templates there are up to a size, from empty tables."""

    def work() -> None:
        enumeration = Enumeration(given.laws_and_guards())
        for total in range(size + 1):
            enumeration.count(total)

    return work


def neighbours(size: int) -> Work:
    enumeration = Enumeration(given.laws_and_guards())
    expansion = of_size(size)
    values = given.values_of(expansion.template)
    return lambda: neighbourhood(
        enumeration, expansion, values, growth=14, per_move=12, largest=2 * size
    )


# A search


def searching(histories: int) -> Work:
    """Algorithm 1 on CartPole with 32 episodes of the oracle, eight templates, no refinement."""
    settings = Settings(
        largest=30,
        create_episodes=32,
        update_episodes=2,
        histories=histories,
        pool=8,
        neighbours=5,
        per_move=4,
        iterations=1,
        simulated=3,
        episodes=8,
    )

    def record(stage: str, candidate: Candidate) -> None:
        del stage, candidate

    search = Search(
        parse_sketch(SourceText("cartpole", given.CARTPOLE)),
        Environment("CartPole-v1"),
        settings,
        Journal(None, Budget()),
        ALONE,
        lambda _: None,
        record,
    )
    return lambda: ndps(search, create_histories(search, given.ByHand()), augment=True)
