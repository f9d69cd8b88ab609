"""The type that an expression most likely has, before it is elaborated.

Where a rule's result type is not asked for by its surroundings (`Rule + 1`, `peek(Rule, -1)`), it
is read off the rule's alternatives. That may go round in circles, so this pass only guesses and
never complains; the elaboration that follows checks.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from pirlc.frontend import syntax
from pirlc.frontend.discrete import undecided
from pirlc.frontend.scope import FUNCTIONS, Scope
from pirlc.frontend.syntax import Expression
from pirlc.ir.operators import COMPARISONS, Operator
from pirlc.ir.types import Bool, Real, Sequence, Type

Locals = Mapping[str, Type]

_LOGICAL = (Operator.AND, Operator.OR, Operator.IMPLIES, *COMPARISONS)

NESTING_LIMIT = 50
"""How many rules deep a guess goes."""


@dataclass
class Guesser:
    """Guesses types; remembers what it found of each rule.

    `steps` is the length of every sensor and action in a property `over` several steps.
    """

    scope: Scope
    in_property: bool = False
    steps: int | None = None
    _nested: int = 0
    _known: dict[tuple[str, tuple[Type, ...]], Type | None] = field(default_factory=dict)

    def type_of(self, expression: Expression, names: Locals) -> Type | None:
        """The type, or None where nothing settles it."""
        match expression:
            case syntax.Number() | syntax.Hole():
                return Real()
            case syntax.Name(text=text):
                return self._name(text, names)
            case syntax.Group(inner=inner):
                return self.type_of(inner, names)
            case syntax.Unary(operator=operator, operand=operand):
                return Bool() if operator is Operator.NOT else self.type_of(operand, names)
            case syntax.Binary(operator=operator, left=left, right=right):
                return Bool() if operator in _LOGICAL else self._broadcast((left, right), names)
            case syntax.Conditional(consequent=consequent, alternative=alternative):
                return self._first((consequent, alternative), names)
            case syntax.Binding(name=name, value=value, body=body):
                inner_type = self.type_of(value, names) or Real()
                return self.type_of(body, {**names, name.text: inner_type})
            case syntax.Call(name=name, arguments=arguments):
                return self._call(name.text, arguments, names)
            case syntax.Lambda() | syntax.OperatorWord():
                return None

    def rule(self, name: str, arguments: tuple[Type, ...]) -> Type | None:
        """The result type of a rule for these argument types."""
        key = (name, arguments)
        if key in self._known:
            return self._known[key]
        if self._nested >= NESTING_LIMIT:
            return None
        # While it is being found out, a rule that calls itself learns nothing from that.
        self._known[key] = None
        self._nested += 1
        rule = self.scope.rules[name]
        names = {formal.text: type_ for formal, type_ in zip(rule.formals, arguments, strict=False)}
        found = self._first(rule.alternatives, names)
        self._known[key] = found
        self._nested -= 1
        if self._nested == 0 and found is not None:
            # What stayed open on the way may have been waiting for this.
            self._known = {k: type_ for k, type_ in self._known.items() if type_ is not None}
        return found

    def _first(self, expressions: tuple[Expression, ...], names: Locals) -> Type | None:
        """The first type that is settled; whole numbers settle it only if nothing else does."""
        fallback: Type | None = None
        for expression in expressions:
            found = self.type_of(expression, names)
            if found is not None and not undecided(expression):
                return found
            fallback = fallback or found
        return fallback

    def _name(self, text: str, names: Locals) -> Type | None:
        if text in names:
            return names[text]
        if text in self.scope.sensors:
            return Sequence(self.steps or self.scope.window)
        if text in self.scope.actions and self.in_property:
            return self._action(text)
        if text in self.scope.parameters:
            return Real()
        return self.rule(text, ()) if text in self.scope.rules else None

    def _action(self, name: str) -> Type:
        return Sequence(self.steps) if self.steps else self.scope.actions[name].type

    def _broadcast(self, expressions: tuple[Expression, ...], names: Locals) -> Type | None:
        types = [self.type_of(expression, names) for expression in expressions]
        sequences = [type_ for type_ in types if isinstance(type_, Sequence)]
        if sequences:
            return sequences[0]
        return None if None in types else Real()

    def _call(self, name: str, arguments: tuple[Expression, ...], names: Locals) -> Type | None:
        if name in self.scope.rules:
            types = tuple(self.type_of(argument, names) or Real() for argument in arguments)
            return self.rule(name, types)
        match name:
            case "peek" | "fold":
                return Real()
            case "diff":
                inner = self.type_of(arguments[0], names) if arguments else None
                return Sequence(inner.length - 1) if isinstance(inner, Sequence) else None
            case "previous" | "raw":
                target = syntax.ungrouped(arguments[0]) if arguments else None
                if isinstance(target, syntax.Name) and target.text in self.scope.actions:
                    return self._action(target.text)
                return None
            case _:
                return self._broadcast(arguments, names) if name in FUNCTIONS else None
