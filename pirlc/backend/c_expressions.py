"""Expressions and statements of a controller as C.

Operands that are infix or chosen by `?:` stand in parentheses, even where C's precedence spares
them: nobody has to know it by heart (MISRA C:2012, rule 12.1). Only chains of one level go without.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import assert_never

from pirlc.backend.names import Identifiers
from pirlc.backend.numbers import PRECISIONS, RealType, shortest
from pirlc.backend.text import (
    AND,
    COMPARE,
    INFIX_LEVELS,
    NEGATION,
    OR,
    PRIMARY,
    SELECT,
    Text,
    indented,
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


def chosen(test: Text, consequent: Text, alternative: Text) -> Text:
    """`test ? consequent : alternative`; a further choice may follow the colon as it is."""
    last = alternative.code if alternative.level == SELECT else alternative.at(NEGATION)
    return Text(f"{test.at(NEGATION)} ? {consequent.at(NEGATION)} : {last}", SELECT)


def joined(operator: str, level: int, left: Text, right: Text) -> Text:
    """`left operator right`; comparisons do not chain."""
    chains = left.level == level != COMPARE
    first = left.code if chains else left.at(NEGATION)
    return Text(f"{first} {operator} {right.at(NEGATION)}", level)


def along_ring(head: str, length: int, steps: int) -> Text:
    """The place `steps` places (fewer than `length`) after `head` in a ring."""
    if steps == 0:
        return Text(head, PRIMARY)
    wraps = length - steps
    return Text(f"({head} < {wraps}u) ? ({head} + {steps}u) : ({head} - {wraps}u)", SELECT)


def next_in_ring(place: str, length: int) -> str:
    """Moves a place in a ring on by one."""
    return f"{place} = ({place} == {length - 1}u) ? 0u : ({place} + 1u);"


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
            return chosen(test, left, right)
        case _:
            assert_never(term)


def _reading(scope: CScope, sensor: str, age: int) -> Text:
    if age == 0:
        return Text(scope.readings[sensor], PRIMARY)
    channel = scope.channels[sensor]
    buffer = f"s->{scope.members[sensor]}"
    place = channel.depth - 1 - age
    if not is_ring(channel):
        return Text(f"{buffer}[{place}]", PRIMARY)
    return Text(
        f"{buffer}[{along_ring(scope.heads[channel.depth], channel.depth, place).code}]", PRIMARY
    )


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
            return joined("&&", AND, x, y)
        case Operator.OR, [x, y]:
            return joined("||", OR, x, y)
        case Operator.IMPLIES, [x, y]:
            return joined("||", OR, Text(f"!{x.at(NEGATION)}", NEGATION), y)
        case Operator.MIN, [x, y]:
            return chosen(joined("<", COMPARE, x, y), x, y)
        case Operator.MAX, [x, y]:
            return chosen(joined(">", COMPARE, x, y), x, y)
        case Operator.CLIP, [x, low, high]:
            rest = chosen(joined(">", COMPARE, x, high), high, x)
            return chosen(joined("<", COMPARE, x, low), low, rest)
        case Operator.SIGN, [x]:
            zero, one, less = (constant(v, scope.real) for v in (0.0, 1.0, -1.0))
            zeros = chosen(joined("==", COMPARE, x, zero), zero, x)
            negatives = chosen(joined("<", COMPARE, x, zero), less, zeros)
            return chosen(joined(">", COMPARE, x, zero), one, negatives)
        case _, [x, y]:
            return joined(operator.value, INFIX_LEVELS[operator], x, y)
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
        start = along_ring(scope.heads[cursor.length], cursor.length, cursor.start)
        lines.append(f"unsigned {name} = {start.code};")
        steps.append(next_in_ring(name, cursor.length))
    return [
        *lines,
        f"for (unsigned {i} = 0u; {i} < {loop.index.count}u; {i}++) {{",
        *indented([*statements(inner, loop.body), *steps]),
        "}",
    ]
