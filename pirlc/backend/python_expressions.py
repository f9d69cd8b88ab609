"""Expressions and statements of a controller as Python."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import assert_never

from pirlc.backend.numbers import PRECISIONS, RealType
from pirlc.backend.text import (
    AND,
    COMPARE,
    NOT,
    OR,
    PRIMARY,
    SELECT,
    Text,
    indented,
    infix,
    negated,
    number,
)
from pirlc.ir.controller import (
    Branch,
    Channel,
    Constant,
    Declare,
    Define,
    DiscreteConstant,
    Element,
    Expression,
    Local,
    Loop,
    Operation,
    Parameter,
    Previous,
    Reading,
    Select,
    Set,
    Statement,
)
from pirlc.ir.operators import Operator

UNPACKED = 8
"""Buffers of at most so many readings are unpacked into locals."""

_ROUNDED = (
    Operator.ADD,
    Operator.SUBTRACT,
    Operator.MULTIPLY,
    Operator.DIVIDE,
    Operator.SQRT,
    Operator.EXP,
    Operator.TANH,
)


def is_unpacked(channel: Channel) -> bool:
    return channel.kept <= UNPACKED


@dataclass(frozen=True)
class PythonScope:
    """The identifiers of a step method.

    `readings` maps sensors to the locals that hold them, newest first, where a buffer is unpacked;
    `windows` to the local that holds the whole buffer as a tuple, oldest first.
    """

    real: RealType
    channels: Mapping[str, Channel]
    parameters: Mapping[str, str]
    locals: Mapping[str, str]
    readings: Mapping[str, tuple[str, ...]]
    windows: Mapping[str, str]
    previous: Mapping[str, str]


def constant(value: float, real: RealType) -> Text:
    rounded = PRECISIONS[real].round(value)
    if rounded in (float("inf"), float("-inf")):
        return number("-INFINITY" if rounded < 0 else "INFINITY")
    return number(repr(rounded))


def expression(scope: PythonScope, term: Expression) -> Text:
    match term:
        case Constant(value):
            return constant(value, scope.real)
        case DiscreteConstant(value):
            return number(repr(value))
        case Parameter(name):
            return Text(scope.parameters[name], PRIMARY)
        case Local(name):
            return Text(scope.locals[name], PRIMARY)
        case Reading(sensor, age):
            channel = scope.channels[sensor]
            if age == 0 or is_unpacked(channel):
                return Text(scope.readings[sensor][age], PRIMARY)
            return Text(f"{scope.windows[sensor]}[{channel.depth - 1 - age}]", PRIMARY)
        case Element(sensor, index, age):
            place = scope.channels[sensor].depth - 1 - age
            i = scope.locals[index.name]
            at = f"{i} + {place}" if place else i
            return Text(f"{scope.windows[sensor]}[{at}]", PRIMARY)
        case Previous(action):
            return Text(scope.previous[action], PRIMARY)
        case Operation(operator, arguments):
            printed = _operation(scope, operator, arguments)
            if scope.real == "float" and operator in _ROUNDED:
                return Text(f"_round({printed.code})", PRIMARY)
            return printed
        case Select(condition, consequent, alternative):
            test, left, right = (expression(scope, t) for t in (condition, consequent, alternative))
            return Text(f"{left.at(OR)} if {test.at(OR)} else {right.at(SELECT)}", SELECT)
        case _:
            assert_never(term)


def _operation(scope: PythonScope, operator: Operator, terms: tuple[Expression, ...]) -> Text:
    arguments = [expression(scope, term) for term in terms]
    match operator, arguments:
        case Operator.NEGATE, [x]:
            return negated(x)
        case Operator.ABS, [x]:
            return Text(f"abs({x.code})", PRIMARY)
        case ((Operator.SQRT | Operator.EXP | Operator.TANH), [x]):
            return Text(f"_{operator.value}({x.code})", PRIMARY)
        case Operator.DIVIDE, [x, y]:
            divisor = terms[1]
            if isinstance(divisor, Constant) and PRECISIONS[scope.real].round(divisor.value):
                return infix(operator, x, y)
            return Text(f"_divide({x.code}, {y.code})", PRIMARY)
        case Operator.NOT, [x]:
            return Text(f"not {x.at(NOT)}", NOT)
        case Operator.AND, [x, y]:
            return Text(f"{x.at(AND)} and {y.at(NOT)}", AND)
        case Operator.OR, [x, y]:
            return Text(f"{x.at(OR)} or {y.at(AND)}", OR)
        case Operator.IMPLIES, [x, y]:
            return Text(f"not {x.at(NOT)} or {y.at(AND)}", OR)
        case Operator.MIN, [x, y]:
            return Text(f"{x.code} if {x.code} < {y.code} else {y.code}", SELECT)
        case Operator.MAX, [x, y]:
            return Text(f"{x.code} if {x.code} > {y.code} else {y.code}", SELECT)
        case Operator.CLIP, [x, low, high]:
            rest = f"{high.code} if {x.code} > {high.code} else {x.code}"
            return Text(f"{low.code} if {x.code} < {low.code} else {rest}", SELECT)
        case Operator.SIGN, [x]:
            signs = f"1.0 if {x.code} > 0.0 else -1.0 if {x.code} < 0.0"
            return Text(f"{signs} else 0.0 if {x.code} == 0.0 else {x.code}", SELECT)
        case _, [x, y]:
            return infix(operator, x, y)
        case _:
            raise AssertionError(f"{operator} with {len(arguments)} arguments")


def statements(scope: PythonScope, listed: Iterable[Statement]) -> list[str]:
    """Lines, from no indentation on."""
    lines: list[str] = []
    for statement in listed:
        match statement:
            case Define(local, value) | Set(local, value) | Declare(local, value):
                if value is not None:
                    lines.append(f"{scope.locals[local.name]} = {expression(scope, value).code}")
            case Branch():
                lines += _branch(scope, statement, "if")
            case Loop(index, body):
                head = f"for {scope.locals[index.name]} in range({index.count}):"
                lines += [head, *indented(statements(scope, body))]
            case _:
                assert_never(statement)
    return lines


def _branch(scope: PythonScope, branch: Branch, word: str) -> list[str]:
    condition = expression(scope, branch.condition)
    if not branch.consequent:
        head = f"{word} not {condition.at(COMPARE)}:"
        return [head, *indented(statements(scope, branch.alternative))]
    head = f"{word} {condition.code}:"
    lines = [head, *indented(statements(scope, branch.consequent))]
    match branch.alternative:
        case ():
            return lines
        case (Branch() as further,):
            return [*lines, *_branch(scope, further, "elif")]
        case _:
            return [*lines, "else:", *indented(statements(scope, branch.alternative))]
