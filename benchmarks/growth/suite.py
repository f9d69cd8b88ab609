"""Which stages are measured, for which sizes, and where there is a bar."""

from __future__ import annotations

from benchmarks.growth import workloads as given
from benchmarks.growth.stages import (
    Axis,
    Stage,
    building_objective,
    counting,
    emitting,
    enumerating,
    interpreting,
    joining,
    making,
    neighbours,
    objective,
    scoring,
    searching,
    selecting,
    simulating,
    telling_apart,
    tuning,
)

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
