"""What a sketch allows, measured and put into words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pirlc.ir import layout
from pirlc.ir.expansion import close, expand, only_derivation
from pirlc.ir.policy import (
    Choice,
    Continuous,
    FixedParameter,
    FreeParameter,
    Hold,
    Interface,
    Parameter,
    Rule,
    Sensor,
    Sketch,
)
from pirlc.ir.printer import environment_text, range_text
from pirlc.ir.terms import Hole, subterms
from pirlc.search.enumeration import Enumeration


@dataclass(frozen=True)
class OpenParameter:
    """A hole, with the rule or action that writes it."""

    hole: Hole
    writer: str


@dataclass(frozen=True)
class Allowed:
    """A sketch and what follows from it.

    `nodes`: the size of the only program template, None where there are several. `closed`: nothing
    is left to choose. `counts[k]`: how many program templates have size k + 1, equal ones that
    are written in different ways counted apart.
    """

    sketch: Sketch
    holes: tuple[OpenParameter, ...]
    nodes: int | None
    closed: bool
    counts: tuple[int, ...]


def measure(sketch: Sketch, largest: int) -> Allowed:
    """Count what the sketch allows, up to a size."""
    derivations = only_derivation(sketch)
    nodes = None if derivations is None else expand(sketch, derivations).template.size
    counts: tuple[int, ...] = ()
    if nodes is None:
        enumeration = Enumeration(sketch)
        counts = tuple(enumeration.count(size) for size in range(1, largest + 1))
    return Allowed(sketch, _holes(sketch), nodes, close(sketch) is not None, counts)


def _holes(sketch: Sketch) -> tuple[OpenParameter, ...]:
    actions = zip(sketch.interface.actions, sketch.bodies, strict=True)
    written = [(action.name, [body]) for action, body in actions]
    written += [(rule.name, list(rule.alternatives)) for rule in sketch.rules]
    found: dict[tuple[str, str], OpenParameter] = {}
    for writer, terms in written:
        for term in terms:
            for sub in subterms(term):
                if isinstance(sub, Hole):
                    found.setdefault((writer, sub.name), OpenParameter(sub, writer))
    return tuple(found.values())


# In words.


def in_words(allowed: Allowed) -> str:
    """The summary that `pirlc check` prints."""
    sketch = allowed.sketch
    interface = sketch.interface
    paragraphs = [
        [_first_line(allowed)],
        ["sensors", *_columns([_sensor_words(s) for s in interface.sensors])],
        ["actions", *_columns([_action_words(interface, i) for i in range(len(sketch.bodies))])],
    ]
    if sketch.rules:
        heads = [(rule_words(sketch, rule), _alternatives(rule)) for rule in sketch.rules]
        paragraphs.append(["rules", *_columns(heads)])
    rows = [_parameter_words(p) for p in sketch.parameters]
    rows += [_hole_words(found) for found in allowed.holes]
    if rows:
        paragraphs.append(["parameters", *_columns(rows)])
    if sketch.properties:
        names = ", ".join(p.name for p in sketch.properties)
        paragraphs.append([f"properties to prove: {names}"])
    paragraphs.append(_templates_words(allowed))
    return "\n\n".join("\n".join(lines) for lines in paragraphs)


def _first_line(allowed: Allowed) -> str:
    interface = allowed.sketch.interface
    parts = [f"window {interface.window}"]
    if interface.latency:
        parts.append(f"latency {interface.latency}")
    if interface.sample_time is not None:
        parts.append(f"sample time {interface.sample_time:g} s")
    kind = "a program" if allowed.closed else "a sketch"
    if interface.environment is not None:
        text = environment_text(interface.environment).removeprefix("environment ")
        kind += f" for {text}"
    return f"{interface.name}: {kind}, {', '.join(parts)}"


def _sensor_words(sensor: Sensor) -> tuple[str, ...]:
    return (
        sensor.name,
        range_text(sensor.lower, sensor.upper),
        f"reading {sensor.index}",
        _missing(sensor),
    )


def _missing(sensor: Sensor) -> str:
    match sensor.missing:
        case Hold(None):
            return ""
        case Hold(0):
            return "missing: fail"
        case Hold(limit):
            return f"missing: hold {limit}, then fail"
        case _:
            return "missing: zero"


def _action_words(interface: Interface, number: int) -> tuple[str, ...]:
    action = interface.actions[number]
    match action.domain:
        case Continuous(lower, upper):
            domain = range_text(lower, upper)
        case Choice(values):
            domain = "{" + ", ".join(map(str, values)) + "}"
    return action.name, domain, f"component {action.component}", f"safe {action.safe:g}"


def rule_words(sketch: Sketch, rule: Rule) -> str:
    """The rule's head; with its arguments' types where it is used at several."""
    parameters = [name for name, _ in rule.parameters]
    if sum(other.name == rule.name for other in sketch.rules) > 1:
        parameters = [f"{name} : {type_}" for name, type_ in rule.parameters]
    return f"{rule.name}({', '.join(parameters)})" if parameters else rule.name


def _alternatives(rule: Rule) -> str:
    count = len(rule.alternatives)
    return f"{count} alternative{'s' if count != 1 else ''}"


def _parameter_words(parameter: Parameter) -> tuple[str, ...]:
    match parameter:
        case FixedParameter(name, value):
            return name, f"= {layout.number_text(value)}", ""
        case FreeParameter(name, lower, upper, guess):
            return name, f"in {range_text(lower, upper)}{_guess(guess)}", "shared"


def _hole_words(found: OpenParameter) -> tuple[str, ...]:
    hole = found.hole
    bounds = f"in {range_text(hole.lower, hole.upper)}{_guess(hole.guess)}"
    return f"?{hole.name}", bounds, f"of {found.writer}"


def _guess(guess: float | None) -> str:
    return "" if guess is None else f" = {layout.number_text(guess)}"


def _columns(rows: Sequence[tuple[str, ...]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  " + "   ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def _templates_words(allowed: Allowed) -> list[str]:
    if allowed.closed:
        return [f"a program of {allowed.nodes} nodes: nothing is left to choose"]
    if allowed.nodes is not None:
        return [f"one program template, of {allowed.nodes} nodes: its parameters are to be found"]
    largest = len(allowed.counts)
    if not any(allowed.counts):
        return [f"no program template has {largest} nodes or fewer (try a larger --size)"]
    entries, total = [], 0
    for size, count in enumerate(allowed.counts, 1):
        total += count
        if count:
            entries.append((str(size), readable(total)))
    return ["program templates up to each size, in nodes", *_grid(entries)]


def _grid(entries: list[tuple[str, str]]) -> list[str]:
    """Sizes and counts in a few columns, read downwards."""
    left = max(len(size) for size, _ in entries)
    right = max(len(count) for _, count in entries)
    columns = max(1, min(4, 78 // (left + right + 6)))
    height = -(-len(entries) // columns)
    return [
        "  " + "    ".join(f"{s.rjust(left)}  {c.rjust(right)}" for s, c in entries[row::height])
        for row in range(height)
    ]


def readable(count: int) -> str:
    """A count with commas, or rounded to a power of ten where it is very long.

    >>> readable(1234567), readable(10**20 + 5)
    ('1,234,567', '1.0e20')
    """
    if count < 10**12:
        return f"{count:,}"
    digits = str(count)
    return f"{digits[0]}.{digits[1]}e{len(digits) - 1}"


# As data.


def as_data(allowed: Allowed) -> dict[str, object]:
    """The same for `--json`."""
    sketch = allowed.sketch
    interface = sketch.interface
    environment = interface.environment
    templates, total = [], 0
    for size, count in enumerate(allowed.counts, 1):
        total += count
        templates.append({"size": size, "count": count, "up_to": total})
    return {
        "policy": interface.name,
        "environment": None
        if environment is None
        else {"id": environment.id, "arguments": dict(environment.arguments)},
        "window": interface.window,
        "latency": interface.latency,
        "sample_time": interface.sample_time,
        "sensors": [
            {"name": s.name, "lower": s.lower, "upper": s.upper, "index": s.index}
            for s in interface.sensors
        ],
        "actions": [_action_data(interface, i) for i in range(len(interface.actions))],
        "rules": [
            {
                "name": rule.name,
                "parameters": [{"name": n, "type": str(t)} for n, t in rule.parameters],
                "alternatives": len(rule.alternatives),
            }
            for rule in sketch.rules
        ],
        "parameters": [_parameter_data(p) for p in sketch.parameters],
        "holes": [
            {
                "name": found.hole.name,
                "lower": found.hole.lower,
                "upper": found.hole.upper,
                "guess": found.hole.guess,
                "writer": found.writer,
            }
            for found in allowed.holes
        ],
        "properties": [p.name for p in sketch.properties],
        "closed": allowed.closed,
        "nodes": allowed.nodes,
        "templates": templates,
    }


def _action_data(interface: Interface, number: int) -> dict[str, object]:
    action = interface.actions[number]
    common = {"name": action.name, "component": action.component, "safe": action.safe}
    match action.domain:
        case Continuous(lower, upper):
            return {**common, "lower": lower, "upper": upper}
        case Choice(values):
            return {**common, "values": list(values)}


def _parameter_data(parameter: Parameter) -> dict[str, object]:
    match parameter:
        case FixedParameter(name, value):
            return {"name": name, "value": value}
        case FreeParameter(name, lower, upper, guess):
            return {"name": name, "lower": lower, "upper": upper, "guess": guess}
