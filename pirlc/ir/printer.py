"""Sketches, program templates and programs as .pirl text that reads back as an equal value."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import assert_never

from pirlc.ir import layout, terms
from pirlc.ir.layout import Piece, number_text, word
from pirlc.ir.operators import SIGNATURES, Notation
from pirlc.ir.policy import (
    DEFAULT_BOUNDS,
    ActionSpec,
    Choice,
    Continuous,
    Environment,
    Fill,
    FixedParameter,
    FreeParameter,
    Hold,
    Interface,
    Parameter,
    Program,
    ProgramTemplate,
    Property,
    Scalar,
    Sensor,
    Sketch,
    Zero,
)
from pirlc.ir.terms import Term, bound, transform


def program_text(program: Program | ProgramTemplate, header: tuple[str, ...] = ()) -> str:
    """The file of a program; `header` are the lines of a comment before it, without their `#`."""
    return _file(program, program.bodies, [], header)


def sketch_text(sketch: Sketch, header: tuple[str, ...] = ()) -> str:
    """The file of a sketch. A rule that is used with several types is a rule for each of them."""
    names = _rule_names(sketch)

    def renamed(term: Term) -> Term:
        return replace(term, rule=names[term.rule]) if isinstance(term, terms.RuleCall) else term

    rules = []
    for rule in sketch.rules:
        arguments = ", ".join(name for name, _ in rule.parameters)
        head = f"rule {names[rule.key]}" + (f"({arguments})" if arguments else "")
        alternatives = [piece(transform(a, renamed)) for a in rule.alternatives]
        rules.append([layout.render(layout.definition(head, alternatives))])
    return _file(sketch, tuple(transform(b, renamed) for b in sketch.bodies), rules, header)


def _rule_names(sketch: Sketch) -> dict[str, str]:
    """A name of its own for each rule, by its key."""
    interface = sketch.interface
    taken = {rule.name for rule in sketch.rules}
    taken.update(name for rule in sketch.rules for name, _ in rule.parameters)
    taken.update(x.name for x in (*interface.sensors, *interface.actions, *sketch.parameters))
    bodies = [*sketch.bodies, *(a for rule in sketch.rules for a in rule.alternatives)]
    taken.update(n for b in (*bodies, *(p.body for p in sketch.properties)) for n in bound(b))
    names: dict[str, str] = {}
    for rule in sketch.rules:
        name, number = rule.name, 2
        while rule.key != rule.name and name in taken:
            name, number = f"{rule.name}_{number}", number + 1
        names[rule.key] = name
        taken.add(name)
    return names


def _file(
    policy: Sketch | Program | ProgramTemplate,
    bodies: tuple[Term, ...],
    rules: list[list[str]],
    header: tuple[str, ...],
) -> str:
    interface = policy.interface
    groups = [
        [f"# {line}".rstrip() for line in header],
        [f"policy {interface.name}"],
        [environment_text(interface.environment)] if interface.environment else [],
        [*sensor_texts(interface.sensors), *setting_texts(interface)],
        [*map(parameter_text, policy.parameters)],
        [
            layout.render(layout.definition(action_head(action, position), [piece(body)]))
            for position, (action, body) in enumerate(zip(interface.actions, bodies, strict=True))
        ],
        *rules,
        [*map(property_text, policy.properties)],
    ]
    return "\n\n".join("\n".join(group) for group in groups if group) + "\n"


def term_text(term: Term) -> str:
    """A term on one line."""
    return layout.render(layout.Group(piece(term).document), width=2**62)


def environment_text(environment: Environment) -> str:
    head = f"environment {scalar_text(environment.id)}"
    arguments = [f"{name} = {scalar_text(value)}" for name, value in environment.arguments]
    return layout.render(layout.braces(head, list(map(layout.Text, arguments))))


def scalar_text(value: Scalar) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case int():
            return str(value)
        case float():
            # A float stays one: a whole one keeps its point.
            text = number_text(value)
            return text if set(text) & set(".e") else text + ".0"
        case str():
            return quoted(value)


def quoted(text: str) -> str:
    """A text in double quotes, with the escapes that the language reads back."""
    return json.dumps(text, ensure_ascii=False)


def range_text(lower: float, upper: float) -> str:
    return f"[{number_text(lower)}, {number_text(upper)}]"


def sensor_texts(sensors: tuple[Sensor, ...]) -> list[str]:
    """The sensors' declarations, in columns."""
    return layout.table(
        [
            (
                f"sensor {sensor.name}",
                f": {range_text(sensor.lower, sensor.upper)}",
                f"= {sensor.index}{_missing_text(sensor)}",
            )
            for sensor in sensors
        ]
    )


def _missing_text(sensor: Sensor) -> str:
    match sensor.missing:
        case Hold(None):
            return ""
        case Hold(0):
            return " missing fail"
        case Hold(limit):
            return f" missing hold {limit} then fail"
        case Zero():
            return " missing zero"
        case _:
            assert_never(sensor.missing)


def setting_texts(interface: Interface) -> list[str]:
    """The window, and what else says when a policy reads."""
    lines = [f"window {interface.window}"]
    if interface.sample_time is not None:
        lines.append(f"sample_time {number_text(interface.sample_time)}")
    if interface.latency:
        lines.append(f"latency {interface.latency}")
    if interface.fill is not Fill.FIRST:
        lines.append(f"fill {interface.fill.value}")
    return lines


def parameter_text(parameter: Parameter) -> str:
    match parameter:
        case FixedParameter(name, value):
            return f"param {name} = {number_text(value)}"
        case FreeParameter(name, lower, upper, guess):
            start = "" if guess is None else f" = {number_text(guess)}"
            return f"param {name} in {range_text(lower, upper)}{start}"
        case _:
            assert_never(parameter)


def action_head(action: ActionSpec, position: int) -> str:
    """An action up to its `=`; `position` is its place among the actions."""
    match action.domain:
        case Continuous(lower, upper, safe):
            domain = range_text(lower, upper)
            fallback = "" if safe is None else f" safe {number_text(safe)}"
        case Choice(values, safe):
            domain = "{" + ", ".join(map(str, values)) + "}"
            fallback = "" if safe is None else f" safe {safe}"
    component = "" if action.component == position else f" = {action.component}"
    return f"action {action.name} : {domain}{component}{fallback}"


def property_text(property_: Property) -> str:
    over = f" over {property_.steps}" if property_.ranged else ""
    head = f"property {property_.name}{over}"
    return layout.render(layout.definition(head, [piece(property_.body)]))


def piece(term: Term) -> Piece:
    """A term, ready to be laid out."""
    match term:
        case terms.Literal(value):
            return word(number_text(value))
        case terms.DiscreteLiteral(value):
            return word(str(value))
        case terms.ParameterRef(name) | terms.SensorRef(name) | terms.LocalRef(name):
            return word(name)
        case terms.PreviousAction(action):
            return layout.call("previous", [word(action)])
        case terms.ActionRef(action, raw):
            return layout.call("raw", [word(action)]) if raw else word(action)
        case terms.Apply(operator, arguments):
            pieces = [piece(argument) for argument in arguments]
            match SIGNATURES[operator].notation:
                case Notation.INFIX:
                    return layout.infix(operator, pieces[0], pieces[1])
                case Notation.PREFIX:
                    literal = isinstance(arguments[0], terms.Literal)
                    return layout.prefix(
                        operator, layout.grouped(pieces[0]) if literal else pieces[0]
                    )
                case Notation.CALL:
                    return layout.call(operator.value, pieces)
        case terms.Peek(sequence, index):
            return layout.call("peek", [piece(sequence), word(str(index))])
        case terms.Fold(operator, sequence):
            return layout.call("fold", [Piece(layout.Text(operator.value)), piece(sequence)])
        case terms.FoldLambda(element, accumulator, body, sequence, initial):
            function = layout.lambda_(element, accumulator, piece(body))
            return layout.call("fold", [function, piece(sequence), piece(initial)])
        case terms.Diff(sequence):
            return layout.call("diff", [piece(sequence)])
        case terms.If(condition, consequent, alternative):
            return layout.conditional(piece(condition), piece(consequent), piece(alternative))
        case terms.Let(name, value, body):
            return layout.binding(name, piece(value), piece(body))
        case terms.Hole(name):
            return word(_hole_text(term))
        case terms.RuleCall(rule, arguments):
            name = rule.split("#")[0]
            return layout.call(name, map(piece, arguments)) if arguments else word(name)
        case _:
            assert_never(term)


def _hole_text(hole: terms.Hole) -> str:
    bounds = (hole.lower, hole.upper)
    within = "" if bounds == DEFAULT_BOUNDS else f" in {range_text(*bounds)}"
    start = "" if hole.guess is None else f" = {number_text(hole.guess)}"
    return f"?({hole.name}{within}{start})" if within or start else f"?{hole.name}"
