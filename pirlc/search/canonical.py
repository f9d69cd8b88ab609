"""Which program templates are the same but for the order of arguments and the names of parameters.

A cheap, sound test on the text; templates that it cannot tell to be equal are compared by what
they compute (`search.observation`).
"""

from __future__ import annotations

from typing import assert_never

from pirlc.ir.operators import COMMUTATIVE, Operator
from pirlc.ir.policy import FreeParameter, ProgramTemplate
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
    children,
    subterms,
    with_children,
)

_MIRRORED = {Operator.GREATER: Operator.LESS, Operator.GREATER_EQUAL: Operator.LESS_EQUAL}


def canonical_order(template: ProgramTemplate) -> tuple[str, ...]:
    """The free parameters in the order in which the canonical form meets them."""
    bodies = [_sorted(body, _bounds(template)) for body in template.bodies]
    free = {p.name for p in template.free}
    met = (s.name for b in bodies for s in subterms(b) if isinstance(s, ParameterRef))
    return tuple(dict.fromkeys(name for name in met if name in free))


def canonical_form(template: ProgramTemplate) -> str:
    """Equal for templates that differ by commutation, mirrored comparisons and renaming only."""
    bounds = _bounds(template)
    bodies = [_sorted(body, bounds) for body in template.bodies]
    numbers = {name: f"?{i}{bounds[name]}" for i, name in enumerate(canonical_order(template))}
    return "; ".join(_text(body, numbers, _local_names(body)) for body in bodies)


def _local_names(body: Term) -> dict[str, str]:
    """Numbers for an action's local names, which are unique in the action, in order."""
    found: dict[str, str] = {}
    for sub in subterms(body):
        match sub:
            case Let(name):
                found.setdefault(name, f"x{len(found)}")
            case FoldLambda(element, accumulator):
                found.setdefault(element, f"x{len(found)}")
                found.setdefault(accumulator, f"x{len(found)}")
            case _:
                pass
    return found


def _bounds(template: ProgramTemplate) -> dict[str, str]:
    return {
        p.name: f"[{p.lower!r},{p.upper!r}]" if isinstance(p, FreeParameter) else f"={p.value!r}"
        for p in template.parameters
    }


def _sorted(term: Term, bounds: dict[str, str]) -> Term:
    """Arguments of commutative operators in the order of their anonymous texts."""
    new = tuple(_sorted(child, bounds) for child in children(term))
    term = with_children(term, new) if new else term
    match term:
        case Apply(operator, (left, right)) if operator in _MIRRORED:
            return Apply(_MIRRORED[operator], (right, left))
        case Apply(operator, (left, right)) if operator in COMMUTATIVE:
            ordered = sorted((left, right), key=lambda t: _text(t, bounds, {}, anonymous=True))
            return Apply(operator, tuple(ordered))
        case _:
            return term


def _text(
    term: Term, parameters: dict[str, str], local_names: dict[str, str], *, anonymous: bool = False
) -> str:
    def go(sub: Term) -> str:
        return _text(sub, parameters, local_names, anonymous=anonymous)

    match term:
        case Literal(value):
            return repr(value)
        case DiscreteLiteral(value):
            return f"#{value}"
        case ParameterRef(name):
            return parameters.get(name, f"p:{name}")
        case SensorRef(name):
            return f"s:{name}"
        case LocalRef(name):
            return "x" if anonymous else local_names.get(name, name)
        case PreviousAction(action):
            return f"previous:{action}"
        case ActionRef(action, raw):
            return f"{'raw' if raw else 'act'}:{action}"
        case Apply(operator, arguments):
            return f"({operator.value} {' '.join(map(go, arguments))})"
        case Peek(sequence, index):
            return f"(peek {go(sequence)} {index})"
        case Fold(operator, sequence):
            return f"(fold {operator.value} {go(sequence)})"
        case FoldLambda(_, _, body, sequence, initial):
            return f"(fold {go(body)} {go(sequence)} {go(initial)})"
        case Diff(sequence):
            return f"(diff {go(sequence)})"
        case If(condition, consequent, alternative):
            return f"(if {go(condition)} {go(consequent)} {go(alternative)})"
        case Let(_, value, body):
            return f"(let {go(value)} {go(body)})"
        case Hole() | RuleCall():
            raise AssertionError("a program template has no open choices")
        case _:
            assert_never(term)
