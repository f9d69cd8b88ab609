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


DECADES = (1_000, 3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000)
WINDOWS = (2, 4, 8, 16, 32, 64)
SENSORS = (1, 2, 4, 8, 16, 32, 64)
GUARDS = (1, 3, 7, 15, 31, 63)
PARAMETERS = (4, 8, 16, 32, 64, 128)
NODES = (15, 30, 60, 120)
LINEAR = 1.1

STAGES = (
    Stage("make histories", Axis.HISTORIES, DECADES, lambda n: making(n, 8, 5), LINEAR),
    Stage("join two halves", Axis.HISTORIES, DECADES, joining, LINEAR),
    Stage("select every other", Axis.HISTORIES, DECADES, lambda n: selecting(n, 5), LINEAR),
    Stage(
        "score a program",
        Axis.HISTORIES,
        DECADES,
        lambda n: scoring(given.every_sensor(8, 5), n),
        LINEAR,
    ),
    Stage(
        "make the smoothed objective",
        Axis.HISTORIES,
        DECADES,
        lambda n: building_objective(given.every_sensor(8, 5), n),
        LINEAR,
    ),
    Stage(
        "smoothed objective and gradient",
        Axis.HISTORIES,
        DECADES,
        lambda n: objective(given.every_sensor(8, 5), n),
        LINEAR,
    ),
    Stage(
        "tune a template",
        Axis.HISTORIES,
        DECADES,
        lambda n: tuning(given.switched_pid(8, 5), n),
        LINEAR,
        long=True,
    ),
    Stage("make histories", Axis.WIDE, (1_000_000,), lambda n: making(n, 8, 64), long=True),
    Stage("select every other", Axis.WIDE, (1_000_000,), lambda n: selecting(n, 64), long=True),
    Stage(
        "score a program",
        Axis.WIDE,
        (1_000_000,),
        lambda n: scoring(given.every_sensor(8, 64), n),
        long=True,
    ),
    Stage(
        "score a program on a selection",
        Axis.WIDE,
        (1_000_000,),
        lambda n: scoring(given.every_sensor(8, 64), n, True),
        long=True,
    ),
    Stage(
        "smoothed objective and gradient",
        Axis.WIDE,
        (1_000_000,),
        lambda n: objective(given.every_sensor(8, 64), n),
        long=True,
    ),
    Stage(
        "tune a template of one law",
        Axis.WIDE,
        (1_000_000,),
        lambda n: tuning(given.one_law(8, 64), n),
        long=True,
    ),
    Stage("make histories (10^5)", Axis.WINDOW, WINDOWS, lambda n: making(100_000, 8, n), LINEAR),
    Stage(
        "score a program (10^5)",
        Axis.WINDOW,
        WINDOWS,
        lambda n: scoring(given.every_sensor(8, n), 100_000),
        LINEAR,
    ),
    Stage(
        "score a program (4,000 selected)",
        Axis.WINDOW,
        WINDOWS,
        lambda n: scoring(given.every_sensor(8, n), 8_000, True),
        LINEAR,
    ),
    Stage(
        "smoothed objective and gradient (4,000)",
        Axis.WINDOW,
        WINDOWS,
        lambda n: objective(given.every_sensor(8, n), 4_000),
        LINEAR,
    ),
    Stage(
        "tune a template (1,000)",
        Axis.WINDOW,
        WINDOWS,
        lambda n: tuning(given.switched_pid(8, n), 1_000),
        LINEAR,
    ),
    Stage(
        "interpret 20 steps",
        Axis.WINDOW,
        WINDOWS,
        lambda n: interpreting(given.every_sensor(8, n)),
        LINEAR,
    ),
    Stage(
        "200 steps of emitted Python",
        Axis.WINDOW,
        WINDOWS,
        lambda n: simulating(given.every_sensor(8, n)),
        LINEAR,
    ),
    Stage("emit C", Axis.WINDOW, WINDOWS, lambda n: emitting(given.every_sensor(8, n)), LINEAR),
    Stage("make histories (10^5)", Axis.SENSORS, SENSORS, lambda n: making(100_000, n, 5)),
    Stage(
        "score a program (10^5)",
        Axis.SENSORS,
        SENSORS,
        lambda n: scoring(given.every_sensor(n, 5), 100_000),
    ),
    Stage(
        "smoothed objective and gradient (4,000)",
        Axis.SENSORS,
        SENSORS,
        lambda n: objective(given.every_sensor(n, 5), 4_000),
    ),
    Stage(
        "tune a template of two sensors (1,000)",
        Axis.SENSORS,
        SENSORS[1:],
        lambda n: tuning(given.switched_pid(n, 5), 1_000),
    ),
    Stage(
        "interpret 20 steps",
        Axis.SENSORS,
        SENSORS,
        lambda n: interpreting(given.every_sensor(n, 5)),
    ),
    Stage(
        "200 steps of emitted Python",
        Axis.SENSORS,
        SENSORS,
        lambda n: simulating(given.every_sensor(n, 5)),
    ),
    Stage(
        "score a program (10^4)", Axis.GUARDS, GUARDS, lambda n: scoring(given.nested(n), 10_000)
    ),
    Stage(
        "make the smoothed objective (1,000)",
        Axis.GUARDS,
        GUARDS,
        lambda n: building_objective(given.nested(n), 1_000),
    ),
    Stage(
        "smoothed objective and gradient (1,000)",
        Axis.GUARDS,
        GUARDS,
        lambda n: objective(given.nested(n), 1_000),
    ),
    Stage(
        "tune a template (1,000)",
        Axis.GUARDS,
        GUARDS[:4],
        lambda n: tuning(given.nested(n), 1_000),
        long=True,
    ),
    Stage(
        "tell a template from others",
        Axis.GUARDS,
        GUARDS,
        lambda n: telling_apart(given.nested(n)),
    ),
    Stage("emit C", Axis.GUARDS, GUARDS, lambda n: emitting(given.nested(n))),
    Stage(
        "smoothed objective and gradient (1,000)",
        Axis.PARAMETERS,
        PARAMETERS,
        lambda n: objective(given.parameters(n), 1_000),
    ),
    Stage(
        "tune a template (1,000)",
        Axis.PARAMETERS,
        PARAMETERS[:5],
        lambda n: tuning(given.parameters(n), 1_000),
        long=True,
    ),
    Stage(
        "tell a template from others",
        Axis.PARAMETERS,
        PARAMETERS,
        lambda n: telling_apart(given.parameters(n)),
    ),
    Stage("a hundred templates of a size", Axis.NODES, NODES, enumerating),
    Stage("count templates up to a size", Axis.NODES, NODES, counting),
    Stage("neighbours of a program", Axis.NODES, NODES, neighbours),
    Stage(
        "Algorithm 1 on CartPole",
        Axis.SAMPLE,
        (500, 1_000, 2_000, 4_000, 8_000, 16_000),
        searching,
        LINEAR,
        long=True,
    ),
)
