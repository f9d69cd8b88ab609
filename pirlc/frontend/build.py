"""From lark's parse tree to the syntax tree: one method for each rule of the grammar.

Not recursive, whatever the depth of the tree, so that the depth can be judged afterwards.
"""

from __future__ import annotations

import json
from typing import Any

from lark import Token, Transformer_NonRecursive, Tree, v_args
from lark.tree import Meta

from pirlc.frontend import syntax
from pirlc.ir.operators import Operator
from pirlc.source import Span


def build(
    tree: Tree[Token],
) -> tuple[tuple[syntax.Declaration, ...], tuple[syntax.Number, ...]]:
    """The declarations of a parsed file, and all its numbers."""
    builder = _Builder()
    declarations: tuple[syntax.Declaration, ...] = builder.transform(tree)
    return declarations, tuple(builder.numbers)


def _span(place: Meta | Token) -> Span:
    if isinstance(place, Token):
        return Span(place.start_pos or 0, place.end_pos or 0)
    return Span(place.start_pos, place.end_pos)


def _name(token: Token) -> syntax.Name:
    return syntax.Name(str(token), _span(token))


def _text(token: Token) -> syntax.Text:
    try:
        value = json.loads(str(token))
    except ValueError:
        # Escapes that JSON does not know stand for themselves, as in many languages.
        value = str(token)[1:-1]
    return syntax.Text(str(token), value, _span(token))


def _names(children: list[Any]) -> list[syntax.Name]:
    return [_name(child) for child in children if isinstance(child, Token) and child.type == "NAME"]


def _only(children: list[Any], kind: type) -> Any:
    return next((child for child in children if isinstance(child, kind)), None)


@v_args(meta=True)
class _Builder(Transformer_NonRecursive[Token, Any]):
    def __init__(self) -> None:
        super().__init__()
        self.numbers: list[syntax.Number] = []

    def start(self, _meta: Meta, children: list[Any]) -> tuple[syntax.Declaration, ...]:
        return tuple(children)

    # Declarations.

    def policy(self, meta: Meta, children: list[Any]) -> syntax.Policy:
        return syntax.Policy(_name(children[0]), _span(meta))

    def environment(self, meta: Meta, children: list[Any]) -> syntax.Environment:
        arguments = tuple(c for c in children if isinstance(c, syntax.Argument))
        return syntax.Environment(_text(children[0]), arguments, _span(meta))

    def setting(self, meta: Meta, children: list[Any]) -> syntax.Argument:
        name, value = children
        if isinstance(value, Token):
            value = (
                _text(value)
                if value.type == "STRING"
                else syntax.Truth(value.type == "TRUE", _span(value))
            )
        return syntax.Argument(_name(name), value, _span(meta))

    def sensor(self, meta: Meta, children: list[Any]) -> syntax.Sensor:
        name, range_, index = children[:3]
        missing = children[3] if len(children) > 3 else None
        return syntax.Sensor(_name(name), range_, index, missing, _span(meta))

    def missing(self, meta: Meta, children: list[Any]) -> syntax.Missing:
        names = _names(children)
        limit = _only(children, syntax.Number)
        return syntax.Missing(names[0], limit, names[1] if len(names) > 1 else None, _span(meta))

    def window(self, meta: Meta, children: list[Any]) -> syntax.Setting:
        return syntax.Setting("window", children[0], _span(meta))

    def sample_time(self, meta: Meta, children: list[Any]) -> syntax.Setting:
        return syntax.Setting("sample_time", children[0], _span(meta))

    def latency(self, meta: Meta, children: list[Any]) -> syntax.Setting:
        return syntax.Setting("latency", children[0], _span(meta))

    def fill(self, meta: Meta, children: list[Any]) -> syntax.Fill:
        return syntax.Fill(_name(children[0]), _span(meta))

    def free_parameter(self, meta: Meta, children: list[Any]) -> syntax.Parameter:
        bounds, guess = _only(children, syntax.Range), _only(children, syntax.Number)
        return syntax.Parameter(_name(children[0]), bounds, guess, _span(meta))

    def fixed_parameter(self, meta: Meta, children: list[Any]) -> syntax.Parameter:
        return syntax.Parameter(_name(children[0]), None, children[1], _span(meta))

    def action(self, meta: Meta, children: list[Any]) -> syntax.Action:
        name, domain, *clauses = children
        equals = tuple(value for kind, value in clauses if kind == "equals")
        safe = tuple(value for kind, value in clauses if kind == "safe")
        return syntax.Action(_name(name), domain, equals, safe, _span(meta))

    def equals(self, _meta: Meta, children: list[Any]) -> tuple[str, syntax.Expression]:
        return "equals", children[0]

    def safe(self, _meta: Meta, children: list[Any]) -> tuple[str, syntax.Number]:
        return "safe", children[0]

    def rule(self, meta: Meta, children: list[Any]) -> syntax.Rule:
        formals = children[1] if isinstance(children[1], tuple) else ()
        alternatives = children[2:] if isinstance(children[1], tuple) else children[1:]
        return syntax.Rule(_name(children[0]), formals, tuple(alternatives), _span(meta))

    def formals(self, _meta: Meta, children: list[Any]) -> tuple[syntax.Name, ...]:
        return tuple(map(_name, children))

    def property(self, meta: Meta, children: list[Any]) -> syntax.Property:
        over = children[1] if len(children) == 3 else None
        return syntax.Property(_name(children[0]), over, children[-1], _span(meta))

    def range(self, meta: Meta, children: list[Any]) -> syntax.Range:
        return syntax.Range(children[0], children[1], _span(meta))

    def choice(self, meta: Meta, children: list[Any]) -> syntax.Choice:
        return syntax.Choice(tuple(children), _span(meta))

    def number(self, meta: Meta, children: list[Any]) -> syntax.Number:
        number = syntax.Number("".join(map(str, children)), _span(meta))
        self.numbers.append(number)
        return number

    # Expressions.

    literal = number

    def name(self, _meta: Meta, children: list[Any]) -> syntax.Name:
        return _name(children[0])

    def call(self, meta: Meta, children: list[Any]) -> syntax.Call:
        return syntax.Call(_name(children[0]), tuple(children[1:]), _span(meta))

    def hole(self, meta: Meta, children: list[Any]) -> syntax.Hole:
        bounds, guess = _only(children, syntax.Range), _only(children, syntax.Number)
        return syntax.Hole(_name(children[0]), bounds, guess, _span(meta))

    def group(self, meta: Meta, children: list[Any]) -> syntax.Group:
        return syntax.Group(children[0], _span(meta))

    def unary(self, meta: Meta, children: list[Any]) -> syntax.Expression:
        token, operand = children
        if token.type == "NOT":
            return syntax.Unary(Operator.NOT, operand, _span(meta))
        if isinstance(operand, syntax.Number) and not operand.text.startswith("-"):
            return syntax.Number("-" + operand.text, _span(meta))
        return syntax.Unary(Operator.NEGATE, operand, _span(meta))

    def binary(self, meta: Meta, children: list[Any]) -> syntax.Binary:
        left, token, right = children
        return syntax.Binary(Operator(str(token)), left, right, _span(meta))

    def conditional(self, meta: Meta, children: list[Any]) -> syntax.Conditional:
        condition, _, consequent, _, alternative = children
        return syntax.Conditional(condition, consequent, alternative, _span(meta))

    def binding(self, meta: Meta, children: list[Any]) -> syntax.Binding:
        name, value, _, body = children
        return syntax.Binding(_name(name), value, body, _span(meta))

    def lambda_(self, meta: Meta, children: list[Any]) -> syntax.Lambda:
        element, accumulator, _, body = children
        return syntax.Lambda(_name(element), _name(accumulator), body, _span(meta))

    def operator(self, _meta: Meta, children: list[Any]) -> syntax.OperatorWord:
        return syntax.OperatorWord(Operator(str(children[0])), _span(children[0]))
