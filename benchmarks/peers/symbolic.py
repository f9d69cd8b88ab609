"""Symbolic regression of the oracle by pyoperon (genetic programming, in C++).

(PySR, the best known, needs Julia.) What is fitted: for a continuous action the oracle's; for
discrete ones -1 for the first value, +1 for the last, 0 between, and the sign decides between first
and last. Data are the oracle's own episodes, then those of the best formula so far with the
oracle's actions (two rounds of DAgger), without which none of them holds a pole up. Of the front of
errors and lengths, the formula with the best return on validation episodes is taken.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.peers.dagger import RUN_OFF, VALIDATION
from benchmarks.peers.linear import short
from benchmarks.peers.simulators import episodes_of, returns_of
from benchmarks.peers.tasks import Array, Task, actions_of, labels
from pirlc.ir.operators import Operator
from pirlc.ir.policy import Program
from pirlc.ir.terms import Apply, If, Literal, Term
from pirlc.oracle.network import NetworkOracle

_TRAINING = 750_000
SYMBOLS = "add,sub,mul,div,abs,constant,variable"


@dataclass(frozen=True)
class Settings:
    rounds: int = 3
    episodes: int = 20
    samples: int = 3_000
    evaluations: int = 40_000
    population: int = 500


@dataclass(frozen=True)
class Formula:
    """`text`: as pyoperon prints it, over X1, X2, ..."""

    program: Program
    text: str
    validation: float


def regress(
    task: Task, oracle: NetworkOracle, longest: int, seed: int, settings: Settings
) -> Formula:
    """The best formula of at most so many of pyoperon's nodes."""
    from pyoperon.sklearn import SymbolicRegressor

    generator = np.random.default_rng([seed, longest])
    policy: Callable[[Array], Array] = oracle.actions
    seen: list[Array] = []
    best: Formula | None = None
    for number in range(settings.rounds):
        first = _TRAINING + (seed * 100 + number) * settings.episodes
        seen.append(
            episodes_of(task.environment, policy, range(first, first + settings.episodes))[0]
        )
        every = np.concatenate([_some(x, settings.samples, generator) for x in seen])
        x = _some(every, settings.samples, generator)
        learner = SymbolicRegressor(
            allowed_symbols=SYMBOLS,
            max_length=longest,
            population_size=settings.population,
            pool_size=settings.population,
            generations=10_000,
            max_evaluations=settings.evaluations,
            objectives=["r2", "length"],
            optimizer_iterations=3,
            n_threads=1,
            random_state=int(generator.integers(2**31)),
        )
        learner.fit(x, _target(task, labels(oracle, x)))
        for text in dict.fromkeys(_front(learner)):
            program = program_of(task, text)
            mean = _mean(task, program, VALIDATION)
            if best is None or mean > best.validation:
                best = Formula(program, text, mean)
        assert best is not None
        policy = actions_of(best.program)
    assert best is not None
    return Formula(best.program, best.text, _mean(task, best.program, RUN_OFF))


def _some(x: Array, most: int, generator: np.random.Generator) -> Array:
    return x[generator.choice(len(x), min(most, len(x)), replace=False)]


def _target(task: Task, wanted: Array) -> Array:
    if not task.discrete:
        return wanted
    first, last = task.values[0], task.values[-1]
    return np.where(wanted == last, 1.0, np.where(wanted == first, -1.0, 0.0))


def _front(learner: Any) -> list[str]:
    return [learner.get_model_string(found["tree"], 6) for found in learner.pareto_front_]


def _mean(task: Task, program: Program, seeds: range) -> float:
    return float(returns_of(task.environment, actions_of(program), seeds).mean())


_BINARY = {
    ast.Add: Operator.ADD,
    ast.Sub: Operator.SUBTRACT,
    ast.Mult: Operator.MULTIPLY,
    ast.Div: Operator.DIVIDE,
}


def program_of(task: Task, text: str) -> Program:
    """The formula as a program. Its outermost `a + (b * x)`, a rescaling, stays where it matters:
    for signs of discrete actions, the positive factor is left out."""
    formula = _term(task, ast.parse(text, mode="eval").body)
    if not task.discrete:
        return task.program(formula)
    last, first = task.choose(task.values[-1]), task.choose(task.values[0])
    return task.program(If(_positive(formula), last, first))


def _positive(formula: Term) -> Term:
    match formula:
        case Apply(Operator.ADD, (Literal(a), Apply(Operator.MULTIPLY, (Literal(b), x)))) if b > 0:
            return Apply(Operator.GREATER, (x, Literal(short(-a / b))))
        case _:
            return Apply(Operator.GREATER, (formula, Literal(0.0)))


def _term(task: Task, node: ast.expr) -> Term:
    match node:
        case ast.Constant(float() | int() as value):
            return Literal(float(value))
        case ast.UnaryOp(ast.USub(), ast.Constant(float() | int() as value)):
            return Literal(-float(value))
        case ast.UnaryOp(ast.USub(), operand):
            return Apply(Operator.NEGATE, (_term(task, operand),))
        case ast.BinOp(left, kind, right):
            return Apply(_BINARY[type(kind)], (_term(task, left), _term(task, right)))
        case ast.Call(ast.Name("abs"), [argument]):
            return Apply(Operator.ABS, (_term(task, argument),))
        case ast.Name(name) if name.startswith("X"):
            return task.reading(int(name[1:]) - 1)
        case _:
            raise ValueError(f"pyoperon wrote {ast.unparse(node)}, which has no reading here")
