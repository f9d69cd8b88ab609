"""From the syntax tree to the sketch: names become references, every term gets its type.

Goals: bidirectional typing (an integer becomes a discrete action's value where one is asked for),
broadcasting, one instance of a rule for each combination of argument types and result type, and
every type problem in one run. Non-goals: judging the sketch as a whole (`wellformed`).
"""

from __future__ import annotations

from dataclasses import replace

from pirlc.frontend import syntax
from pirlc.frontend.declare import WINDOW_LIMIT, Declared, limited
from pirlc.frontend.expressions import Context, Expressions
from pirlc.frontend.guess import Guesser
from pirlc.frontend.instances import Instance, Instances
from pirlc.frontend.names import explicit_holes
from pirlc.frontend.problems import Collector
from pirlc.ir import terms
from pirlc.ir.policy import Property, Rule
from pirlc.ir.terms import Term
from pirlc.ir.types import Bool, Type


def elaborate(
    declared: Declared, collector: Collector
) -> tuple[tuple[Term, ...], tuple[Rule, ...], tuple[Property, ...]]:
    """Actions' terms, rule instances and properties; incomplete if problems were found."""
    scope = declared.scope
    instances = Instances(collector)
    expressions = Expressions(scope, collector, Guesser(scope), instances)
    bodies = [
        expressions.check(
            body, action.type, Context({}, explicit_holes(body)), f"the action {action.name}"
        )
        for action, body in zip(declared.interface.actions, declared.bodies, strict=True)
        if body is not None
    ]
    rules: list[Rule] = []
    while instances.waiting:
        rules.append(_rule(instances.waiting.popleft(), expressions))
    order = {name: position for position, name in enumerate(scope.rules)}
    properties = [_property(declaration, expressions) for declaration in declared.properties]
    return (
        tuple(body for body in bodies if body is not None),
        tuple(sorted(rules, key=lambda rule: order[rule.name])),
        tuple(property_ for property_ in properties if property_ is not None),
    )


def _rule(instance: Instance, expressions: Expressions) -> Rule:
    name = instance.rule.name
    parameters = tuple(
        (formal.text, type_)
        for formal, type_ in zip(instance.rule.formals, instance.arguments, strict=True)
    )
    collector = expressions.collector
    collector.context = _use(name.text, parameters)
    alternatives = [
        expressions.check(
            alternative,
            instance.result,
            Context(dict(parameters), explicit_holes(alternative)),
            f"an alternative of {name.text}",
        )
        for alternative in instance.rule.alternatives
    ]
    collector.context = None
    return Rule(
        instance.key,
        name.text,
        parameters,
        instance.result,
        tuple(alternative for alternative in alternatives if alternative is not None),
        name.span,
    )


def _use(name: str, parameters: tuple[tuple[str, Type], ...]) -> str | None:
    """Which instance of a rule a problem is about, where that may matter."""
    given = ", ".join(f"{formal} a {type_}" for formal, type_ in parameters)
    return f"this is `{name}` with {given}" if given else None


def _property(declaration: syntax.Property, expressions: Expressions) -> Property | None:
    name, over = declaration.name, declaration.over
    steps = 1
    if over is not None:
        what = "the number of steps of a property"
        steps = limited(over, what, 1, WINDOW_LIMIT, expressions.collector) or 1
    shell = Property(name.text, terms.Literal(0.0), steps, over is not None, name.span)
    context = Context({}, {}, shell)
    body = expressions.check(declaration.body, Bool(), context, f"the property {name.text}")
    return replace(shell, body=body) if body is not None else None
