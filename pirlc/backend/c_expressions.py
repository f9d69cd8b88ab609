"""Expressions and statements of a controller as C."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import assert_never

from pirlc.backend.names import Identifiers
from pirlc.backend.numbers import PRECISIONS, RealType, shortest
from pirlc.backend.text import (
    AND,
    NEGATION,
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
    Kind,
    Local,
    Loop,
    LoopIndex,
    Operation,
    Parameter,
    Previous,
    Reading,
    Select,
    Set,
    Statement,
    expressions,
)
from pirlc.ir.operators import Operator

SHIFTED = 2
"""Buffers of at most so many readings are shifted along; longer ones are rings.

Shifting two costs one move, and spares every access its index arithmetic.
"""

_MATH_CALLS = {
    Operator.ABS: "fabs",
    Operator.SQRT: "sqrt",
    Operator.EXP: "exp",
    Operator.TANH: "tanh",
}


def is_ring(channel: Channel) -> bool:
    return channel.kept > SHIFTED


@dataclass(frozen=True)
class Cursor:
    """Where a loop over a ring buffer stands: one for each buffer length and starting place."""

    index: LoopIndex
    length: int
    start: int


@dataclass(frozen=True)
class CScope:
    """The identifiers of a step function, and the type that it computes in.

    `readings` maps sensors to the locals that hold what was just taken in, `members` to members of
    the state; `heads` the lengths of ring buffers to the locals that hold where the oldest reading
    is.
    """

    real: RealType
    channels: Mapping[str, Channel]
    parameters: Mapping[str, str]
    readings: Mapping[str, str]
    locals: Mapping[str, str]
    members: Mapping[str, str]
    previous: Mapping[str, str]
    discrete: Mapping[Kind, str]
    heads: Mapping[int, str]
    cursors: Mapping[Cursor, str]
    names: Identifiers


def constant(value: float, real: RealType) -> Text:
    """A real constant of the working type; `HUGE_VAL` is IEEE's infinity."""
    rounded = PRECISIONS[real].round(value)
    suffix = "f" if real == "float" else ""
    if rounded in (float("inf"), float("-inf")):
        return number(("-" if rounded < 0 else "") + "HUGE_VAL" + suffix.upper())
    return number(shortest(value, real) + suffix)


def discrete_constant(value: int, type_: str) -> Text:
    suffix = {"int": "", "long": "L", "long long": "LL"}[type_]
    return number(f"{value}{suffix}")


def expression(scope: CScope, term: Expression) -> Text:
    match term:
        case Constant(value):
            return constant(value, scope.real)
        case DiscreteConstant(value):
            return discrete_constant(value, scope.discrete[Kind.DISCRETE])
        case Parameter(name):
            return Text(f"p->{scope.parameters[name]}", PRIMARY)
        case Local(name):
            return Text(scope.locals[name], PRIMARY)
        case Reading(sensor, age):
            return _reading(scope, sensor, age)
        case Element():
            return _element(scope, term)
        case Previous(action):
            return Text(f"s->{scope.previous[action]}", PRIMARY)
        case Operation(operator, arguments):
            return _operation(scope, operator, [expression(scope, a) for a in arguments])
        case Select(condition, consequent, alternative):
            test, left, right = (expression(scope, t) for t in (condition, consequent, alternative))
            return Text(f"{test.at(OR)} ? {left.at(OR)} : {right.at(SELECT)}", SELECT)
        case _:
            assert_never(term)


def _reading(scope: CScope, sensor: str, age: int) -> Text:
    if age == 0:
        return Text(scope.readings[sensor], PRIMARY)
    channel = scope.channels[sensor]
    buffer = f"s->{scope.members[sensor]}"
    place = channel.depth - 1 - age
    if not is_ring(channel) or place == 0:
        oldest = scope.heads[channel.depth] if is_ring(channel) else f"{place}"
        return Text(f"{buffer}[{oldest}]", PRIMARY)
    head, wraps = scope.heads[channel.depth], channel.depth - place
    index = f"{head} < {wraps}u ? {head} + {place}u : {head} - {wraps}u"
    return Text(f"{buffer}[{index}]", PRIMARY)


def _element(scope: CScope, element: Element) -> Text:
    channel = scope.channels[element.sensor]
    buffer = f"s->{scope.members[element.sensor]}"
    if is_ring(channel):
        return Text(f"{buffer}[{scope.cursors[_cursor(channel, element)]}]", PRIMARY)
    place, index = channel.depth - 1 - element.age, scope.locals[element.index.name]
    return Text(f"{buffer}[{index} + {place}u]" if place else f"{buffer}[{index}]", PRIMARY)


def _cursor(channel: Channel, element: Element) -> Cursor:
    return Cursor(element.index, channel.depth, channel.depth - 1 - element.age)


def _operation(scope: CScope, operator: Operator, arguments: list[Text]) -> Text:
    match operator, arguments:
        case Operator.NEGATE, [x]:
            return negated(x)
        case ((Operator.ABS | Operator.SQRT | Operator.EXP | Operator.TANH), [x]):
            suffix = "f" if scope.real == "float" else ""
            return Text(f"{_MATH_CALLS[operator]}{suffix}({x.code})", PRIMARY)
        case Operator.NOT, [x]:
            return Text(f"!{x.at(NEGATION)}", NEGATION)
        case Operator.AND, [x, y]:
            return Text(f"{x.at(AND)} && {y.at(NOT)}", AND)
        case ((Operator.OR | Operator.IMPLIES), [x, y]):
            left = f"!{x.at(NEGATION)}" if operator is Operator.IMPLIES else x.at(OR)
            # gcc wants `a && b || c` written with parentheses.
            left = f"({left})" if operator is Operator.OR and x.level == AND else left
            return Text(f"{left} || {y.at(NOT)}", OR)
        case Operator.MIN, [x, y]:
            return Text(f"{x.at(NOT)} < {y.at(NOT)} ? {x.code} : {y.code}", SELECT)
        case Operator.MAX, [x, y]:
            return Text(f"{x.at(NOT)} > {y.at(NOT)} ? {x.code} : {y.code}", SELECT)
        case Operator.CLIP, [x, low, high]:
            rest = f"{x.code} > {high.code} ? {high.code} : {x.code}"
            return Text(f"{x.code} < {low.code} ? {low.code} : {rest}", SELECT)
        case Operator.SIGN, [x]:
            zero, one = (constant(v, scope.real).code for v in (0.0, 1.0))
            signs = f"{x.code} > {zero} ? {one} : {x.code} < {zero} ? -{one}"
            return Text(f"{signs} : {x.code} == {zero} ? {zero} : {x.code}", SELECT)
        case _, [x, y]:
            return infix(operator, x, y)
        case _:
            raise AssertionError(f"{operator} with {len(arguments)} arguments")


def c_type(scope: CScope, kind: Kind) -> str:
    return scope.discrete[kind]


def statements(scope: CScope, listed: Iterable[Statement]) -> list[str]:
    """Lines, from no indentation on."""
    lines: list[str] = []
    for statement in listed:
        match statement:
            case Define(local, value):
                type_, name = c_type(scope, local.kind), scope.locals[local.name]
                lines.append(f"const {type_} {name} = {expression(scope, value).code};")
            case Declare(local, initial):
                start = "" if initial is None else f" = {expression(scope, initial).code}"
                type_, name = c_type(scope, local.kind), scope.locals[local.name]
                lines.append(f"{type_} {name}{start};")
            case Set(local, value):
                lines.append(f"{scope.locals[local.name]} = {expression(scope, value).code};")
            case Branch():
                lines += _branch(scope, statement)
            case Loop():
                lines += _loop(scope, statement)
            case _:
                assert_never(statement)
    return lines


def _branch(scope: CScope, branch: Branch) -> list[str]:
    condition = expression(scope, branch.condition)
    if not branch.consequent:
        test = f"!{condition.at(NEGATION)}"
        return [f"if ({test}) {{", *indented(statements(scope, branch.alternative)), "}"]
    lines = [f"if ({condition.code}) {{", *indented(statements(scope, branch.consequent))]
    match branch.alternative:
        case ():
            return [*lines, "}"]
        case (Branch(_, consequent) as further,) if consequent:
            first, *rest = _branch(scope, further)
            return [*lines, f"}} else {first}", *rest]
        case _:
            return [*lines, "} else {", *indented(statements(scope, branch.alternative)), "}"]


def _loop(scope: CScope, loop: Loop) -> list[str]:
    i = scope.locals[loop.index.name]
    cursors = list(
        dict.fromkeys(
            _cursor(scope.channels[e.sensor], e)
            for e in expressions(loop.body)
            if isinstance(e, Element) and e.index == loop.index
            if is_ring(scope.channels[e.sensor])
        )
    )
    named = {cursor: scope.names.fresh("at") for cursor in cursors}
    inner = replace(scope, cursors={**scope.cursors, **named})
    lines, steps = [], []
    for cursor, name in named.items():
        head, wraps = scope.heads[cursor.length], cursor.length - cursor.start
        start = f"{head} < {wraps}u ? {head} + {cursor.start}u : {head} - {wraps}u"
        lines.append(f"unsigned {name} = {start if cursor.start else head};")
        steps.append(f"{name} = {name} == {cursor.length - 1}u ? 0u : {name} + 1u;")
    return [
        *lines,
        f"for (unsigned {i} = 0u; {i} < {loop.index.count}u; {i}++) {{",
        *indented([*statements(inner, loop.body), *steps]),
        "}",
    ]
