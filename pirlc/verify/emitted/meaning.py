"""A program's step on nodes, rule by rule as `semantics.interpreter` has it.

`any_state` is every state that a program can be in (and more): its readings, counts and actions
are variables. What it takes for granted is `invariant`, which holds at reset and after every step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

from pirlc.ir.operators import COMPARISONS, Operator
from pirlc.ir.policy import (
    ActionSpec,
    Choice,
    Continuous,
    Fill,
    Hold,
    Interface,
    Program,
    Sensor,
    Zero,
)
from pirlc.semantics.interpreter import MISSING, OUT_OF_RANGE, SAFE_USED
from pirlc.semantics.precision import Precision, middle, widened
from pirlc.symbolic.walk import Algebra, walk
from pirlc.verify.emitted.graph import Graph
from pirlc.verify.emitted.nodes import Node, is_integer

_LARGEST_COUNT = 2**63


@dataclass(frozen=True)
class SensorNodes:
    """As `interpreter.SensorState`; `started` is a truth value."""

    buffer: tuple[Node, ...]
    last_good: Node
    started: Node
    absent: Node
    flags: Node


@dataclass(frozen=True)
class StateNodes:
    sensors: tuple[SensorNodes, ...]
    previous: tuple[Node, ...]


@dataclass(frozen=True)
class StepNodes:
    state: StateNodes
    actions: tuple[Node, ...]
    status: Node


def limit_of(sensor: Sensor) -> int | None:
    return sensor.missing.limit if isinstance(sensor.missing, Hold) else None


@dataclass(frozen=True)
class Meaning:
    """A program in a precision, with the graph that its nodes are made in."""

    graph: Graph
    program: Program
    precision: Precision

    @property
    def interface(self) -> Interface:
        return self.program.interface

    def real(self, value: float) -> Node:
        """A constant of the program: binary64, rounded once to the precision."""
        return self.graph.real(self.precision.round(value), self.precision)

    def reading(self, sensor: Sensor) -> Node:
        """Any reading, already in the precision."""
        return self.graph.variable(f"reading of {sensor.name}", self.precision)

    def parameter(self, name: str) -> Node:
        return self.graph.variable(name, self.precision)

    def start(self, sensor: Sensor) -> Node:
        """What a sensor's buffer holds at reset."""
        if self.interface.fill is Fill.FIRST:
            return self.real(middle(sensor.lower, sensor.upper))
        return self.real(0.0)

    def safe(self, action: ActionSpec) -> Node:
        if isinstance(action.domain, Choice):
            return self.graph.integer(int(action.safe))
        return self.real(action.safe)

    def initial(self) -> StateNodes:
        graph, interface = self.graph, self.interface
        length = interface.window + interface.latency
        sensors = []
        for sensor in interface.sensors:
            start = self.start(sensor)
            sensors.append(
                SensorNodes((start,) * length, start, graph.false, graph.false, graph.false)
            )
        return StateNodes(tuple(sensors), tuple(map(self.safe, interface.actions)))

    def any_state(self) -> StateNodes:
        return StateNodes(
            tuple(map(self._any_sensor, self.interface.sensors)),
            tuple(
                self.graph.variable(
                    f"previous {action.name}",
                    self.precision if isinstance(action.domain, Continuous) else None,
                )
                for action in self.interface.actions
            ),
        )

    def _any_sensor(self, sensor: Sensor) -> SensorNodes:
        graph, name = self.graph, sensor.name
        # Atoms of one sensor stand together: the diagrams of many sensors are then a chain.
        graph.is_finite(self.reading(sensor))
        started, start = graph.free(f"{name} had a good reading"), self.start(sensor)
        count = self.interface.window + self.interface.latency
        held = [
            graph.variable(f"{name} {count - 1 - i} steps before", self.precision)
            for i in range(count)
        ]
        if self.interface.fill is Fill.FIRST:
            held = [graph.choose(started, value, start) for value in held]
        holds = isinstance(sensor.missing, Hold)
        last = held[-1] if holds else graph.variable(f"last good {name}", self.precision)
        limit = limit_of(sensor)
        absent = graph.false
        if limit is not None:
            past = graph.free(f"more than {limit} readings of {name} missing")
            if limit:
                at = graph.free(f"{limit} readings of {name} missing")
                fewer = graph.counter(f"readings of {name} missing", 0, limit - 1)
                absent = graph.choose(at, graph.integer(limit), fewer)
            absent = graph.choose(past, graph.integer(limit + 1), absent)
        flags = graph.variable(f"flags of {name}", None)
        return SensorNodes(tuple(held), last, started, absent, flags)

    def invariant(self, state: StateNodes) -> list[str]:
        """What `any_state` takes for granted and this state is not shown to have."""
        graph, lacks = self.graph, []
        for sensor, nodes in zip(self.interface.sensors, state.sensors, strict=True):
            start, limit = self.start(sensor), limit_of(sensor)
            if self.interface.fill is Fill.FIRST and any(
                graph.choose(nodes.started, value, start) is not value for value in nodes.buffer
            ):
                lacks.append(f"before its first good reading, {sensor.name} stands in the middle")
            if isinstance(sensor.missing, Hold) and nodes.last_good is not nodes.buffer[-1]:
                lacks.append(f"the last good {sensor.name} is the newest held")
            most = graph.integer(0 if limit is None else limit + 1)
            if graph.at_most(nodes.absent, most) is not graph.true:
                lacks.append(f"the count of missing readings of {sensor.name} has a limit")
        return lacks

    def step(self, state: StateNodes, readings: Mapping[str, Node]) -> StepNodes:
        graph, interface = self.graph, self.interface
        sensors = tuple(
            self.take_in(sensor, before, readings[sensor.name])
            for sensor, before in zip(interface.sensors, state.sensors, strict=True)
        )
        status, failed = graph.false, graph.false
        for sensor, after in zip(interface.sensors, sensors, strict=True):
            status = graph.bits_of_either(status, after.flags)
            limit = limit_of(sensor)
            if limit is not None:
                past = graph.negation(graph.at_most(after.absent, graph.integer(limit)))
                failed = graph.either(failed, past)
        windows = {
            sensor.name: after.buffer[: interface.window]
            for sensor, after in zip(interface.sensors, sensors, strict=True)
        }
        previous = {
            action.name: value
            for action, value in zip(interface.actions, state.previous, strict=True)
        }
        algebra = self._algebra(windows, previous)
        actions, unsafe = [], failed
        for action, body in zip(interface.actions, self.program.bodies, strict=True):
            raw = walk(body, algebra)
            is_lost = graph.false if is_integer(raw) else graph.is_nan(raw)
            use_safe = graph.either(failed, is_lost)
            actions.append(graph.choose(use_safe, self.safe(action), self.applied(action, raw)))
            unsafe = graph.either(unsafe, use_safe)
        with_safe = graph.bits_of_either(status, graph.integer(SAFE_USED))
        return StepNodes(
            StateNodes(sensors, tuple(actions)),
            tuple(actions),
            graph.choose(unsafe, with_safe, status),
        )

    def take_in(self, sensor: Sensor, before: SensorNodes, reading: Node) -> SensorNodes:
        """The sensor's state after one more reading."""
        graph, choose = self.graph, self.graph.choose
        good = graph.is_finite(reading)
        match sensor.missing:
            case Hold():
                stand_in = before.last_good
            case Zero():
                stand_in = self.real(0.0)
        held = (*before.buffer[1:], stand_in)
        pushed = (*before.buffer[1:], reading)
        if self.interface.fill is Fill.FIRST:
            held = tuple(
                choose(before.started, new, old)
                for new, old in zip(held, before.buffer, strict=True)
            )
            pushed = tuple(choose(before.started, new, reading) for new in pushed)
        limit = limit_of(sensor)
        absent = graph.false
        if limit is not None:
            more = graph.sum(before.absent, graph.true, 1, 0, _LARGEST_COUNT)
            most = graph.integer(limit + 1)
            absent = choose(graph.at_most(more, most), more, most)
        low, high = (self.real(bound) for bound in widened(sensor.lower, sensor.upper))
        in_range = graph.both(
            graph.compared(Operator.LESS_EQUAL, low, reading),
            graph.compared(Operator.LESS_EQUAL, reading, high),
        )
        outside = choose(in_range, graph.false, graph.integer(OUT_OF_RANGE))
        return SensorNodes(
            buffer=tuple(choose(good, new, old) for new, old in zip(pushed, held, strict=True)),
            last_good=choose(good, reading, before.last_good),
            started=graph.either(good, before.started),
            absent=choose(good, graph.false, absent),
            flags=choose(good, outside, graph.integer(MISSING)),
        )

    def applied(self, action: ActionSpec, raw: Node) -> Node:
        """What leaves the controller for a result that is not NaN."""
        match action.domain:
            case Continuous(lower, upper):
                return self._clip(raw, self.real(lower), self.real(upper))
            case Choice():
                return raw

    def _algebra(
        self, windows: Mapping[str, tuple[Node, ...]], previous: Mapping[str, Node]
    ) -> Algebra[Node]:
        graph = self.graph
        arithmetic: dict[Operator, Callable[..., Node]] = {
            operator: partial(graph.operation, operator, self.precision)
            for operator in (
                Operator.ADD,
                Operator.SUBTRACT,
                Operator.MULTIPLY,
                Operator.DIVIDE,
                Operator.NEGATE,
                Operator.ABS,
                Operator.SQRT,
                Operator.EXP,
                Operator.TANH,
            )
        }
        return Algebra(
            literal=self.real,
            discrete=lambda value, _: graph.integer(value),
            parameter=self.parameter,
            element=lambda sensor, index: windows[sensor][index],
            previous=lambda action, _: previous[action],
            operators={
                **arithmetic,
                **{operator: partial(self._compared, operator) for operator in COMPARISONS},
                Operator.NOT: graph.negation,
                Operator.AND: graph.both,
                Operator.OR: graph.either,
                Operator.IMPLIES: lambda a, b: graph.either(graph.negation(a), b),
                Operator.MIN: lambda a, b: graph.choose(self._less(a, b), a, b),
                Operator.MAX: lambda a, b: graph.choose(self._less(b, a), a, b),
                Operator.CLIP: self._clip,
                Operator.SIGN: self._sign,
            },
            choose=graph.choose,
        )

    def _less(self, a: Node, b: Node) -> Node:
        return self.graph.compared(Operator.LESS, a, b)

    def _compared(self, operator: Operator, a: Node, b: Node) -> Node:
        if not is_integer(a):
            return self.graph.compared(operator, a, b)
        same = self.graph.same(a, b)  # discrete actions know no order
        return same if operator is Operator.EQUAL else self.graph.negation(same)

    def _clip(self, x: Node, low: Node, high: Node) -> Node:
        choose, above = self.graph.choose, self._less(high, x)
        return choose(self._less(x, low), low, choose(above, high, x))

    def _sign(self, x: Node) -> Node:
        choose, zero = self.graph.choose, self.real(0.0)
        equal = self.graph.compared(Operator.EQUAL, x, zero)
        # What is neither above, below nor equal to zero is NaN, as is then the result: x itself.
        rest = choose(self._less(x, zero), self.real(-1.0), choose(equal, zero, x))
        return choose(self._less(zero, x), self.real(1.0), rest)
