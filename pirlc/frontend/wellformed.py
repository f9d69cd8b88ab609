"""Checks of the sketch as a whole: does every choice end, can every action be computed safely?

Goals: E04xx. Works on names for what concerns rules (types change nothing about which rule calls
which), and on typed terms for what may leave an action without a value.
"""

from __future__ import annotations

from collections.abc import Iterator

from pirlc.frontend import problems, syntax
from pirlc.frontend.declare import Declared
from pirlc.frontend.problems import Collector
from pirlc.frontend.syntax import Expression, ungrouped
from pirlc.ir import terms
from pirlc.ir.operators import Operator
from pirlc.ir.policy import (
    ActionSpec,
    Continuous,
    FixedParameter,
    FreeParameter,
    Hold,
    Rule,
    Sketch,
)
from pirlc.ir.terms import Term, subterms
from pirlc.source import Span

LARGE = 1e30
"""Beyond this, products of a few values may overflow (in binary32)."""


def judge(declared: Declared, sketch: Sketch, collector: Collector) -> None:
    """Add the errors of the sketch as a whole. `sketch` may be incomplete if there were others."""
    _check_ends(declared, collector)
    _check_guarded(declared, collector)
    if len(sketch.bodies) == len(sketch.interface.actions):
        for action, body in zip(sketch.interface.actions, sketch.bodies, strict=True):
            _check_safe(action, body, sketch, collector)


def warnings(declared: Declared, sketch: Sketch, collector: Collector) -> None:
    """Add the warnings: what the file declares and nothing uses."""
    used = {rule.name for rule in sketch.rules}
    for name, declaration in declared.scope.rules.items():
        if name not in used:
            collector.add(problems.UnusedRule(declaration.name.span, name))
    everywhere = [*sketch.bodies, *(a for rule in sketch.rules for a in rule.alternatives)]
    everywhere.extend(property_.body for property_ in sketch.properties)
    mentioned = {
        term.name
        for root in everywhere
        for term in subterms(root)
        if isinstance(term, terms.ParameterRef)
    }
    for parameter in sketch.parameters:
        if parameter.name not in mentioned:
            collector.add(problems.UnusedParameter(parameter.span, parameter.name))


def _uses(expression: Expression, declared: Declared) -> list[str]:
    """The rules that an expression mentions."""
    found = []
    match expression:
        case syntax.Name(text=text):
            found = [text]
        case syntax.Call(name=name):
            found = [name.text]
        case _:
            pass
    for child in syntax.children(expression):
        found.extend(_uses(child, declared))
    # Local names cannot be those of rules: that is an error of its own.
    return [name for name in found if name in declared.scope.rules]


def _check_ends(declared: Declared, collector: Collector) -> None:
    rules = declared.scope.rules
    calls = {
        name: [_uses(alternative, declared) for alternative in rule.alternatives]
        for name, rule in rules.items()
    }
    ending: set[str] = set()
    while True:
        more = {
            name
            for name, alternatives in calls.items()
            if name not in ending and any(ending.issuperset(used) for used in alternatives)
        }
        if not more:
            break
        ending |= more
    endless = [name for name in rules if name not in ending]
    reported: set[str] = set()
    for name in endless:
        # Of rules that lead to each other, the first is named.
        leads_to = _reachable(name, calls)
        if name in leads_to and not any(
            other in leads_to and name in _reachable(other, calls) for other in reported
        ):
            reported.add(name)
            collector.add(problems.EndlessRule(rules[name].name.span, name))
    for action, body in zip(declared.interface.actions, declared.bodies, strict=True):
        if body is not None:
            culprit = next((name for name in _uses(body, declared) if name not in ending), None)
            if culprit is not None:
                collector.add(problems.NoProgram(body.span, action.name, culprit))


def _reachable(start: str, calls: dict[str, list[list[str]]]) -> set[str]:
    """The rules that a rule leads to."""
    seen: set[str] = set()
    waiting = [start]
    while waiting:
        for used in calls[waiting.pop()]:
            waiting.extend(name for name in used if name not in seen)
            seen.update(used)
    return seen


def _check_guarded(declared: Declared, collector: Collector) -> None:
    """An alternative that is nothing but a rule adds nothing: such steps must not form a circle."""
    rules = declared.scope.rules
    steps: dict[str, list[tuple[str, Span]]] = {}
    for name, rule in rules.items():
        steps[name] = []
        for alternative in map(ungrouped, rule.alternatives):
            match alternative:
                case syntax.Name(text=text) if text in rules:
                    steps[name].append((text, alternative.span))
                case syntax.Call(name=called) if called.text in rules:
                    steps[name].append((called.text, alternative.span))
                case _:
                    pass
    reported: set[str] = set()
    for name in rules:
        cycle = _circle(name, steps)
        if cycle is not None and not reported.intersection(cycle):
            reported.update(cycle)
            second = cycle[1]
            span = next(span for target, span in steps[name] if target == second)
            collector.add(problems.UnguardedRecursion(span, tuple(cycle)))


def _circle(start: str, steps: dict[str, list[tuple[str, Span]]]) -> list[str] | None:
    """The shortest way from a rule back to itself."""
    paths = [[start]]
    seen: set[str] = set()
    while paths:
        path = paths.pop(0)
        for target, _ in steps[path[-1]]:
            if target == start:
                return [*path, start]
            if target not in seen:
                seen.add(target)
                paths.append([*path, target])
    return None


def _check_safe(action: ActionSpec, body: Term, sketch: Sketch, collector: Collector) -> None:
    if not isinstance(action.domain, Continuous) or action.domain.safe is not None:
        return
    for sensor in sketch.interface.sensors:
        if isinstance(sensor.missing, Hold) and sensor.missing.limit is not None:
            words = f"{sensor.name} may fail"
            collector.add(problems.SafeMissing(action.span, action.name, words, sensor.span))
            return
    for term in _reached(body, sketch):
        cause = _cause(term, sketch)
        if cause is not None:
            collector.add(problems.SafeMissing(action.span, action.name, cause, term.span))
            return


def _reached(body: Term, sketch: Sketch) -> Iterator[Term]:
    """The terms of an action's expression and of all rules that it leads to."""
    rules: dict[str, Rule] = {rule.key: rule for rule in sketch.rules}
    seen: set[str] = set()
    waiting = [body]
    while waiting:
        for term in subterms(waiting.pop(0)):
            yield term
            if isinstance(term, terms.RuleCall) and term.rule not in seen:
                seen.add(term.rule)
                waiting.extend(rules[term.rule].alternatives)


def _cause(term: Term, sketch: Sketch) -> str | None:
    """Why a term may give NaN, or what makes an infinity likely; None if it does not."""
    match term:
        case terms.Apply(Operator.DIVIDE, (_, terms.Literal(value))) if value != 0:
            return None
        case terms.Apply(Operator.DIVIDE):
            return "a division may have no value"
        case terms.Apply(Operator.SQRT):
            return "a square root may have no value"
        case terms.Apply(Operator.EXP):
            return "`exp` may grow without bound"
        case terms.Fold(Operator.MULTIPLY):
            return "a product over a window may overflow"
        case terms.FoldLambda():
            return "a `fold` with a lambda may overflow"
        case terms.Literal(value) if abs(value) > LARGE:
            return "numbers this large may overflow"
        case terms.Hole(_, lower, upper) if max(-lower, upper) > LARGE:
            return "numbers this large may overflow"
        case terms.SensorRef(name):
            sensor = sketch.interface.sensor(name)
            return _range_cause(sensor.lower, sensor.upper)
        case terms.ParameterRef(name):
            match next(p for p in sketch.parameters if p.name == name):
                case FixedParameter(_, value):
                    return _range_cause(value, value)
                case FreeParameter(_, lower, upper):
                    return _range_cause(lower, upper)
        case terms.PreviousAction(name):
            action = next(a for a in sketch.interface.actions if a.name == name)
            if isinstance(action.domain, Continuous):
                return _range_cause(action.domain.lower, action.domain.upper)
            return None
        case _:
            return None


def _range_cause(lower: float, upper: float) -> str | None:
    return "numbers this large may overflow" if max(-lower, upper) > LARGE else None
