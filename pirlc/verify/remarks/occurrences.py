"""Which comparison, division or square root of the text an occurrence is.

A walk meets comparisons, divisions and roots in one order (`symbolic.z3_form` counts them so);
this gives the node of each, and where one is reached with floats as the program runs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from pirlc.ir.operators import COMPARISONS, Operator
from pirlc.ir.policy import Program
from pirlc.ir.terms import If, Literal, Term
from pirlc.semantics.interpreter import ARITHMETIC, TRUTH
from pirlc.semantics.precision import BINARY64, Precision
from pirlc.symbolic.walk import Algebra, walk
from pirlc.verify.replay import Trial, run

Value = float | int | bool


@dataclass(frozen=True)
class Occurrences:
    """Nodes in walking order: comparisons and signs; divisions and square roots."""

    guards: tuple[Term, ...]
    partials: tuple[Term, ...]


@dataclass
class _Watch:
    """Records nodes, and which partial operations have no finite result on a path that is taken."""

    guards: list[Term] = field(default_factory=list)
    partials: list[Term] = field(default_factory=list)
    failing: list[bool] = field(default_factory=list)
    path: list[bool] = field(default_factory=list)
    here: Term = field(default_factory=lambda: Literal(0.0))

    def at(self, term: Term) -> None:
        self.here = term

    def enter(self, term: If, condition: Value, taken: bool) -> None:
        del term
        self.path.append(bool(condition) == taken)

    def leave(self) -> None:
        self.path.pop()

    def guard(self) -> None:
        self.guards.append(self.here)

    def partial(self, fails: bool) -> None:
        self.partials.append(self.here)
        self.failing.append(fails and all(self.path))


def occurrences(body: Term) -> Occurrences:
    """The nodes of a body."""
    watch = _Watch()
    walk(body, _algebra({}, {}, {}, watch, BINARY64))
    return Occurrences(tuple(watch.guards), tuple(watch.partials))


def failing(
    program: Program, action: str, trial: Trial, precision: Precision = BINARY64
) -> tuple[bool, ...]:
    """For each division and root of an action's body: does it divide by zero, or take the root of
    a negative number, when the program runs on a trial (in its last step)?"""
    last = run(program, trial, precision)[-1]
    names = [action.name for action in program.interface.actions]
    watch = _Watch()
    parameters = {name: precision.round(value) for name, value in program.values.items()}
    algebra = _algebra(parameters, last.windows, last.previous, watch, precision)
    walk(program.bodies[names.index(action)], algebra)
    return tuple(watch.failing)


def _algebra(
    parameters: Mapping[str, float],
    windows: Mapping[str, tuple[float, ...]],
    previous: Mapping[str, float],
    watch: _Watch,
    precision: Precision,
) -> Algebra[Value]:
    """The interpreter's arithmetic; leaves that are not given are zeros."""

    def rounded(operator: Operator) -> Callable[..., Value]:
        def computed(*values: Value) -> Value:
            match operator:
                case Operator.SIGN:
                    watch.guard()
                case Operator.DIVIDE:
                    watch.partial(values[1] == 0.0)
                case Operator.SQRT:
                    watch.partial(values[0] < 0.0)
                case _:
                    pass
            return precision.round(ARITHMETIC[operator](*values))

        return computed

    def compared(operator: Operator) -> Callable[..., Value]:
        def decided(a: Value, b: Value) -> Value:
            watch.guard()
            return TRUTH[operator](a, b)

        return decided

    return Algebra(
        literal=precision.round,
        discrete=lambda value, _type: value,
        parameter=lambda name: parameters.get(name, 0.0),
        element=lambda sensor, index: windows[sensor][index] if sensor in windows else 0.0,
        previous=lambda action, _type: previous.get(action, 0.0),
        operators={
            **{operator: rounded(operator) for operator in ARITHMETIC},
            **TRUTH,
            **{operator: compared(operator) for operator in COMPARISONS},
        },
        choose=lambda condition, yes, no: yes if condition else no,
        watcher=watch,
    )
