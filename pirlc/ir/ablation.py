"""A sketch without its branches: the paper's NoIF.

Goals: of the programs that a sketch allows exactly those without an `if` are left. Non-goals:
other ways to branch (`min`, `max`, `abs` and `clip` are arithmetic here), saying what is wrong
with a sketch of which nothing is left (see `frontend.ablations`).
"""

from __future__ import annotations

from dataclasses import replace

from pirlc.ir.expansion import calls
from pirlc.ir.policy import ActionSpec, Rule, Sketch
from pirlc.ir.terms import If, Term, subterms


def branches(term: Term) -> bool:
    """Whether a term has an `if` of its own, apart from the rules that it calls."""
    return any(isinstance(sub, If) for sub in subterms(term))


def has_branches(sketch: Sketch) -> bool:
    """Whether some program of the sketch may have an `if`."""
    alternatives = (a for rule in sketch.rules for a in rule.alternatives)
    return any(map(branches, (*sketch.bodies, *alternatives)))


def bound_to_branch(sketch: Sketch) -> tuple[ActionSpec, ...]:
    """The actions that every program of the sketch computes with an `if`."""
    left = _left(sketch)
    pairs = zip(sketch.interface.actions, sketch.bodies, strict=True)
    return tuple(action for action, body in pairs if not _possible(body, left))


def without_branches(sketch: Sketch) -> Sketch:
    """The sketch without the alternatives that need an `if`, and without rules that go unused.

    No action may be one of `bound_to_branch`.
    """
    left = _left(sketch)
    rules = {
        rule.key: replace(
            rule, alternatives=tuple(a for a in rule.alternatives if _possible(a, left))
        )
        for rule in sketch.rules
        if rule.key in left
    }
    used = _reached(sketch.bodies, rules)
    return replace(sketch, rules=tuple(rule for key, rule in rules.items() if key in used))


def _possible(term: Term, left: set[str]) -> bool:
    return not branches(term) and all(call.rule in left for call in calls(term))


def _left(sketch: Sketch) -> set[str]:
    """The rules that allow something without an `if` and without end."""
    left: set[str] = set()
    while True:
        new = {
            rule.key
            for rule in sketch.rules
            if rule.key not in left and any(_possible(a, left) for a in rule.alternatives)
        }
        if not new:
            return left
        left |= new


def _reached(bodies: tuple[Term, ...], rules: dict[str, Rule]) -> set[str]:
    """The rules that the bodies lead to."""
    reached: set[str] = set()
    waiting = list(bodies)
    while waiting:
        for call in calls(waiting.pop()):
            if call.rule not in reached:
                reached.add(call.rule)
                waiting.extend(rules[call.rule].alternatives)
    return reached
