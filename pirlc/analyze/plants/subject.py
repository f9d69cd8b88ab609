"""What of a program a plant has to do with: its actions and the sensors that they answer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from pirlc.analyze.plants.problems import NoSensorRead, failure
from pirlc.ir.policy import ActionSpec, Environment, Program, Sensor
from pirlc.ir.terms import If, SensorRef, Term, children
from pirlc.simulation.environments import Simulator, facts_of, make


@dataclass(frozen=True)
class Subject:
    """The plant's inputs and outputs: `actions` in the program's order, and the `sensors` that
    they read outside the conditions of their `if`s (all that they read, where there are none
    such)."""

    program: Program
    environment: Environment
    actions: tuple[ActionSpec, ...]
    sensors: tuple[Sensor, ...]

    @property
    def readings(self) -> list[int]:
        """The sensors' places in the observation."""
        return [sensor.index for sensor in self.sensors]

    @property
    def components(self) -> list[int]:
        """The actions' places in the environment's action."""
        return [action.component for action in self.actions]


def subject_of(program: Program, environment: Environment) -> Subject:
    """Raises PirlcError E0936 where no action reads a sensor."""
    everywhere = {name for body in program.bodies for name in _read(body, True)}
    outside = {name for body in program.bodies for name in _read(body, False)}
    interface = program.interface
    chosen = outside or everywhere
    if not chosen:
        raise failure(NoSensorRead(interface.name))
    sensors = tuple(sensor for sensor in interface.sensors if sensor.name in chosen)
    return Subject(program, environment, interface.actions, sensors)


def sensors_of(subject: Subject, body: Term) -> tuple[Sensor, ...]:
    """The sensors that one action's term reads outside conditions."""
    names = set(_read(body, False))
    return tuple(sensor for sensor in subject.sensors if sensor.name in names)


def _read(term: Term, conditions: bool) -> Iterator[str]:
    match term:
        case SensorRef(name):
            yield name
        case If(_, consequent, alternative) if not conditions:
            yield from _read(consequent, conditions)
            yield from _read(alternative, conditions)
        case _:
            for child in children(term):
                yield from _read(child, conditions)


def sample_time(subject: Subject, simulator: Simulator) -> float | None:
    """Seconds a step: the environment's or, where it does not tell, the program's."""
    stated = facts_of(simulator, subject.environment).sample_time
    return subject.program.interface.sample_time if stated is None else stated


def make_simulator(subject: Subject, trust: bool) -> Simulator:
    return make(subject.environment, trust)
