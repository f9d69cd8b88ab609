"""The environments of the comparison: the examples' sensors and properties, pirlc's oracles."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from pirlc.frontend import parse_sketch
from pirlc.ir.expansion import close
from pirlc.ir.operators import Operator
from pirlc.ir.policy import Choice, Continuous, Environment, Interface, Program, Property
from pirlc.ir.printer import program_text
from pirlc.ir.terms import (
    ActionRef,
    Apply,
    DiscreteLiteral,
    If,
    Literal,
    Peek,
    SensorRef,
    Term,
    transform,
)
from pirlc.ir.types import Discrete
from pirlc.oracle.manifest import Json
from pirlc.oracle.network import NetworkOracle
from pirlc.oracle.settings import default_algorithm
from pirlc.oracle.store import StoredOracle, default_cache
from pirlc.oracle.train import plan, train_or_load
from pirlc.simulation.environments import DiscreteActions, facts
from pirlc.source import SourceText

Array = NDArray[np.float64]

EXAMPLES = {
    "CartPole-v0": "cartpole",
    "CartPole-v1": "cartpole",
    "MountainCar-v0": "mountain_car",
    "Acrobot-v1": "acrobot",
    "Pendulum-v1": "pendulum",
}
_FOLDER = Path(__file__).parents[2] / "examples"


@dataclass(frozen=True)
class Task:
    """`interface`: the example's, with a window of one reading and all of the environment's
    actions. `properties`: what its sketch asks to be proved."""

    environment: str
    interface: Interface
    properties: tuple[Property, ...]

    @property
    def discrete(self) -> bool:
        return isinstance(self.interface.actions[0].domain, Choice)

    @property
    def values(self) -> tuple[int, ...]:
        """The discrete actions."""
        domain = self.interface.actions[0].domain
        assert isinstance(domain, Choice)
        return domain.values

    @property
    def bounds(self) -> tuple[float, float]:
        """Of the continuous action."""
        domain = self.interface.actions[0].domain
        assert isinstance(domain, Continuous)
        return domain.lower, domain.upper

    @property
    def scales(self) -> Array:
        """The largest reading of each sensor, shape (d,)."""
        return np.array([max(abs(s.lower), abs(s.upper)) for s in self.interface.sensors])

    def reading(self, index: int) -> Term:
        """The newest reading of a component of the observation."""
        return Peek(SensorRef(self.interface.sensors[index].name, 1), -1)

    def choose(self, value: int) -> Term:
        return DiscreteLiteral(value, Discrete(self.values))

    def program(self, body: Term) -> Program:
        """Closed: what the body says, as the text of a .pirl file that reads back the same."""
        made = Program(self.interface, (), (body,), self.properties)
        read = close(parse_sketch(SourceText("peer.pirl", program_text(made))))
        assert read == made
        return made


@lru_cache(maxsize=16)
def task(environment: str) -> Task:
    name = EXAMPLES[environment]
    text = (_FOLDER / name / f"{name}.pirl").read_text(encoding="utf-8")
    sketch = parse_sketch(SourceText(f"{name}.pirl", text))
    known = facts(Environment(environment))
    interface = replace(sketch.interface, environment=Environment(environment), window=1)
    properties = sketch.properties
    # Sensors in the order of the observation's components, each read once.
    assert [s.index for s in interface.sensors] == list(range(known.observation_size))
    if isinstance(known.actions, DiscreteActions):
        values = known.actions.values
        whole = replace(interface.actions[0], domain=Choice(values))
        interface = replace(interface, actions=(whole,))
        properties = tuple(
            replace(p, body=transform(p.body, lambda t: _of_all(t, values))) for p in properties
        )
    properties = tuple(replace(p, body=transform(p.body, _newest)) for p in properties)
    return Task(environment, interface, properties)


def _of_all(term: Term, values: tuple[int, ...]) -> Term:
    """A sketch may leave values out; the tree's action has them all."""
    match term:
        case DiscreteLiteral():
            return replace(term, type=Discrete(values))
        case ActionRef(_, _, Discrete()):
            return replace(term, type=Discrete(values))
        case _:
            return term


def _newest(term: Term) -> Term:
    return replace(term, length=1) if isinstance(term, SensorRef) else term


SETTINGS: Mapping[tuple[str, str], Mapping[str, Json]] = {
    # The general row of duel-ddqn ends at -362 there.
    ("Acrobot-v1", "duel-ddqn"): {
        "steps": 60_000,
        "scale": False,
        "episodes": 30,
        "evaluate_every": 5_000,
        "acceptable": -90,
        "learning_rate": 0.0006,
        "batch_size": 128,
        "exploration_fraction": 0.12,
        "exploration_final_eps": 0.1,
        "target_update_interval": 250,
        "hold": 4.0,
        "n_steps": 1,
    }
}
"""Of trainings that pirlc has no good settings for."""


RATED = ("dqn", "duel-ddqn")
"""Algorithms whose networks are Q values."""


def algorithm_of(environment: str) -> str:
    """That of pirlc's own oracle."""
    return default_algorithm(facts(Environment(environment)))


def oracle(environment: str, seed: int, algorithm: str | None = None) -> StoredOracle:
    """What `pirlc oracle train` gives for the example's sketch, trained if it is not cached."""
    where = Environment(environment)
    known = facts(where)
    name = algorithm or default_algorithm(known)
    chosen = SETTINGS.get((environment, name), {})
    return train_or_load(
        plan(where, known, algorithm=name, seed=seed, overrides=chosen), default_cache()
    )


def labels(of: NetworkOracle, observations: Array) -> Array:
    """The oracle's actions (N,)."""
    return of.actions(observations)[:, 0]


# Programs without memory, over many observations at once.

_NUMERIC: dict[Operator, Callable[..., Array]] = {
    Operator.ADD: np.add,
    Operator.SUBTRACT: np.subtract,
    Operator.MULTIPLY: np.multiply,
    Operator.DIVIDE: np.divide,
    Operator.NEGATE: np.negative,
    Operator.ABS: np.abs,
    Operator.GREATER: np.greater,
    Operator.GREATER_EQUAL: np.greater_equal,
    Operator.LESS: np.less,
    Operator.LESS_EQUAL: np.less_equal,
}


def actions_of(program: Program) -> Callable[[Array], Array]:
    """What a program over newest readings does, as pirlc's own evaluators say: (N, 1) for (N, d).

    Of the language, only what peers are made of.
    """
    index = {sensor.name: sensor.index for sensor in program.interface.sensors}
    action = program.interface.actions[0]

    def value(term: Term, x: Array) -> Array:
        match term:
            case Literal(number):
                return np.full(len(x), number)
            case DiscreteLiteral(number):
                return np.full(len(x), float(number))
            case Peek(SensorRef(name, 1), -1):
                return x[:, index[name]]
            case Apply(operator, arguments):
                return _NUMERIC[operator](*(value(a, x) for a in arguments))
            case If(condition, yes, no):
                return _branched(value(condition, x).astype(bool), yes, no, x)
            case _:
                raise ValueError(f"{type(term).__name__} is not of a peer's program")

    def _branched(holds: NDArray[np.bool_], yes: Term, no: Term, x: Array) -> Array:
        result = np.empty(len(x))
        result[holds] = value(yes, x[holds])
        result[~holds] = value(no, x[~holds])
        return result

    def actions(x: Array) -> Array:
        with np.errstate(all="ignore"):
            raw = value(program.bodies[0], x)
        match action.domain:
            case Choice():
                return raw[:, np.newaxis]
            case Continuous(lower, upper):
                applied = np.where(raw < lower, lower, np.where(raw > upper, upper, raw))
                return np.where(np.isnan(raw), action.safe, applied)[:, np.newaxis]
            case _ as never:
                assert_never(never)

    return actions
