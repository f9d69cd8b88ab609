"""The syntax tree: what a file says, names unresolved and types unknown.

Grammar (``grammars/pirl.lark`` has the concrete one; every node has a span)::

    SyntaxTree  = Declaration*, Comment*
    Declaration = Policy | Environment | Sensor | Setting | Fill | Parameter | Action | Rule
                | Property
    Expression  = Number | Name | Hole | Call | Unary | Binary | Conditional | Binding
                | Lambda | OperatorWord          (these two as arguments of a call only)
                | Group                          (parentheses, kept for the formatter)
"""

from __future__ import annotations

from dataclasses import dataclass

from pirlc.ir.operators import Operator
from pirlc.source import Span


@dataclass(frozen=True)
class Comment:
    """`text` starts with ``#``; `own_line` is whether nothing but white space is before it."""

    text: str
    own_line: bool
    span: Span


@dataclass(frozen=True)
class Number:
    """A literal, with its sign; `text` is how it was written."""

    text: str
    span: Span

    @property
    def value(self) -> float:
        return float(self.text)

    @property
    def integer(self) -> int | None:
        """The value, if it was written as a whole number (no point, no exponent)."""
        if not self.text.lstrip("-").isdigit():
            return None
        # Python refuses to read thousands of digits, leading zeros included.
        digits = int(self.text.lstrip("-").lstrip("0") or "0")
        return -digits if self.text.startswith("-") else digits


@dataclass(frozen=True)
class Name:
    text: str
    span: Span


@dataclass(frozen=True)
class Range:
    lower: Number
    upper: Number
    span: Span


@dataclass(frozen=True)
class Hole:
    """`?name` or `?(name in bounds = guess)`."""

    name: Name
    bounds: Range | None
    guess: Number | None
    span: Span


@dataclass(frozen=True)
class Call:
    """A basic operator written as a call, `peek`, `fold`, `diff`, `previous`, `raw`, or a rule."""

    name: Name
    arguments: tuple[Expression, ...]
    span: Span


@dataclass(frozen=True)
class Unary:
    operator: Operator
    operand: Expression
    span: Span


@dataclass(frozen=True)
class Binary:
    operator: Operator
    left: Expression
    right: Expression
    span: Span


@dataclass(frozen=True)
class Conditional:
    condition: Expression
    consequent: Expression
    alternative: Expression
    span: Span


@dataclass(frozen=True)
class Binding:
    """`let name = value in body`."""

    name: Name
    value: Expression
    body: Expression
    span: Span


@dataclass(frozen=True)
class Lambda:
    r"""`\element accumulator -> body`."""

    element: Name
    accumulator: Name
    body: Expression
    span: Span


@dataclass(frozen=True)
class OperatorWord:
    """An infix operator that stands alone, as in `fold(+, x)`."""

    operator: Operator
    span: Span


@dataclass(frozen=True)
class Group:
    inner: Expression
    span: Span


Expression = (
    Number
    | Name
    | Hole
    | Call
    | Unary
    | Binary
    | Conditional
    | Binding
    | Lambda
    | OperatorWord
    | Group
)


@dataclass(frozen=True)
class Text:
    """A quoted text; `value` has its escapes resolved."""

    source: str
    value: str
    span: Span


@dataclass(frozen=True)
class Truth:
    value: bool
    span: Span


@dataclass(frozen=True)
class Policy:
    name: Name
    span: Span


@dataclass(frozen=True)
class Argument:
    """`name = value` in the braces of an environment."""

    name: Name
    value: Text | Number | Truth
    span: Span


@dataclass(frozen=True)
class Environment:
    id: Text
    arguments: tuple[Argument, ...]
    span: Span


@dataclass(frozen=True)
class Missing:
    """`missing word`, or `missing word limit then finally_`."""

    word: Name
    limit: Number | None
    finally_: Name | None
    span: Span


@dataclass(frozen=True)
class Sensor:
    name: Name
    range: Range
    index: Number
    missing: Missing | None
    span: Span


@dataclass(frozen=True)
class Setting:
    """`window`, `sample_time` or `latency` with its number."""

    keyword: str
    value: Number
    span: Span


@dataclass(frozen=True)
class Fill:
    word: Name
    span: Span


@dataclass(frozen=True)
class Parameter:
    """`param name in bounds = number`; without bounds the number is the value, not a guess."""

    name: Name
    bounds: Range | None
    number: Number | None
    span: Span


@dataclass(frozen=True)
class Choice:
    values: tuple[Number, ...]
    span: Span


@dataclass(frozen=True)
class Action:
    """`equals` are the expressions after each `=`: the component's index if it is given, the body.

    The parser accepts any number of `=` and `safe` parts, in any order, so that the compiler can
    say what is wrong with them.
    """

    name: Name
    domain: Range | Choice
    equals: tuple[Expression, ...]
    safe: tuple[Number, ...]
    span: Span


@dataclass(frozen=True)
class Rule:
    name: Name
    formals: tuple[Name, ...]
    alternatives: tuple[Expression, ...]
    span: Span


@dataclass(frozen=True)
class Property:
    name: Name
    over: Number | None
    body: Expression
    span: Span


Declaration = Policy | Environment | Sensor | Setting | Fill | Parameter | Action | Rule | Property


@dataclass(frozen=True)
class SyntaxTree:
    declarations: tuple[Declaration, ...]
    comments: tuple[Comment, ...]


def children(expression: Expression) -> tuple[Expression, ...]:
    """The direct subexpressions, in the order of the text."""
    match expression:
        case Call():
            return expression.arguments
        case Unary():
            return (expression.operand,)
        case Binary():
            return (expression.left, expression.right)
        case Conditional():
            return (expression.condition, expression.consequent, expression.alternative)
        case Binding():
            return (expression.value, expression.body)
        case Lambda():
            return (expression.body,)
        case Group():
            return (expression.inner,)
        case Number() | Name() | Hole() | OperatorWord():
            return ()


def ungrouped(expression: Expression) -> Expression:
    """The expression without the parentheses around it."""
    while isinstance(expression, Group):
        expression = expression.inner
    return expression


def expressions(declaration: Declaration) -> tuple[Expression, ...]:
    """The expressions that a declaration holds."""
    match declaration:
        case Action():
            return declaration.equals
        case Rule():
            return declaration.alternatives
        case Property():
            return (declaration.body,)
        case Policy() | Environment() | Sensor() | Setting() | Fill() | Parameter():
            return ()
