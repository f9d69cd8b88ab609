"""From a sketch and a derivation to a program template.

Goals: rule calls replaced by the chosen alternatives, holes by named parameters, without capture:
arguments and `let` values are evaluated in the scope that writes them, and shared by their uses.
Non-goals: choosing (see `search.enumeration`), simplifying.

A rule's argument that is a single name or number takes the place of its uses; any other is bound
by a `let`, so that it is chosen and computed once.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import assert_never

from pirlc.ir.policy import FreeParameter, Parameter, Program, ProgramTemplate, Sketch
from pirlc.ir.terms import (
    ActionRef,
    Apply,
    Diff,
    DiscreteLiteral,
    Fold,
    FoldLambda,
    Hole,
    If,
    Let,
    Literal,
    LocalRef,
    ParameterRef,
    Peek,
    PreviousAction,
    RuleCall,
    SensorRef,
    Term,
    bound,
    subterms,
    type_of,
)
from pirlc.ir.types import Real


@dataclass(frozen=True, slots=True)
class Derivation:
    """The alternative chosen for a rule call, and the derivations of the calls it contains.

    Calls are in the order of the text, a call before the calls in its own arguments. For an
    action's body, which has no alternatives, `alternative` is 0.
    """

    alternative: int
    children: tuple[Derivation, ...] = ()


@dataclass(frozen=True, slots=True)
class Origin:
    """Where a parameter of a template comes from: the hole's name, and the expansion that wrote it.

    `path` leads from the action's number through the children of derivations.
    """

    path: tuple[int, ...]
    hole: str


@dataclass(frozen=True)
class Expansion:
    """A program template with the derivations that made it.

    `origins` has an entry for each parameter that was a hole.
    """

    template: ProgramTemplate
    derivations: tuple[Derivation, ...]
    origins: tuple[tuple[str, Origin], ...]


def calls(term: Term) -> tuple[RuleCall, ...]:
    """The rule calls in a term, in the order in which a derivation lists their choices."""
    return tuple(sub for sub in subterms(term) if isinstance(sub, RuleCall))


def expand(sketch: Sketch, derivations: tuple[Derivation, ...]) -> Expansion:
    """The program template that the choices give: one derivation an action."""
    names = _Names(sketch)
    bodies = []
    for number, (spec, body, derivation) in enumerate(
        zip(sketch.interface.actions, sketch.bodies, derivations, strict=True)
    ):
        names.start_action(spec.name)
        scope = _Scope((number,), {})
        bodies.append(_expand(sketch, names, body, iter(enumerate(derivation.children)), scope))
    mentioned = {
        sub.name
        for term in (*bodies, *(p.body for p in sketch.properties))
        for sub in subterms(term)
        if isinstance(sub, ParameterRef)
    }
    kept = tuple(
        p for p in sketch.parameters if not isinstance(p, FreeParameter) or p.name in mentioned
    )
    # Holes in an argument that its rule does not use are gone from the bodies.
    found = tuple(p for p in names.parameters if p.name in mentioned)
    template = ProgramTemplate(sketch.interface, kept + found, tuple(bodies), sketch.properties)
    origins = tuple((name, origin) for name, origin in names.origins if name in mentioned)
    return Expansion(template, derivations, origins)


def only_derivation(sketch: Sketch) -> tuple[Derivation, ...] | None:
    """The derivations of a sketch with no choice of rule left; None where a choice is open."""

    def choose(term: Term, open_rules: frozenset[str]) -> tuple[Derivation, ...] | None:
        chosen = []
        for call in calls(term):
            rule = sketch.rule(call.rule)
            if len(rule.alternatives) != 1 or call.rule in open_rules:
                return None
            below = choose(rule.alternatives[0], open_rules | {call.rule})
            if below is None:
                return None
            chosen.append(Derivation(0, below))
        return tuple(chosen)

    bodies = [choose(body, frozenset()) for body in sketch.bodies]
    if any(body is None for body in bodies):
        return None
    return tuple(Derivation(0, body) for body in bodies if body is not None)


def close(sketch: Sketch) -> Program | None:
    """The program that a sketch with nothing left to choose is; None where something is open."""
    derivations = only_derivation(sketch)
    if derivations is None:
        return None
    template = expand(sketch, derivations).template
    return None if template.free else template.close({})


NAME_LIMIT = 64
"""The most characters of a name that the language reads back."""


class _Names:
    """Hands out names that are unique in the policy, in the order of first use.

    They also keep clear of the local names of properties, which may not hide a parameter.
    """

    def __init__(self, sketch: Sketch) -> None:
        interface = sketch.interface
        self.parameters: list[Parameter] = []
        self.origins: list[tuple[str, Origin]] = []
        self._holes: dict[tuple[tuple[int, ...], str], str] = {}
        self._action = ""
        self._locals: set[str] = set()
        self._all_locals: set[str] = set()
        self._global = {
            interface.name,
            *(s.name for s in interface.sensors),
            *(a.name for a in interface.actions),
            *(p.name for p in sketch.parameters),
            *(r.name for r in sketch.rules),
            *(name for p in sketch.properties for name in bound(p.body)),
        }

    def start_action(self, name: str) -> None:
        self._action = name
        self._locals = set()

    def local(self, wish: str) -> str:
        name = _unused(wish, self._global, self._locals)
        self._locals.add(name)
        self._all_locals.add(name)
        return name

    def parameter(self, hole: Hole, path: tuple[int, ...]) -> str:
        key = (path, hole.name)
        if key not in self._holes:
            # Of a long name the hole's part says more than the action's.
            action = self._action[: max(1, NAME_LIMIT - 1 - len(hole.name))]
            wish = f"{action}_{hole.name}"[:NAME_LIMIT]
            name = _unused(wish, self._global, self._all_locals)
            self._global.add(name)
            self._holes[key] = name
            self.parameters.append(FreeParameter(name, hole.lower, hole.upper, hole.guess))
            self.origins.append((name, Origin(path, hole.name)))
        return self._holes[key]


def _unused(wish: str, taken: set[str], too: set[str]) -> str:
    if wish not in taken and wish not in too:
        return wish
    number = 2
    while (name := _numbered(wish, number)) in taken or name in too:
        number += 1
    return name


def _numbered(wish: str, number: int) -> str:
    suffix = f"_{number}"
    return wish[: NAME_LIMIT - len(suffix)] + suffix


@dataclass(frozen=True)
class _Scope:
    """An expansion: its place in the derivation, and what its local names stand for."""

    path: tuple[int, ...]
    locals: dict[str, Term]

    def bind(self, name: str, meaning: Term) -> _Scope:
        return replace(self, locals={**self.locals, name: meaning})


_Choices = Iterator[tuple[int, Derivation]]


def _expand(sketch: Sketch, names: _Names, term: Term, choices: _Choices, scope: _Scope) -> Term:
    def go(sub: Term, inner: _Scope = scope) -> Term:
        return _expand(sketch, names, sub, choices, inner)

    match term:
        case (
            Literal() | DiscreteLiteral() | ParameterRef() | SensorRef() | PreviousAction()
            | ActionRef()
        ):  # fmt: skip
            return term
        case LocalRef(name):
            return scope.locals[name]
        case Hole():
            return ParameterRef(names.parameter(term, scope.path), term.span)
        case Apply(_, arguments):
            return replace(term, arguments=tuple(go(a) for a in arguments))
        case Peek(sequence) | Fold(_, sequence) | Diff(sequence):
            return replace(term, sequence=go(sequence))
        case If(condition, consequent, alternative):
            new = go(condition), go(consequent), go(alternative)
            return replace(term, condition=new[0], consequent=new[1], alternative=new[2])
        case Let(name, value, body):
            new_value = go(value)
            fresh = names.local(name)
            inside = scope.bind(name, LocalRef(fresh, type_of(new_value)))
            return replace(term, name=fresh, value=new_value, body=go(body, inside))
        case FoldLambda(element, accumulator, body, sequence, initial):
            # The order of `children`, which is the order of the choices: body first.
            v, acc = names.local(element), names.local(accumulator)
            inside = scope.bind(element, LocalRef(v, Real()))
            inside = inside.bind(accumulator, LocalRef(acc, Real()))
            return FoldLambda(v, acc, go(body, inside), go(sequence), go(initial), term.span)
        case RuleCall(key, arguments):
            number, derivation = next(choices)
            rule = sketch.rule(key)
            chosen = rule.alternatives[derivation.alternative]
            used = {sub.name for sub in subterms(chosen) if isinstance(sub, LocalRef)}
            inside = _Scope((*scope.path, number), {})
            bound: list[tuple[str, Term]] = []
            for (parameter, type_), argument in zip(rule.parameters, arguments, strict=True):
                value = go(argument)
                if is_simple(value) or parameter not in used:
                    inside = inside.bind(parameter, value)
                else:
                    fresh = names.local(parameter)
                    bound.append((fresh, value))
                    inside = inside.bind(parameter, LocalRef(fresh, type_))
            below = iter(enumerate(derivation.children))
            result = _expand(sketch, names, chosen, below, inside)
            for fresh, value in reversed(bound):
                result = Let(fresh, value, result, term.span)
            return result
        case _:
            assert_never(term)


def is_simple(term: Term) -> bool:
    """A single name or number: copying it is as good as binding it."""
    return isinstance(term, Literal | DiscreteLiteral | ParameterRef | SensorRef | LocalRef)
