"""Name resolution: what every name in an expression may stand for, judged before any type is.

Goal: each name problem is reported here, once, also in rules that nothing uses. Non-goal: types.
The elaboration after this pass drops, in silence, what it cannot resolve.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from pirlc.frontend import problems_names as problems
from pirlc.frontend import syntax
from pirlc.frontend.declare import bounds, check_guess, check_name
from pirlc.frontend.problems import Collector
from pirlc.frontend.scope import FOLD_CALLS, FUNCTIONS, OPERATOR_CALLS, USAGES, Scope
from pirlc.frontend.syntax import Expression, ungrouped
from pirlc.ir.operators import SIGNATURES


@dataclass(frozen=True)
class _Place:
    """Where an expression stands: the local names that it sees, and what it may mention."""

    scope: Scope
    collector: Collector
    in_property: bool
    locals: frozenset[str] = frozenset()

    def binding(self, *names: syntax.Name) -> _Place:
        return replace(self, locals=self.locals | {name.text for name in names})


def check_action(body: Expression, scope: Scope, collector: Collector) -> None:
    """Names and holes of an action's expression."""
    _check_holes(body, collector)
    _visit(body, _Place(scope, collector, in_property=False))


def check_rule(rule: syntax.Rule, scope: Scope, collector: Collector) -> None:
    """Names and holes of a rule's alternatives."""
    place = _Place(scope, collector, in_property=False)
    first: dict[str, syntax.Name] = {}
    for formal in rule.formals:
        _check_local(formal, place)
        if formal.text in first:
            collector.add(problems.DuplicateName(formal.span, formal.text, first[formal.text].span))
        first.setdefault(formal.text, formal)
    for alternative in rule.alternatives:
        _check_holes(alternative, collector)
        _visit(alternative, place.binding(*rule.formals))


def check_property(body: Expression, scope: Scope, collector: Collector) -> None:
    """Names of a property, which has neither holes nor rules."""
    _visit(body, _Place(scope, collector, in_property=True))


def holes(expression: Expression) -> list[syntax.Hole]:
    """The holes in an expression, in the order of the text."""
    if isinstance(expression, syntax.Hole):
        return [expression]
    return [hole for child in syntax.children(expression) for hole in holes(child)]


def explicit_holes(expression: Expression) -> dict[str, syntax.Hole]:
    """By name, the mention of each hole that gives its bounds (or, if none does, the first)."""
    chosen: dict[str, syntax.Hole] = {}
    for hole in holes(expression):
        known = chosen.get(hole.name.text)
        if known is None or (known.bounds is None and hole.bounds is not None):
            chosen[hole.name.text] = hole
    return chosen


def _check_holes(body: Expression, collector: Collector) -> None:
    chosen = explicit_holes(body)
    for hole in holes(body):
        name = hole.name
        check_name(name, collector)
        if hole.bounds is not None:
            bounds(hole.bounds, point=True, collector=collector)
        check_guess(name.text, hole.guess, hole.bounds, collector)
        leading = chosen[name.text]
        plain = hole.bounds is None and hole.guess is None
        if not plain and _said(hole) != _said(leading):
            collector.add(problems.HoleConflict(hole.span, name.text, leading.span))


def _said(hole: syntax.Hole) -> tuple[float | None, ...]:
    limits = (hole.bounds.lower.value, hole.bounds.upper.value) if hole.bounds else (None, None)
    return (*limits, hole.guess.value if hole.guess else None)


def _check_local(name: syntax.Name, place: _Place) -> None:
    check_name(name, place.collector)
    kind = place.scope.kind(name.text)
    if kind is not None and name.text not in FUNCTIONS:
        place.collector.add(
            problems.HiddenName(name.span, name.text, kind, place.scope.spans[name.text])
        )


def _visit(expression: Expression, place: _Place) -> None:
    match expression:
        case syntax.Name():
            _name(expression, place)
        case syntax.Call():
            _call(expression, place)
        case syntax.Hole(name=name):
            if place.in_property:
                place.collector.add(problems.HoleInProperty(expression.span, name.text))
        case syntax.Binding(name=name, value=value, body=body):
            _check_local(name, place)
            _visit(value, place)
            _visit(body, place.binding(name))
        case syntax.Lambda():
            place.collector.add(problems.MisplacedArgument(expression.span, "a lambda"))
        case syntax.OperatorWord():
            place.collector.add(problems.MisplacedArgument(expression.span, "an operator alone"))
        case _:
            for child in syntax.children(expression):
                _visit(child, place)


def _name(name: syntax.Name, place: _Place) -> None:
    scope, text = place.scope, name.text
    if text in place.locals or text in scope.sensors or text in scope.parameters:
        return
    if text in scope.actions:
        if not place.in_property:
            place.collector.add(problems.ActionAsValue(name.span, text))
    elif text in scope.rules:
        _rule_use(name, 0, place)
    elif text in FUNCTIONS:
        place.collector.add(problems.WrongArgumentCount(name.span, text, USAGES[text], 0))
    else:
        close = None if place.collector.full else scope.close(text, sorted(place.locals))
        place.collector.add(problems.UnknownName(name.span, text, "name", close))


def _rule_use(name: syntax.Name, given: int, place: _Place) -> None:
    if place.in_property:
        place.collector.add(problems.RuleInProperty(name.span, name.text))
        return
    formals = [formal.text for formal in place.scope.rules[name.text].formals]
    if given != len(formals):
        usage = f"{name.text}({', '.join(formals)})" if formals else name.text
        place.collector.add(problems.WrongArgumentCount(name.span, name.text, usage, given))


def _call(call: syntax.Call, place: _Place) -> None:
    name, arguments = call.name, call.arguments
    match name.text:
        case "previous" | "raw":
            _action_call(call, place)
            return
        case "fold":
            _fold(call, place)
            return
        case "peek" | "diff" as builtin:
            _count(call, 2 if builtin == "peek" else 1, place)
        case text if text in OPERATOR_CALLS:
            _count(call, SIGNATURES[OPERATOR_CALLS[text]].arity, place)
        case text if text in place.locals:
            place.collector.add(
                problems.WrongKind(name.span, text, "a local name", "a function or a rule")
            )
        case text if text in place.scope.rules:
            _rule_use(name, len(arguments), place)
        case text:
            kind = place.scope.kind(text)
            place.collector.add(
                problems.WrongKind(name.span, text, kind, "a function or a rule")
                if kind
                else problems.UnknownName(
                    name.span, text, "function or rule", place.scope.close(text)
                )
            )
    for argument in arguments:
        _visit(argument, place)


def _count(call: syntax.Call, wanted: int, place: _Place) -> None:
    given = len(call.arguments)
    if given != wanted:
        text = call.name.text
        place.collector.add(problems.WrongArgumentCount(call.name.span, text, USAGES[text], given))


def _action_call(call: syntax.Call, place: _Place) -> None:
    _count(call, 1, place)
    if call.name.text == "raw" and not place.in_property:
        place.collector.add(problems.OnlyInProperties(call.span, "raw"))
    for argument in map(ungrouped, call.arguments[:1]):
        wanted = "an action"
        if not isinstance(argument, syntax.Name):
            place.collector.add(problems.WrongKind(argument.span, "", "an expression", wanted))
        elif argument.text not in place.scope.actions:
            kind = place.scope.kind(argument.text)
            if argument.text in place.locals:
                kind = "a local name"
            close = place.scope.close(argument.text) if kind is None else None
            place.collector.add(
                problems.WrongKind(argument.span, argument.text, kind, wanted)
                if kind
                else problems.UnknownName(argument.span, argument.text, "action", close)
            )


def _fold(call: syntax.Call, place: _Place) -> None:
    arguments = call.arguments
    first = ungrouped(arguments[0]) if arguments else None
    _count(call, 3 if isinstance(first, syntax.Lambda) else 2, place)
    match first:
        case syntax.Lambda(element=element, accumulator=accumulator, body=body):
            for name in (element, accumulator):
                _check_local(name, place)
            if element.text == accumulator.text:
                place.collector.add(
                    problems.DuplicateName(accumulator.span, accumulator.text, element.span)
                )
            _visit(body, place.binding(element, accumulator))
        case syntax.OperatorWord() | None:
            pass
        case syntax.Name(text=text) if text in FOLD_CALLS or text in OPERATOR_CALLS:
            pass
        case _:
            _visit(first, place)
    for argument in arguments[1:]:
        _visit(argument, place)
