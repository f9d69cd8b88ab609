"""The language's own grammar as a sketch: the paper's NoSketch, as text like any other sketch.

Goals: everything that an engineer put into the expressions of a sketch is gone; what it reads and
sets, its window and its properties stay. Every function of the readings that the language can
write with real constants is one of the grammar's programs, and every program is well typed.

Non-goals: every way to write a function. What would be there twice is there once:

- no expression of constants alone but `?c`, which stands for all of them;
- `>` and `<` alone of the comparisons, no `not` and no `implies`: exchanged branches say those;
- no arithmetic on sequences, `diff` or `fold` with a lambda: a window is finite, so that they can
  be written with `peek`; no `clip`, which is `min` and `max`; no `let`, which only shares.

What the paper's sketches use comes first, so that it comes first among templates of one size.
`previous(A)` is something to read for those actions of which the sketch reads it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from pirlc.frontend.format import format_source
from pirlc.ir.operators import FOLDABLE
from pirlc.ir.policy import ActionSpec, Choice, Continuous, Parameter, Sketch
from pirlc.ir.printer import (
    action_head,
    environment_text,
    parameter_text,
    property_text,
    sensor_texts,
    setting_texts,
)
from pirlc.ir.terms import ParameterRef, PreviousAction, Term, bound, subterms
from pirlc.source import SourceText

_OPERATIONS = (
    "{signal} + {real}",
    "{signal} - {real}",
    "{real} - {signal}",
    "{signal} * {real}",
    "{signal} / {real}",
    "{real} / {signal}",
    "if {condition} then {real} else {real}",
    "min({signal}, {real})",
    "max({signal}, {real})",
    "abs({signal})",
    "sqrt({signal})",
    "exp({signal})",
    "tanh({signal})",
    "sign({signal})",
)
_COMPARISONS = ("{signal} > {real}", "{signal} < {real}")
_JUNCTIONS = ("{condition} and {condition}", "{condition} or {condition}")


@dataclass(frozen=True)
class _Names:
    """The names of the grammar's rules; `values` has one for each discrete action."""

    real: str
    signal: str
    condition: str
    reading: str
    values: dict[str, str]

    def put_in(self, texts: Iterable[str]) -> list[str]:
        return [
            text.format(real=self.real, signal=self.signal, condition=self.condition)
            for text in texts
        ]


def own_grammar(sketch: Sketch, name: str) -> SourceText:
    """All programs over the sensors, window and actions of a sketch, as a file called `name`."""
    interface = sketch.interface
    names = _names(sketch)
    lines = [
        f"# The language's own grammar over the sensors of {interface.name}: what `--no-sketch`",
        "# searches in place of the sketch's own expressions and rules.",
        "",
        f"policy {interface.name}",
        "",
        *([environment_text(interface.environment), ""] if interface.environment else []),
        *sensor_texts(interface.sensors),
        *setting_texts(interface),
        "",
        *(f"{parameter_text(p)}\n" for p in _parameters_of_properties(sketch)),
    ]
    for position, action in enumerate(interface.actions):
        head = action_head(_with_safe_value(action), position)
        lines.append(f"{head} = {names.values.get(action.name, names.real)}\n")
    for rule, alternatives in _rules(sketch, names):
        lines.append(f"rule {rule} = {' | '.join(alternatives)}\n")
    lines += [f"{property_text(p)}\n" for p in sketch.properties]
    return SourceText(name, format_source(SourceText(name, "\n".join(lines))))


def _rules(sketch: Sketch, names: _Names) -> Iterator[tuple[str, list[str]]]:
    """Those that some action leads to, each with its alternatives."""
    actions = sketch.interface.actions
    read = _previous_read(sketch)
    signals = list(_signals(sketch, read, names))
    conditions = list(_conditions(actions, read, names, signals))
    for action in actions:
        match action.domain:
            case Choice(values):
                own = names.values[action.name]
                choices = [*map(str, values)]
                if action.name in read:
                    choices.append(f"previous({action.name})")
                if conditions:
                    choices.append(f"if {names.condition} then {own} else {own}")
                yield own, choices
            case Continuous():
                pass
    if signals or any(isinstance(action.domain, Continuous) for action in actions):
        yield names.real, ["?c", names.signal] if signals else ["?c"]
    if signals:
        yield names.signal, signals
    if conditions:
        yield names.condition, conditions
    if sketch.interface.sensors:
        yield names.reading, [sensor.name for sensor in sketch.interface.sensors]


def _signals(sketch: Sketch, read: set[str], names: _Names) -> Iterator[str]:
    """The reals that are not constants; none if there is nothing to read."""
    interface = sketch.interface
    continuous = [a for a in interface.actions if isinstance(a.domain, Continuous)]
    previous = [f"previous({action.name})" for action in continuous if action.name in read]
    if not interface.sensors and not previous:
        return
    if interface.sensors:
        for index in range(1, interface.window + 1):
            yield f"peek({names.reading}, -{index})"
        if interface.window > 1:
            yield from (f"fold({operator.value}, {names.reading})" for operator in FOLDABLE)
    yield from previous
    yield from names.put_in(_OPERATIONS)


def _conditions(
    actions: tuple[ActionSpec, ...], read: set[str], names: _Names, signals: list[str]
) -> Iterator[str]:
    compared = [
        f"previous({action.name}) == {value}"
        for action in actions
        if isinstance(action.domain, Choice) and action.name in read
        for value in action.domain.values
    ]
    if signals:
        compared += names.put_in(_COMPARISONS)
    if compared:
        yield from (*compared, *names.put_in(_JUNCTIONS))


def _names(sketch: Sketch) -> _Names:
    """Names that the sketch has for nothing else."""
    interface = sketch.interface
    declared = (*interface.sensors, *interface.actions, *sketch.parameters, *sketch.properties)
    taken = {interface.name, *(each.name for each in declared)}
    taken.update(name for property_ in sketch.properties for name in bound(property_.body))

    def new(wish: str) -> str:
        name, number = wish, 2
        while name in taken:
            name, number = f"{wish}_{number}", number + 1
        taken.add(name)
        return name

    real, signal, condition, reading = map(new, ("Real", "Signal", "Condition", "Reading"))
    discrete = [a.name for a in interface.actions if isinstance(a.domain, Choice)]
    return _Names(real, signal, condition, reading, {name: new("Value") for name in discrete})


def _everything(sketch: Sketch) -> Iterator[Term]:
    """All terms of the sketch but those of its properties."""
    for root in (*sketch.bodies, *(a for rule in sketch.rules for a in rule.alternatives)):
        yield from subterms(root)


def _previous_read(sketch: Sketch) -> set[str]:
    return {t.action for t in _everything(sketch) if isinstance(t, PreviousAction)}


def _parameters_of_properties(sketch: Sketch) -> list[Parameter]:
    """The parameters that properties mention, for which they must be declared."""
    mentioned = {
        sub.name
        for property_ in sketch.properties
        for sub in subterms(property_.body)
        if isinstance(sub, ParameterRef)
    }
    return [parameter for parameter in sketch.parameters if parameter.name in mentioned]


def _with_safe_value(action: ActionSpec) -> ActionSpec:
    """The action with the safe value that it has in any case, since programs may divide."""
    match action.domain:
        case Continuous():
            return replace(action, domain=replace(action.domain, safe=action.safe))
        case Choice():
            return action
