"""Program templates as CasADi expressions over N histories at once.

Each input (an element of a window, a previous action) is a row of N numbers, each free parameter a
scalar, so that one call of a CasADi function computes every history. The form serves tuning: it
agrees with the vectorised evaluator to about 1e-9 on finite inputs away from guards, and scores
nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from pirlc.ir.operators import COMPARISONS, Operator
from pirlc.ir.policy import FixedParameter, Program, ProgramTemplate
from pirlc.ir.types import Discrete, Type
from pirlc.semantics.histories import HistorySet
from pirlc.symbolic.walk import Algebra, walk

MX = Any
"""A `casadi.MX`: CasADi has no type stubs."""


@dataclass(frozen=True, slots=True)
class Element:
    """An element of a sensor's window: -1 is the newest."""

    sensor: str
    index: int


@dataclass(frozen=True, slots=True)
class Previous:
    """An action of the step before."""

    action: str


Input = Element | Previous


@dataclass
class Symbols:
    """The symbols of one form, made when they are first met.

    `margins` are the differences a - b behind every comparison of reals and sign, in the order of
    the walk, those without a free parameter left out.
    """

    histories: int
    fixed: Mapping[str, float]
    names: tuple[str, ...]
    theta: MX = None
    inputs: dict[Input, MX] = field(default_factory=dict)
    margins: list[MX] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.theta = ca.MX.sym("theta", len(self.names))
        self._parameters = {name: self.theta[i] for i, name in enumerate(self.names)}

    def input(self, which: Input) -> MX:
        if which not in self.inputs:
            self.inputs[which] = ca.MX.sym(f"input{len(self.inputs)}", 1, self.histories)
        return self.inputs[which]

    def element(self, sensor: str, index: int) -> MX:
        return self.input(Element(sensor, index))

    def used_in(self, expressions: Sequence[MX]) -> dict[Input, MX]:
        """The inputs that some expressions need: a walk meets whole windows, a peek uses one."""
        names = {symbol.name() for symbol in ca.symvar(ca.veccat(ca.MX(0, 1), *expressions))}
        return {which: row for which, row in self.inputs.items() if row.name() in names}

    def parameter(self, name: str) -> MX:
        return ca.MX(self.fixed[name]) if name in self.fixed else self._parameters[name]

    def is_free(self, expression: MX) -> bool:
        return bool(ca.depends_on(expression, self.theta))

    def margin(self, a: MX, b: MX) -> MX:
        """a - b, recorded if a parameter can move it."""
        difference = a - b
        if self.is_free(difference):
            self.margins.append(difference)
        return difference


def symbols_for(template: ProgramTemplate | Program, histories: int) -> Symbols:
    fixed = {p.name: p.value for p in template.parameters if isinstance(p, FixedParameter)}
    free = tuple(p.name for p in template.parameters if not isinstance(p, FixedParameter))
    return Symbols(histories, fixed, free)


ARITHMETIC: dict[Operator, Callable[..., MX]] = {
    Operator.ADD: lambda a, b: a + b,
    Operator.SUBTRACT: lambda a, b: a - b,
    Operator.MULTIPLY: lambda a, b: a * b,
    Operator.DIVIDE: lambda a, b: a / b,
    Operator.NEGATE: lambda a: -a,
    Operator.ABS: lambda a: ca.fabs(a),
    Operator.MIN: lambda a, b: ca.if_else(a < b, a, b),
    Operator.MAX: lambda a, b: ca.if_else(a > b, a, b),
    Operator.CLIP: lambda x, low, high: ca.if_else(x < low, low, ca.if_else(x > high, high, x)),
    Operator.SQRT: lambda a: ca.sqrt(a),
    Operator.EXP: lambda a: ca.exp(a),
    Operator.TANH: lambda a: ca.tanh(a),
}
"""Operators that are the same in the hard form and in the smoothed one."""

COMPARED: dict[Operator, Callable[[MX, MX], MX]] = {
    Operator.LESS: lambda a, b: a < b,
    Operator.LESS_EQUAL: lambda a, b: a <= b,
    Operator.GREATER: lambda a, b: a > b,
    Operator.GREATER_EQUAL: lambda a, b: a >= b,
    Operator.EQUAL: lambda a, b: ca.eq(a, b),
    Operator.NOT_EQUAL: lambda a, b: ca.ne(a, b),
}
"""Comparisons of reals as 0 and 1."""


def hard_algebra(symbols: Symbols) -> Algebra[MX]:
    """The program's own meaning: truth values are 0 and 1, discrete actions their numbers."""

    def compared(operator: Operator) -> Callable[[MX, MX], MX]:
        def comparison(a: MX, b: MX) -> MX:
            symbols.margin(a, b)
            return COMPARED[operator](a, b)

        return comparison

    def sign(x: MX) -> MX:
        symbols.margin(x, ca.MX(0.0))
        return ca.sign(x)

    operators: dict[Operator, Callable[..., MX]] = {
        **ARITHMETIC,
        **{operator: compared(operator) for operator in COMPARISONS},
        Operator.SIGN: sign,
        Operator.NOT: lambda a: ca.logic_not(a),
        Operator.AND: lambda a, b: ca.logic_and(a, b),
        Operator.OR: lambda a, b: ca.logic_or(a, b),
        Operator.IMPLIES: lambda a, b: ca.logic_or(ca.logic_not(a), b),
    }

    def discrete(value: int, type_: Discrete) -> MX:
        del type_
        return ca.MX(float(value))

    def previous(action: str, type_: Type) -> MX:
        del type_
        return symbols.input(Previous(action))

    return Algebra(
        literal=lambda value: ca.MX(value),
        discrete=discrete,
        parameter=symbols.parameter,
        element=symbols.element,
        previous=previous,
        operators=operators,
        choose=lambda condition, yes, no: ca.if_else(condition, yes, no),
    )


def row_of(which: Input, histories: HistorySet) -> NDArray[np.float64]:
    """The numbers (N,) of an input, contiguous, in binary64."""
    match which:
        case Element(sensor, index):
            values = histories.element(sensor, index)
        case Previous(action):
            values = histories.of_histories(histories.previous[action])
    return np.ascontiguousarray(values, dtype=np.float64)


class BoundFunction:
    """A CasADi function called on numpy arrays without copying them.

    `arguments` are kept; writing into them and calling again computes anew. A call returns the
    `results`, which the next call overwrites.
    """

    def __init__(self, function: Any, arguments: Sequence[NDArray[np.float64]]) -> None:
        self.function = function
        self.arguments = list(arguments)
        self.results = [np.zeros(function.size_out(i), order="F") for i in range(function.n_out())]
        self._buffer, self._evaluate = function.buffer()
        self._sizes = [function.numel_in(i) for i in range(function.n_in())]
        self.bind(0, self.arguments)
        for i, result in enumerate(self.results):
            if result.size:
                self._buffer.set_res(i, result.reshape(-1, order="F").data)

    def bind(self, first: int, arguments: Sequence[NDArray[np.float64]]) -> None:
        """Other arrays for the arguments from number `first` on."""
        self.arguments[first : first + len(arguments)] = arguments
        for i, argument in enumerate(arguments, first):
            assert argument.size == self._sizes[i], (i, argument.shape)
            if argument.size:
                self._buffer.set_arg(i, argument.data)

    def __call__(self) -> list[NDArray[np.float64]]:
        self._evaluate()
        return self.results


@dataclass(frozen=True)
class CasadiForm:
    """The raw results and the guards' margins of a template over N histories, as a function.

    `function(theta (P,), *inputs (1, N)) -> (raw (k, N), margins (G, N))`; `names` are the free
    parameters in the order of theta.
    """

    names: tuple[str, ...]
    inputs: tuple[Input, ...]
    function: Any

    def run(
        self, values: Mapping[str, float], histories: HistorySet
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Raw results (N, k) and margins (G, N)."""
        theta = np.array([values[name] for name in self.names], dtype=np.float64)
        rows = [row_of(which, histories) for which in self.inputs]
        raw, margins = BoundFunction(self.function, [theta, *rows])()
        return raw.T, margins


def casadi_form(template: ProgramTemplate | Program, histories: int) -> CasadiForm:
    """The hard form for sets of this many histories."""
    symbols = symbols_for(template, histories)
    algebra = hard_algebra(symbols)
    raw = [as_row(walk(body, algebra), histories) for body in template.bodies]
    margins = [as_row(margin, histories) for margin in symbols.margins]
    inputs = symbols.used_in([*raw, *margins])
    function = ca.Function(
        "raw",
        [symbols.theta, *inputs.values()],
        [ca.vertcat(*raw), ca.vertcat(ca.MX(0, histories), *margins)],
    )
    return CasadiForm(symbols.names, tuple(inputs), function)


def as_row(expression: MX, histories: int) -> MX:
    """A row of N, also where the expression is one number for all."""
    if expression.shape[1] == histories:
        return ca.densify(expression)
    return ca.repmat(ca.densify(expression), 1, histories)
