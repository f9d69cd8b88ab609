"""What the names of a file stand for."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from pirlc.diagnostics import suggestion
from pirlc.frontend import syntax
from pirlc.ir.operators import SIGNATURES, Notation, Operator
from pirlc.ir.policy import ActionSpec, Parameter, Sensor
from pirlc.source import Span

OPERATOR_CALLS = {
    operator.value: operator
    for operator, signature in SIGNATURES.items()
    if signature.notation is Notation.CALL
}
"""The basic operators that are written as calls."""

USAGES = {
    "peek": "peek(sequence, -1)",
    "fold": "fold(operator, sequence)` or `fold(\\v acc -> expression, sequence, initial)",
    "diff": "diff(sequence)",
    "previous": "previous(action)",
    "raw": "raw(action)",
    **{
        name: f"{name}({', '.join('xyz'[: SIGNATURES[operator].arity])})"
        for name, operator in OPERATOR_CALLS.items()
    },
}
"""How each built-in function is called."""

USAGES["clip"] = "clip(x, low, high)"

FUNCTIONS = frozenset(USAGES)
"""The names of the built-in functions; no declaration may take them."""

FOLD_CALLS = {"min": Operator.MIN, "max": Operator.MAX}
"""The operators that `fold` takes by their name."""


@dataclass(frozen=True)
class Scope:
    """The declarations of a file by name. A name belongs to one of them only."""

    sensors: dict[str, Sensor]
    actions: dict[str, ActionSpec]
    parameters: dict[str, Parameter]
    rules: dict[str, syntax.Rule]
    window: int
    spans: dict[str, Span]

    def kind(self, name: str) -> str | None:
        """What a declared name is, in words."""
        if name in self.sensors:
            return "a sensor"
        if name in self.actions:
            return "an action"
        if name in self.parameters:
            return "a parameter"
        if name in self.rules:
            return "a rule"
        return "a built-in function" if name in FUNCTIONS else None

    def close(self, name: str, more: Iterable[str] = ()) -> str | None:
        """The known name that a misspelt one was likely meant to be."""
        return suggestion(name, [*more, *self.spans, *sorted(FUNCTIONS)])
