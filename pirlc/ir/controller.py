"""Controllers: what an embedded engineer would draw. Every target is printed from one.

Grammar::

    Controller ::= name, Channel*, (parameter, value)*, Statement*, Output*
    Statement  ::= Define x Expression          (x is assigned once)
                 | Declare x Expression?        (x is assigned again by Set)
                 | Set x Expression
                 | Branch Expression Statement* Statement*
                 | Loop i count Statement*      (i = 0 ... count - 1)
    Expression ::= Constant r | DiscreteConstant k | Parameter p | Local x | Reading s age
                 | Element s i age | Previous A | Operation op Expression*
                 | Select Expression Expression Expression

Expressions are scalars; statements run in order; only the taken side of a `Branch` or `Select` is
evaluated. An operation whose definition mentions an argument twice (`min`, `max`, `clip`, `sign`)
has only leaves for arguments, so that every target may write it out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum
from typing import assert_never

from pirlc.ir.operators import Operator
from pirlc.ir.policy import Choice, Continuous, Fill, Hold, MissingPolicy, Zero


class Kind(Enum):
    """What a local holds."""

    REAL = "real"
    BOOL = "bool"
    DISCRETE = "discrete"


@dataclass(frozen=True, slots=True)
class Local:
    """A named intermediate result; names are unique in a controller."""

    name: str
    kind: Kind


@dataclass(frozen=True, slots=True)
class LoopIndex:
    name: str
    count: int


@dataclass(frozen=True, slots=True)
class Constant:
    """A real, as binary64; a target in binary32 rounds it once."""

    value: float


@dataclass(frozen=True, slots=True)
class DiscreteConstant:
    value: int


@dataclass(frozen=True, slots=True)
class Parameter:
    name: str


@dataclass(frozen=True, slots=True)
class Reading:
    """What a sensor's buffer holds from `age` steps ago; 0 is the newest."""

    sensor: str
    age: int


@dataclass(frozen=True, slots=True)
class Element:
    """What a sensor's buffer holds from `age - i` steps ago, i the value of the loop's index."""

    sensor: str
    index: LoopIndex
    age: int


@dataclass(frozen=True, slots=True)
class Previous:
    """The applied action of the step before."""

    action: str
    kind: Kind


@dataclass(frozen=True, slots=True)
class Operation:
    operator: Operator
    arguments: tuple[Expression, ...]
    height: int = field(default=1, compare=False, repr=False)
    """Of the expression tree; lowering keeps it small, since compilers limit nesting."""


@dataclass(frozen=True, slots=True)
class Select:
    condition: Expression
    consequent: Expression
    alternative: Expression
    height: int = field(default=1, compare=False, repr=False)


Expression = (
    Constant
    | DiscreteConstant
    | Parameter
    | Local
    | Reading
    | Element
    | Previous
    | Operation
    | Select
)


@dataclass(frozen=True, slots=True)
class Define:
    local: Local
    value: Expression


@dataclass(frozen=True, slots=True)
class Declare:
    local: Local
    initial: Expression | None = None


@dataclass(frozen=True, slots=True)
class Set:
    local: Local
    value: Expression


@dataclass(frozen=True, slots=True)
class Branch:
    condition: Expression
    consequent: tuple[Statement, ...]
    alternative: tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class Loop:
    index: LoopIndex
    body: tuple[Statement, ...]


Statement = Define | Declare | Set | Branch | Loop


@dataclass(frozen=True)
class Channel:
    """A sensor as the controller takes it in.

    `index` is the component of the environment's observation; [lower, upper] the declared range
    and [low, high] the same widened outward to binary32, which readings are judged by. `depth` is
    how many of the newest readings, the one just taken included, the program needs (latency
    included; 0: none, the reading is only judged). `initial` (binary64) is what the buffer holds
    at reset.
    """

    name: str
    index: int
    lower: float
    upper: float
    low: float
    high: float
    missing: MissingPolicy
    fill: Fill
    initial: float
    depth: int

    @property
    def limit(self) -> int | None:
        """Missing readings in a row that are held; one more and the actions take `safe`."""
        return self.missing.limit if isinstance(self.missing, Hold) else None

    @property
    def counted(self) -> bool:
        """Whether the state counts missing readings in a row (a limit of 0 needs no count)."""
        return self.limit is not None and self.limit > 0

    @property
    def kept(self) -> int:
        """The number of readings in the state.

        A buffer of one reading is kept only to hold it: what replaces a missing one otherwise is
        a constant.
        """
        return 0 if self.depth == 1 and isinstance(self.missing, Zero) else self.depth

    @property
    def awaits_first(self) -> bool:
        """Whether the state tells if there was a good reading yet.

        Under `hold` a buffer of one reading needs no such note: until the first good reading it
        holds its initial value, which is what it is to hold.
        """
        if self.fill is not Fill.FIRST:
            return False
        return self.depth > 1 or (self.depth == 1 and isinstance(self.missing, Zero))


@dataclass(frozen=True)
class Output:
    """An action: the local with its value before clipping, and what leaves the controller for it.

    No two outputs share a local, and nothing else reads it once the statements have run.
    `keeps_previous`: whether the program reads the applied action of the step before.
    """

    name: str
    component: int
    domain: Continuous | Choice
    safe: float
    raw: Local
    keeps_previous: bool

    @property
    def kind(self) -> Kind:
        return Kind.REAL if isinstance(self.domain, Continuous) else Kind.DISCRETE


@dataclass(frozen=True)
class Controller:
    """`parameters` are exactly the program's, in order, with their values as binary64.

    `observation_size` is the least length of an observation vector that has every sensor.
    """

    name: str
    channels: tuple[Channel, ...]
    parameters: tuple[tuple[str, float], ...]
    statements: tuple[Statement, ...]
    outputs: tuple[Output, ...]

    @property
    def may_fail(self) -> bool:
        """Whether missing readings can send the actions to their safe values."""
        return any(channel.limit is not None for channel in self.channels)

    @property
    def observation_size(self) -> int:
        return max((channel.index + 1 for channel in self.channels), default=0)

    def channel(self, name: str) -> Channel:
        return next(channel for channel in self.channels if channel.name == name)


def is_leaf(expression: Expression) -> bool:
    """Whether it costs no operation to evaluate the expression again."""
    return not isinstance(expression, Operation | Select)


def cost(expression: Expression) -> int:
    """Operations on the worst path: operators and comparisons count 1, a `Select` its test."""
    match expression:
        case Operation(_, arguments):
            return 1 + sum(map(cost, arguments))
        case Select(condition, consequent, alternative):
            return 1 + cost(condition) + max(cost(consequent), cost(alternative))
        case _:
            return 0


def worst_path(statements: tuple[Statement, ...]) -> int:
    """Operations on the worst path through the statements; a branch and a loop's step count 1."""
    total = 0
    for statement in statements:
        match statement:
            case Define(_, value) | Set(_, value):
                total += cost(value)
            case Declare(_, initial):
                total += 0 if initial is None else cost(initial)
            case Branch(condition, consequent, alternative):
                total += 1 + cost(condition) + max(worst_path(consequent), worst_path(alternative))
            case Loop(index, body):
                total += index.count * (1 + worst_path(body))
            case _:
                assert_never(statement)
    return total


def declared(statements: tuple[Statement, ...]) -> list[str]:
    """The names of locals and loop indices, in the order of the statements."""
    names = []
    for statement in statements:
        match statement:
            case Define(local) | Declare(local):
                names.append(local.name)
            case Set():
                pass
            case Branch(_, consequent, alternative):
                names += [*declared(consequent), *declared(alternative)]
            case Loop(index, body):
                names += [index.name, *declared(body)]
            case _:
                assert_never(statement)
    return names


def expressions(statements: tuple[Statement, ...]) -> Iterator[Expression]:
    """Every expression in the statements and below, parents first."""
    for statement in statements:
        match statement:
            case Define(_, value) | Set(_, value):
                yield from subexpressions(value)
            case Declare(_, initial):
                if initial is not None:
                    yield from subexpressions(initial)
            case Branch(condition, consequent, alternative):
                yield from subexpressions(condition)
                yield from expressions(consequent)
                yield from expressions(alternative)
            case Loop(_, body):
                yield from expressions(body)
            case _:
                assert_never(statement)


def subexpressions(expression: Expression) -> Iterator[Expression]:
    yield expression
    match expression:
        case Operation(_, arguments):
            for argument in arguments:
                yield from subexpressions(argument)
        case Select(condition, consequent, alternative):
            for part in (condition, consequent, alternative):
                yield from subexpressions(part)
        case _:
            pass
