"""A run from reset on which emitted C and program visibly differ.

The C is executed with constants for its inputs, which makes everything in it a constant; the
program is stepped by the interpreter.
"""

from __future__ import annotations

import math
import random

from pirlc.backend.c import CPrinter
from pirlc.backend.numbers import PRECISIONS, RealType
from pirlc.ir.policy import Hold, Program
from pirlc.semantics.interpreter import initial_state, step
from pirlc.semantics.precision import widened
from pirlc.verify.emitted.graph import Graph
from pirlc.verify.emitted.loading import Loaded, defaults, load
from pirlc.verify.emitted.machine import Machine
from pirlc.verify.emitted.memory import Array, Memory
from pirlc.verify.emitted.nodes import Integer, LimitReached, Node, NotUnderstood, Real, Undefined
from pirlc.verify.emitted.relation import INPUT, OUTPUT, STATE, blank
from pirlc.verify.findings import Difference

RUNS, STEPS = 12, 14


def example_of(
    program: Program, header: str, source: str, printer: CPrinter, real: RealType
) -> Difference | None:
    """The first step found at which an action, the status or a sensor's flags differ."""
    graph = Graph(folding=True)
    try:
        loaded = load(header, source, printer, real)
        parameters = defaults(graph, loaded)
        for run in range(RUNS):
            rng = random.Random(run)
            rows = _observations(program, rng, run)
            found = _compared(program, graph, loaded, parameters, printer, real, rows)
            if found is not None:
                return found
    except (NotUnderstood, LimitReached, RecursionError):
        pass
    return None


def _observations(program: Program, rng: random.Random, run: int) -> list[dict[str, float]]:
    """Readings of each step: good ones in the first run, later also missing and strange ones,
    for a while at a time."""
    columns = {}
    for sensor in program.interface.sensors:
        low, high = widened(sensor.lower, sensor.upper)
        low, high = max(low, -1e30), min(high, 1e30)
        strange = [math.inf, -math.inf, low - (high - low), high + 1.0, 1e300]
        limit = sensor.missing.limit if isinstance(sensor.missing, Hold) else None
        longest = 2 + min(limit or 0, STEPS)
        column: list[float] = []
        while len(column) < STEPS:
            if run and rng.random() < 0.3:
                kind = math.nan if rng.random() < 0.5 else rng.choice(strange)
                column += [kind] * rng.randint(1, longest)
            elif rng.random() < 0.2:
                column.append(rng.choice([low, high, (low + high) / 2, 0.0, -0.0]))
            else:
                column.append(low + (high - low) * rng.random())
        columns[sensor.name] = column
    return [{name: column[i] for name, column in columns.items()} for i in range(STEPS)]


def _compared(
    program: Program,
    graph: Graph,
    loaded: Loaded,
    parameters: Memory,
    printer: CPrinter,
    real: RealType,
    rows: list[dict[str, float]],
) -> Difference | None:
    unit, precision = loaded.unit, PRECISIONS[real]
    interface = program.interface
    reset, forward = (unit.functions[f"{loaded.stem}_{name}"] for name in ("reset", "step"))
    machine = Machine(graph, unit, blank(graph, STATE, unit.structs[loaded.struct("state")]))
    machine.run(reset, loaded.objects())
    memory, state = machine.memory, initial_state(program, precision)
    width = max((sensor.index + 1 for sensor in interface.sensors), default=0)
    for number, row in enumerate(rows, 1):
        observation = [0.0] * width
        for sensor in interface.sensors:
            observation[sensor.index] = row[sensor.name]
        result = step(program, state, observation, precision)
        state = result.state
        held: Memory = {key: node for key, node in memory.items() if key[0] == STATE}
        held |= parameters | blank(graph, OUTPUT, unit.structs[loaded.struct("action")])
        for sensor in interface.sensors:
            reading = precision.round(row[sensor.name])
            held[INPUT, printer.inputs[sensor.name]] = graph.real(reading, precision)
        machine = Machine(graph, unit, held)
        told = ", ".join(f"{name} {value!r}" for name, value in row.items())
        when = f"step {number} after reset" + (f" at {told}" if told else "")
        try:
            status = machine.run(forward, loaded.objects())
        except Undefined as reason:
            return Difference(when, f"no meaning: {reason}", "")
        memory = machine.memory
        emitted = {"status": _number(status)}
        expected: dict[str, float] = {"status": result.status}
        for action, value in zip(interface.actions, result.actions, strict=True):
            emitted[f"action {action.name}"] = _number(memory[OUTPUT, printer.actions[action.name]])
            expected[f"action {action.name}"] = value
        for sensor, flags in zip(interface.sensors, result.flags, strict=True):
            emitted[f"flags of {sensor.name}"] = _number(memory[STATE, printer.flags[sensor.name]])
            expected[f"flags of {sensor.name}"] = flags
        for part, value in expected.items():
            if repr(emitted[part]) != repr(value):
                return Difference(f"{part}, {when}", repr(emitted[part]), repr(value))
    return None


def _number(node: Node | Array | None) -> float:
    match node:
        case Real(_, value) | Integer(_, value):
            return value
        case _:
            raise NotUnderstood("a result that is no number")
