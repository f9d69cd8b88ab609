"""The declarations of a file: everything but the expressions.

Goals: the interface, the parameters and the scope, with every number and every name judged; as
many problems in one run as can be told apart. Non-goal: looking into expressions.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeVar

from pirlc.diagnostics import suggestion
from pirlc.frontend import problems_names as problems
from pirlc.frontend import syntax
from pirlc.frontend.problems import Collector
from pirlc.frontend.problems_sketch import SameComponent
from pirlc.frontend.scope import FUNCTIONS, Scope
from pirlc.ir import policy
from pirlc.source import Span

NAME_LIMIT = 64
WINDOW_LIMIT = 10_000
INDEX_LIMIT = 1_000_000
DISCRETE_LIMIT = 2**31 - 1

_D = TypeVar("_D", bound=syntax.Declaration)
_T = TypeVar("_T")


@dataclass(frozen=True)
class Declared:
    """The declarations, and each action's body (None where it has none)."""

    interface: policy.Interface
    parameters: tuple[policy.Parameter, ...]
    bodies: tuple[syntax.Expression | None, ...]
    properties: tuple[syntax.Property, ...]
    scope: Scope


def declare(tree: syntax.SyntaxTree, end: Span, collector: Collector) -> Declared:
    """Judge the declarations of `tree`; `end` is the place just before the end of the file."""
    name = _single(tree, syntax.Policy, "policy", collector)
    if name is None:
        collector.add(problems.MissingDeclaration(end, "policy"))
    else:
        check_name(name.name, collector)
    _check_names(tree, collector)
    sensors = tuple(_sensor(d, collector) for d in _all(tree, syntax.Sensor))
    actions: list[policy.ActionSpec] = []
    bodies: list[syntax.Expression | None] = []
    for position, declaration in enumerate(_all(tree, syntax.Action)):
        action, body = _action(declaration, position, collector)
        actions.append(action)
        bodies.append(body)
    if not actions:
        collector.add(problems.MissingDeclaration(end, "action"))
    _check_components(actions, collector)
    parameters = tuple(_parameter(d, collector) for d in _all(tree, syntax.Parameter))
    environment = _single(tree, syntax.Environment, "environment", collector)
    sample_time = _setting(tree, "sample_time", collector)
    if sample_time is not None and not sample_time.value > 0:
        collector.add(
            problems.OutOfLimits(
                sample_time.span, "the sample time", sample_time.text, "seconds greater than 0"
            )
        )
    window = _steps(tree, "window", 1, 1, collector)
    interface = policy.Interface(
        name=name.name.text if name else "",
        environment=_environment(environment, collector) if environment else None,
        sensors=sensors,
        actions=tuple(actions),
        window=window,
        sample_time=sample_time.value if sample_time else None,
        latency=_steps(tree, "latency", 0, 0, collector),
        fill=_fill(_single(tree, syntax.Fill, "fill", collector), collector),
    )
    scope = Scope(
        sensors=_first_of_each((sensor.name, sensor) for sensor in sensors),
        actions=_first_of_each((action.name, action) for action in actions),
        parameters=_first_of_each((parameter.name, parameter) for parameter in parameters),
        rules=_first_of_each((rule.name.text, rule) for rule in _all(tree, syntax.Rule)),
        window=window,
        spans=_first_of_each((name.text, name.span) for name in _declared_names(tree)),
    )
    return Declared(interface, parameters, tuple(bodies), tuple(_all(tree, syntax.Property)), scope)


def check_name(name: syntax.Name, collector: Collector) -> None:
    """A name that a file introduces: ASCII, not too long, not a built-in function's."""
    text = name.text
    if not text.isascii() or text.startswith("_"):
        collector.add(problems.BadIdentifier(name.span, text))
    elif len(text) > NAME_LIMIT:
        collector.add(problems.NameTooLong(name.span, text, NAME_LIMIT))
    elif text in FUNCTIONS:
        collector.add(problems.ReservedName(name.span, text))


def whole(number: syntax.Number, what: str, collector: Collector) -> int | None:
    """The value of a number that must be whole."""
    value = number.integer
    if value is None:
        collector.add(problems.NotWhole(number.span, what, number.text))
    return value


def limited(
    number: syntax.Number, what: str, lower: int, upper: int, collector: Collector
) -> int | None:
    """The value of a whole number that must lie in [lower, upper]."""
    value = whole(number, what, collector)
    if value is not None and not lower <= value <= upper:
        allowed = f"a whole number from {lower} to {upper}"
        collector.add(problems.OutOfLimits(number.span, what, number.text, allowed))
        return None
    return value


def bounds(range_: syntax.Range, *, point: bool, collector: Collector) -> tuple[float, float]:
    """The two numbers of a range; `point` is whether they may be equal."""
    lower, upper = range_.lower.value, range_.upper.value
    if lower > upper or (lower == upper and not point):
        collector.add(problems.EmptyRange(range_.span, range_.lower.text, range_.upper.text, point))
    return lower, upper


def check_guess(
    name: str,
    guess: syntax.Number | None,
    range_: syntax.Range | None,
    collector: Collector,
) -> None:
    """A guess must lie in the bounds it is given for (or in the default ones)."""
    if guess is None:
        return
    if range_ is None:
        (lower, upper), place = policy.DEFAULT_BOUNDS, guess.span
        text = f"[{lower:g}, {upper:g}]"
    else:
        lower, upper, place = range_.lower.value, range_.upper.value, range_.span
        text = f"[{range_.lower.text}, {range_.upper.text}]"
    if lower <= upper and not lower <= guess.value <= upper:
        collector.add(problems.GuessOutside(guess.span, name, guess.text, text, place))


def _first_of_each(pairs: Iterable[tuple[str, _T]]) -> dict[str, _T]:
    """By name, in the order of the file; of a name declared twice, the first."""
    found: dict[str, _T] = {}
    for name, value in pairs:
        found.setdefault(name, value)
    return found


def _all(tree: syntax.SyntaxTree, kind: type[_D]) -> list[_D]:
    return [declaration for declaration in tree.declarations if isinstance(declaration, kind)]


def _single(
    tree: syntax.SyntaxTree, kind: type[_D], keyword: str, collector: Collector
) -> _D | None:
    return _first(_all(tree, kind), keyword, collector)


def _first(declarations: list[_D], keyword: str, collector: Collector) -> _D | None:
    for repeated in declarations[1:]:
        collector.add(problems.RepeatedDeclaration(repeated.span, keyword, declarations[0].span))
    return declarations[0] if declarations else None


def _setting(tree: syntax.SyntaxTree, keyword: str, collector: Collector) -> syntax.Number | None:
    settings = [d for d in _all(tree, syntax.Setting) if d.keyword == keyword]
    first = _first(settings, keyword, collector)
    return first.value if first else None


def _steps(
    tree: syntax.SyntaxTree, keyword: str, default: int, lower: int, collector: Collector
) -> int:
    number = _setting(tree, keyword, collector)
    if number is None:
        return default
    value = limited(number, f"the {keyword}", lower, WINDOW_LIMIT, collector)
    return default if value is None else value


def _declared_names(tree: syntax.SyntaxTree) -> list[syntax.Name]:
    kinds = (syntax.Sensor, syntax.Action, syntax.Parameter, syntax.Rule)
    return [d.name for d in tree.declarations if isinstance(d, kinds)]


def _check_names(tree: syntax.SyntaxTree, collector: Collector) -> None:
    declared = _declared_names(tree)
    properties = [d.name for d in _all(tree, syntax.Property)]
    for names in (declared, properties):
        first: dict[str, Span] = {}
        for name in names:
            check_name(name, collector)
            if name.text in first:
                collector.add(problems.DuplicateName(name.span, name.text, first[name.text]))
            first.setdefault(name.text, name.span)


def _environment(declaration: syntax.Environment, collector: Collector) -> policy.Environment:
    first: dict[str, Span] = {}
    arguments: list[tuple[str, policy.Scalar]] = []
    for argument in declaration.arguments:
        name = argument.name
        if not name.text.isascii():
            collector.add(problems.BadIdentifier(name.span, name.text))
        elif len(name.text) > NAME_LIMIT:
            collector.add(problems.NameTooLong(name.span, name.text, NAME_LIMIT))
        if name.text in first:
            collector.add(problems.DuplicateName(name.span, name.text, first[name.text]))
        first.setdefault(name.text, name.span)
        value: policy.Scalar
        match argument.value:
            case syntax.Number() as number:
                integer = number.integer
                value = number.value if integer is None else integer
            case syntax.Text(value=text):
                value = text
            case syntax.Truth(value=truth):
                value = truth
        arguments.append((name.text, value))
    return policy.Environment(declaration.id.value, tuple(arguments), declaration.span)


def _sensor(declaration: syntax.Sensor, collector: Collector) -> policy.Sensor:
    lower, upper = bounds(declaration.range, point=False, collector=collector)
    index = limited(declaration.index, "a sensor's index", 0, INDEX_LIMIT, collector)
    missing: policy.MissingPolicy = policy.Hold()
    if declaration.missing is not None:
        missing = _missing(declaration.missing, collector)
    return policy.Sensor(
        declaration.name.text, lower, upper, index or 0, missing, declaration.name.span
    )


def _missing(missing: syntax.Missing, collector: Collector) -> policy.MissingPolicy:
    word, limit, finally_ = missing.word, missing.limit, missing.finally_
    known = ("hold", "zero", "fail") if limit is None else ("hold",)
    if word.text not in known:
        _unknown_word("missing", word, known, collector)
    if limit is not None and finally_ is not None:
        if finally_.text != "fail":
            _unknown_word("then", finally_, ("fail",), collector)
            return policy.Hold()
        return policy.Hold(limited(limit, "the staleness limit", 0, INDEX_LIMIT, collector) or 0)
    if word.text == "zero":
        return policy.Zero()
    return policy.Hold(0 if word.text == "fail" else None)


def _fill(declaration: syntax.Fill | None, collector: Collector) -> policy.Fill:
    if declaration is None or declaration.word.text == "first":
        return policy.Fill.FIRST
    if declaration.word.text != "zero":
        _unknown_word("fill", declaration.word, ("first", "zero"), collector)
    return policy.Fill.ZERO


def _unknown_word(
    keyword: str, word: syntax.Name, known: tuple[str, ...], collector: Collector
) -> None:
    close = suggestion(word.text, known)
    collector.add(problems.UnknownWord(word.span, keyword, word.text, known, close))


def _parameter(declaration: syntax.Parameter, collector: Collector) -> policy.Parameter:
    name, number = declaration.name, declaration.number
    if declaration.bounds is None:
        assert number is not None
        return policy.FixedParameter(name.text, number.value, name.span)
    lower, upper = bounds(declaration.bounds, point=True, collector=collector)
    check_guess(name.text, number, declaration.bounds, collector)
    guess = number.value if number else None
    return policy.FreeParameter(name.text, lower, upper, guess, name.span)


def _action(
    declaration: syntax.Action, position: int, collector: Collector
) -> tuple[policy.ActionSpec, syntax.Expression | None]:
    name = declaration.name
    domain = _domain(declaration, collector)
    component = position
    body: syntax.Expression | None = None

    def misshapen(span: Span, reason: str) -> None:
        collector.add(problems.MisshapenAction(span, name.text, reason))

    if len(declaration.safe) > 1:
        misshapen(declaration.safe[1].span, "it has a `safe` value already")
    match declaration.equals:
        case (single,):
            body = single
        case (syntax.Number() as index, body):
            given = limited(index, "an action's component", 0, INDEX_LIMIT, collector)
            component = position if given is None else given
        case (other, body):
            misshapen(other.span, "the component after the first `=` must be a whole number")
        case ():
            misshapen(name.span, "it lacks `=` and the expression that computes it")
        case (_, _, third, *_):
            misshapen(third.span, "there are more than two `=`")
    return policy.ActionSpec(name.text, domain, component, name.span), body


def _domain(declaration: syntax.Action, collector: Collector) -> policy.Continuous | policy.Choice:
    safe = declaration.safe[0] if declaration.safe else None
    inside = True
    domain: policy.Continuous | policy.Choice
    match declaration.domain:
        case syntax.Range() as range_:
            lower, upper = bounds(range_, point=False, collector=collector)
            inside = safe is None or not lower < upper or lower <= safe.value <= upper
            text = f"[{range_.lower.text}, {range_.upper.text}]"
            domain = policy.Continuous(lower, upper, safe.value if safe else None)
        case syntax.Choice() as choice:
            values = _choice_values(choice, collector)
            chosen = whole(safe, "the safe value of a discrete action", collector) if safe else None
            inside = chosen is None or chosen in values
            text = "{" + ", ".join(map(str, values)) + "}"
            domain = policy.Choice(values, chosen)
    if safe is not None and not inside:
        collector.add(
            problems.SafeOutside(
                safe.span, declaration.name.text, safe.text, text, declaration.domain.span
            )
        )
    return domain


def _choice_values(choice: syntax.Choice, collector: Collector) -> tuple[int, ...]:
    first: dict[int, Span] = {}
    for number in choice.values:
        value = limited(
            number, "a discrete action's value", -DISCRETE_LIMIT, DISCRETE_LIMIT, collector
        )
        if value is None:
            continue
        if value in first:
            collector.add(problems.RepeatedValue(number.span, number.text, first[value]))
        first.setdefault(value, number.span)
    # A value that a diagnostic rejected must not leave the domain empty.
    return tuple(first) or (0,)


def _check_components(actions: list[policy.ActionSpec], collector: Collector) -> None:
    first: dict[int, policy.ActionSpec] = {}
    for action in actions:
        if action.component in first:
            other = first[action.component]
            collector.add(SameComponent(action.span, action.component, other.span, other.name))
        first.setdefault(action.component, action)
