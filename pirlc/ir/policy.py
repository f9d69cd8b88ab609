"""Sketches, program templates and programs: three stages of one shape.

::

    Interface       = name, environment?, Sensor*, ActionSpec*, window, sample_time?, latency, fill
    Sketch          = Interface, Parameter*, Rule*, one Term an action, Property*
    ProgramTemplate = Interface, Parameter*,        one Term an action, Property*  (no rules, holes)
    Program         = Interface, FixedParameter*,   one Term an action, Property*  (closed)
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum

from pirlc.ir.terms import Term, size
from pirlc.ir.types import Discrete, Real, Type
from pirlc.source import NOWHERE, Span


def _span() -> Span:
    return field(default=NOWHERE, compare=False, repr=False)


DEFAULT_BOUNDS = (-100.0, 100.0)
"""The range of a hole that gives none."""


class Fill(Enum):
    """What windows hold before they are full."""

    FIRST = "first"
    ZERO = "zero"


@dataclass(frozen=True)
class Hold:
    """A missing reading is replaced by the last good one.

    `limit` (steps) is the number of missing readings in a row that are only held; from the next
    one on every action takes its `safe` value as well. `None`: no limit. `missing fail` is a limit
    of 0.
    """

    limit: int | None = None


@dataclass(frozen=True)
class Zero:
    """A missing reading is replaced by zero."""


MissingPolicy = Hold | Zero


@dataclass(frozen=True)
class Sensor:
    """A named component `index` of the observation vector, with its range [lower, upper]."""

    name: str
    lower: float
    upper: float
    index: int
    missing: MissingPolicy = Hold()
    span: Span = _span()


@dataclass(frozen=True)
class Continuous:
    """A real action, clipped to [lower, upper]. `safe` is None where the file gives none."""

    lower: float
    upper: float
    safe: float | None = None


@dataclass(frozen=True)
class Choice:
    """A discrete action: one of `values`, the environment's own numbers."""

    values: tuple[int, ...]
    safe: int | None = None


@dataclass(frozen=True)
class ActionSpec:
    """A named component of the environment's action."""

    name: str
    domain: Continuous | Choice
    component: int
    span: Span = _span()

    @property
    def type(self) -> Type:
        """Of the action's expression."""
        match self.domain:
            case Continuous():
                return Real()
            case Choice(values):
                return Discrete(values)

    @property
    def safe(self) -> float:
        """The value taken when a reading fails or the result is NaN; `previous` at reset.

        Where the file gives none: zero, or the bound next to it; the first value of a choice.
        """
        match self.domain:
            case Continuous(lower, upper, safe):
                return min(max(0.0, lower), upper) if safe is None else safe
            case Choice(values, safe):
                return float(values[0] if safe is None else safe)


Scalar = str | float | int | bool


@dataclass(frozen=True)
class Environment:
    """A Gymnasium environment: its id and the keyword arguments it is made with."""

    id: str
    arguments: tuple[tuple[str, Scalar], ...] = ()
    span: Span = _span()

    def with_arguments(self, others: tuple[tuple[str, Scalar], ...]) -> Environment:
        """The same with other values for some arguments, and with further ones behind its own."""
        return replace(self, arguments=tuple({**dict(self.arguments), **dict(others)}.items()))


@dataclass(frozen=True)
class Interface:
    """What a policy reads and writes, and when.

    `window` and `latency` are in steps; `sample_time` in seconds, None where the file leaves it to
    the environment.
    """

    name: str
    environment: Environment | None
    sensors: tuple[Sensor, ...]
    actions: tuple[ActionSpec, ...]
    window: int = 1
    sample_time: float | None = None
    latency: int = 0
    fill: Fill = Fill.FIRST

    def sensor(self, name: str) -> Sensor:
        return next(sensor for sensor in self.sensors if sensor.name == name)


@dataclass(frozen=True)
class FreeParameter:
    """A real to find in [lower, upper]; `guess` is where to start, if the user said so."""

    name: str
    lower: float
    upper: float
    guess: float | None = None
    span: Span = _span()


@dataclass(frozen=True)
class FixedParameter:
    name: str
    value: float
    span: Span = _span()


Parameter = FreeParameter | FixedParameter


@dataclass(frozen=True)
class Rule:
    """A rule at one combination of argument and result types.

    `key` is unique in the sketch; `name` is the user's. Arguments are `LocalRef`s in the
    alternatives.
    """

    key: str
    name: str
    parameters: tuple[tuple[str, Type], ...]
    result: Type
    alternatives: tuple[Term, ...]
    span: Span = _span()


@dataclass(frozen=True)
class Property:
    """`property name over steps = body`; `steps` is 1 and `ranged` false without `over`."""

    name: str
    body: Term
    steps: int = 1
    ranged: bool = False
    span: Span = _span()


@dataclass(frozen=True)
class Sketch:
    interface: Interface
    parameters: tuple[Parameter, ...]
    rules: tuple[Rule, ...]
    bodies: tuple[Term, ...]
    properties: tuple[Property, ...] = ()

    def in_environment(self, environment: Environment) -> Sketch:
        """The same sketch for another environment."""
        return replace(self, interface=replace(self.interface, environment=environment))

    def rule(self, key: str) -> Rule:
        return next(rule for rule in self.rules if rule.key == key)


@dataclass(frozen=True)
class ProgramTemplate:
    """No choice is left but real parameters."""

    interface: Interface
    parameters: tuple[Parameter, ...]
    bodies: tuple[Term, ...]
    properties: tuple[Property, ...] = ()

    @property
    def size(self) -> int:
        return sum(size(body) for body in self.bodies)

    @property
    def free(self) -> tuple[FreeParameter, ...]:
        return tuple(p for p in self.parameters if isinstance(p, FreeParameter))

    def close(self, values: dict[str, float]) -> Program:
        """The program with `values` for the free parameters (a KeyError if one is left out)."""
        fixed = tuple(
            FixedParameter(p.name, values[p.name]) if isinstance(p, FreeParameter) else p
            for p in self.parameters
        )
        return Program(self.interface, fixed, self.bodies, self.properties)


@dataclass(frozen=True)
class Program:
    """Closed: every parameter has its value."""

    interface: Interface
    parameters: tuple[FixedParameter, ...]
    bodies: tuple[Term, ...]
    properties: tuple[Property, ...] = ()

    @property
    def size(self) -> int:
        return sum(size(body) for body in self.bodies)

    @property
    def values(self) -> dict[str, float]:
        return {p.name: p.value for p in self.parameters}
