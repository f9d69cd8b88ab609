"""Which program templates are the same but for the order of arguments and the names of parameters.

A cheap, sound test on the text; templates that it cannot tell to be equal are compared by what
they compute (`search.observation`).
"""

from __future__ import annotations

from dataclasses import replace
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
    return _order(template, _bodies(template, _bounds(template)))


def canonical_form(template: ProgramTemplate) -> str:
    """Equal for templates that differ by commutation, mirrored comparisons and renaming only."""
    bounds = _bounds(template)
    bodies = _bodies(template, bounds)
    numbers = {name: f"?{i}{bounds[name]}" for i, name in enumerate(_order(template, bodies))}
    return "; ".join(_text(body, numbers, _local_names(body)) for body in bodies)


def _bodies(template: ProgramTemplate, bounds: dict[str, str]) -> list[Term]:
    return [_sorted(body, bounds)[0] for body in template.bodies]


def _order(template: ProgramTemplate, bodies: list[Term]) -> tuple[str, ...]:
    free = {p.name for p in template.free}
    met = (s.name for b in bodies for s in subterms(b) if isinstance(s, ParameterRef))
    return tuple(dict.fromkeys(name for name in met if name in free))


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


def _sorted(term: Term, bounds: dict[str, str]) -> tuple[Term, str]:
    """Arguments of commutative operators in the order of their anonymous texts; and that text.

    Each text is put together from those below it, once: a sum may be long.
    """
    below = [_sorted(child, bounds) for child in children(term)]
    match term:
        case Apply(operator) if operator in _MIRRORED:
            term = replace(term, operator=_MIRRORED[operator])
            below.reverse()
        case Apply(operator) if operator in COMMUTATIVE:
            below.sort(key=lambda child: child[1])
        case _:
            pass
    if below:
        term = with_children(term, tuple(child for child, _ in below))
    return term, _written(term, [text for _, text in below], bounds, None)


def _text(term: Term, parameters: dict[str, str], local_names: dict[str, str]) -> str:
    below = [_text(child, parameters, local_names) for child in children(term)]
    return _written(term, below, parameters, local_names)


def _written(
    term: Term, below: list[str], parameters: dict[str, str], local_names: dict[str, str] | None
) -> str:
    """A node with the texts of its children; without `local_names` anonymous."""
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
            return "x" if local_names is None else local_names.get(name, name)
        case PreviousAction(action):
            return f"previous:{action}"
        case ActionRef(action, raw):
            return f"{'raw' if raw else 'act'}:{action}"
        case Apply(operator):
            return f"({operator.value} {' '.join(below)})"
        case Peek(_, index):
            return f"(peek {below[0]} {index})"
        case Fold(operator):
            return f"(fold {operator.value} {below[0]})"
        case FoldLambda():
            return f"(fold {' '.join(below)})"
        case Diff():
            return f"(diff {below[0]})"
        case If():
            return f"(if {' '.join(below)})"
        case Let():
            return f"(let {' '.join(below)})"
        case Hole() | RuleCall():
            raise AssertionError("a program template has no open choices")
        case _:
            assert_never(term)
