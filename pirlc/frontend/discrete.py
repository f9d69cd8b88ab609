"""Whole numbers bound by `let`: are they reals or values of a discrete action?

A number is a real unless a discrete action's value is asked for, and a `let` does not ask. So the
uses of the name are looked at: as the result of the body, where that must be discrete, or in a
comparison with something discrete.
"""

from __future__ import annotations

from collections.abc import Callable

from pirlc.frontend import syntax
from pirlc.frontend.syntax import Expression
from pirlc.ir.operators import Operator
from pirlc.ir.types import Discrete, Type


def undecided(expression: Expression) -> bool:
    """Whether an expression is nothing but whole numbers, so that its uses decide its type."""
    match expression:
        case syntax.Number():
            return expression.integer is not None
        case syntax.Group(inner=inner) | syntax.Binding(body=inner):
            return undecided(inner)
        case syntax.Conditional(consequent=consequent, alternative=alternative):
            return undecided(consequent) and undecided(alternative)
        case _:
            return False


def discrete_use(
    name: str,
    body: Expression,
    expected: Type | None,
    guess: Callable[[Expression], Type | None],
) -> Discrete | None:
    """The discrete type that `body`, of type `expected`, has for `name` in it, if any."""
    match body:
        case syntax.Name(text=text):
            return expected if text == name and isinstance(expected, Discrete) else None
        case syntax.Group(inner=inner):
            return discrete_use(name, inner, expected, guess)
        case syntax.Conditional(condition=condition, consequent=then, alternative=otherwise):
            parts = [(condition, None), (then, expected), (otherwise, expected)]
        case syntax.Binding(name=bound, value=value, body=inner):
            inside = [] if bound.text == name else [(inner, expected)]
            parts = [(value, None), *inside]
        case syntax.Binary(operator=Operator.EQUAL | Operator.NOT_EQUAL, left=left, right=right):
            parts = [(left, guess(right)), (right, guess(left))]
        case _:
            parts = [(child, None) for child in syntax.children(body)]
    for part, wanted in parts:
        found = discrete_use(name, part, wanted, guess)
        if found is not None:
            return found
    return None
