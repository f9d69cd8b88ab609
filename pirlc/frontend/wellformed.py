"""Checks of the sketch as a whole: does every choice end, can every action be computed safely?

Goals: E04xx. Works on names for what concerns rules (types change nothing about which rule calls
which), and on typed terms for what may leave an action without a value.
"""

from __future__ import annotations

from collections.abc import Iterator

from pirlc.frontend import problems_sketch as problems
from pirlc.frontend import syntax
from pirlc.frontend.declare import Declared
from pirlc.frontend.graphs import circles, components
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
    ending = _check_ends(declared, collector)
    _check_guarded(declared, ending, collector)
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


def _check_ends(declared: Declared, collector: Collector) -> set[str]:
    """The rules that can end; for the others, problems are added."""
    rules = declared.scope.rules
    calls = {
        name: [_uses(alternative, declared) for alternative in rule.alternatives]
        for name, rule in rules.items()
    }
    ending = _ending(calls)
    endless = {
        name: [other for used in alternatives for other in used if other not in ending]
        for name, alternatives in calls.items()
        if name not in ending
    }
    for component in components(endless):
        # Of rules that lead to each other, the first in the file is named.
        first = next(name for name in endless if name in component)
        collector.add(problems.EndlessRule(rules[first].name.span, first))
    for action, body in zip(declared.interface.actions, declared.bodies, strict=True):
        if body is not None:
            culprit = next((name for name in _uses(body, declared) if name not in ending), None)
            if culprit is not None:
                collector.add(problems.NoProgram(body.span, action.name, culprit))
    return ending


def _ending(calls: dict[str, list[list[str]]]) -> set[str]:
    """The rules that have an alternative whose rules all end."""
    needs: list[tuple[str, set[str]]] = []
    needed_by: dict[str, list[int]] = {name: [] for name in calls}
    ending: set[str] = set()
    fresh: list[str] = []
    for name, alternatives in calls.items():
        for used in map(set, alternatives):
            for other in used:
                needed_by[other].append(len(needs))
            needs.append((name, used))
            if not used:
                fresh.append(name)
    while fresh:
        done = fresh.pop()
        if done in ending:
            continue
        ending.add(done)
        for index in needed_by[done]:
            name, used = needs[index]
            used.discard(done)
            if not used:
                fresh.append(name)
    return ending


def _check_guarded(declared: Declared, ending: set[str], collector: Collector) -> None:
    """An alternative that is nothing but a rule adds nothing: such steps must not form a circle.

    So is one that may be nothing but a rule, as in `R = 1 | Same(R)` with `Same(x) = x`. Rules
    that never end have been reported as such.
    """
    rules = declared.scope.rules
    passed = _passed_on(rules)
    steps: dict[str, list[tuple[str, Span]]] = {
        name: [
            (target, alternative.span)
            for alternative in map(ungrouped, rule.alternatives)
            for target in _nothing_but(alternative, rules, passed)
            if target in ending
        ]
        for name, rule in rules.items()
    }
    for cycle in circles({name: [target for target, _ in to] for name, to in steps.items()}):
        span = next(span for target, span in steps[cycle[0]] if target == cycle[1])
        collector.add(problems.UnguardedRecursion(span, tuple(cycle)))


def _nothing_but(
    expression: Expression, rules: dict[str, syntax.Rule], passed: dict[str, set[int]]
) -> Iterator[str]:
    """The rules and local names that an expression may be, with nothing around them."""
    match ungrouped(expression):
        case syntax.Name(text=text):
            yield text
        case syntax.Call(name=called, arguments=arguments) if called.text in rules:
            yield called.text
            for number in sorted(passed[called.text]):
                if number < len(arguments):
                    yield from _nothing_but(arguments[number], rules, passed)
        case _:
            pass


def _passed_on(rules: dict[str, syntax.Rule]) -> dict[str, set[int]]:
    """For each rule the numbers of the arguments that it may be, with nothing around them."""
    passed: dict[str, set[int]] = {name: set() for name in rules}
    grown = True
    while grown:
        grown = False
        for name, rule in rules.items():
            formals = [formal.text for formal in rule.formals]
            for alternative in rule.alternatives:
                for found in list(_nothing_but(alternative, rules, passed)):
                    if found in formals and formals.index(found) not in passed[name]:
                        passed[name].add(formals.index(found))
                        grown = True
    return passed


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
