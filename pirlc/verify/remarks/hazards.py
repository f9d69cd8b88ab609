"""Divisions by zero, roots of negative numbers, overflow: reachable, or proved not to be."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction

import z3

from pirlc.ir.evidence import PROVED, REFUTED, Evidence, unknown
from pirlc.ir.operators import Operator
from pirlc.ir.policy import Choice, Continuous, Program
from pirlc.ir.printer import term_text
from pirlc.ir.terms import Apply, Term
from pirlc.semantics.precision import BINARY32, BINARY64, Precision
from pirlc.source import Span
from pirlc.symbolic import z3_terms as exact
from pirlc.symbolic.z3_form import Partial
from pirlc.symbolic.z3_terms import Truth
from pirlc.verify.bounds.actions import operations
from pirlc.verify.bounds.extremes import limited, trial_of, why
from pirlc.verify.findings import Matter, Remark, Replay
from pirlc.verify.model import Model, finite_range
from pirlc.verify.properties.asking import Limits
from pirlc.verify.remarks.occurrences import failing, occurrences
from pirlc.verify.replay import Trial, as_replay, run
from pirlc.verify.rounding import rounding

_TRIALS, _EFFORT = 200, 100_000
"""Histories to run at most, and operations in them."""


def hazards(program: Program, model: Model, action: str, limits: Limits) -> list[Remark]:
    """What one action's body may meet; `model` is of (at least) this action, over one step."""
    names = [spec.name for spec in program.interface.actions]
    nodes = occurrences(program.bodies[names.index(action)]).partials
    partials = model.steps[0].records[action].partials
    tried = _tried(program, action) if nodes else []
    found = [
        _partial(program, model, action, nodes[places[0]], places, partials, tried, limits)
        for places in same_place(nodes)
    ]
    spec = program.interface.actions[names.index(action)]
    if all(remark.clear for remark in found) and isinstance(spec.domain, Continuous):
        found.extend(_overflow(program, action))
    return found


_Tried = tuple[Trial, tuple[bool, ...]]
"""A history, and which divisions and roots fail on it."""


def _tried(program: Program, action: str) -> list[_Tried]:
    count = tries(program)
    return [(t, failing(program, action, t)) for t in some_trials(program, count)]


def tries(program: Program) -> int:
    """How many histories to run a program on."""
    return max(10, min(_TRIALS, _EFFORT // max(1, operations(program, 1))))


def _partial(
    program: Program,
    model: Model,
    action: str,
    node: Term,
    places: list[int],
    partials: tuple[Partial, ...],
    tried: Sequence[_Tried],
    limits: Limits,
) -> Remark:
    assert isinstance(node, Apply)
    divides = node.operator is Operator.DIVIDE
    matter = Matter.DIVISION if divides else Matter.SQUARE_ROOT
    argument = term_text(node.arguments[1 if divides else 0])
    what = "zero" if divides else "negative"
    evidence, trial = _reached(program, model, action, places, partials, tried, limits)
    if evidence.kind is PROVED.kind:
        text = f"`{argument}` is never {what}"
    elif trial is not None:
        text = f"`{argument}` can be {what}"
    else:
        text = f"`{argument}` may be {what}"
    witness = None if trial is None else as_replay(trial, run(program, trial))
    return Remark(matter, text, evidence, evidence == PROVED, node.span, witness=witness)


def _reached(
    program: Program,
    model: Model,
    action: str,
    places: list[int],
    partials: tuple[Partial, ...],
    tried: Sequence[_Tried],
    limits: Limits,
) -> tuple[Evidence, Trial | None]:
    """Proved: no history reaches it, of reals or of floats. Refuted: one that runs does."""
    over_reals = False
    doubt: Evidence | None = None
    for place in places:
        partial = partials[place]
        solver = limited(model, limits)
        solver.add(*_terms(model, partial.path, partial.defined, _fails(partial, Fraction(0))))
        match solver.check():
            case z3.unsat:
                continue
            case z3.sat:
                over_reals = True
                trial = completed(program, trial_of(model, solver.model()))
                if failing(program, action, trial)[place]:
                    return REFUTED, trial
            case _:
                doubt = unknown(why(solver))
    for trial, fails in tried:
        if any(fails[place] for place in places):
            return REFUTED, trial
    if over_reals:
        return unknown("reached over the reals; no history of floats was found"), None
    if doubt is not None:
        return doubt, None
    for precision in (BINARY64, BINARY32):
        off = rounding(program, precision).steps[0].partials[action]
        for place in places:
            error, partial = off[place], partials[place]
            near = None if error is None else _fails(partial, Fraction(error))
            if near is None or (error and _possible(model, partial, near, limits)):
                reason = f"excluded over the reals, but rounding in {precision.value} may reach it"
                return unknown(reason), None
    return PROVED, None


def _possible(model: Model, partial: Partial, near: Truth, limits: Limits) -> bool:
    solver = limited(model, limits)
    solver.add(*_terms(model, partial.path, partial.defined, near))
    return bool(solver.check() != z3.unsat)


def _fails(partial: Partial, error: Fraction) -> Truth:
    """The operation has no real result, if its argument is off by an error at most."""
    if partial.operator is Operator.DIVIDE:
        return exact.within(partial.argument, -error, error)
    return exact.less(partial.argument, error)


def _terms(model: Model, *truths: Truth) -> list[z3.ExprRef]:
    return [exact.as_term(truth, model.context) for truth in truths]


def _overflow(program: Program, action: str) -> Iterator[Remark]:
    """Range analysis proves that there is none; a history that shows it refutes that."""
    names = [spec.name for spec in program.interface.actions]
    span = program.bodies[names.index(action)].span
    unbounded = [p for p in Precision if rounding(program, p).steps[0].raw[action] is None]
    if not unbounded:
        text = f"nothing in {action} overflows, in binary64 or binary32"
        yield Remark(Matter.OVERFLOW, text, PROVED, True, span)
    for precision in unbounded:
        witness = _overflowing(program, action, precision)
        if witness is not None:
            text = f"raw({action}) can overflow in {precision.value}"
            yield Remark(Matter.OVERFLOW, text, REFUTED, False, span, witness=witness)
            return
    if unbounded:
        text = f"something in {action} may overflow in {unbounded[0].value}"
        yield Remark(
            Matter.OVERFLOW,
            text,
            unknown("its ranges reach beyond the largest number"),
            False,
            span,
        )


def _overflowing(program: Program, action: str, precision: Precision) -> Replay | None:
    for trial in some_trials(program, tries(program)):
        steps = run(program, trial, precision)
        if not math.isfinite(steps[-1].raw[action]):
            return as_replay(trial, steps)
    return None


def same_place(nodes: Sequence[Term]) -> list[list[int]]:
    """The occurrences of each node of the text, in its order."""
    groups: dict[tuple[Term, Span], list[int]] = {}
    for number, node in enumerate(nodes):
        groups.setdefault((node, node.span), []).append(number)
    return list(groups.values())


def completed(program: Program, trial: Trial) -> Trial:
    """A trial of a part of the program; other actions start from their safe values."""
    previous = {a.name: trial.previous.get(a.name, a.safe) for a in program.interface.actions}
    return replace(trial, previous=previous)


def some_trials(program: Program, count: int) -> Iterator[Trial]:
    """Histories of one step: corners of the ranges and zeros first, then anything in them."""
    rng = random.Random(0)
    interface = program.interface
    for number in range(count):
        corners = 1.0 if number < count // 2 else rng.random()
        readings = {}
        for sensor in interface.sensors:
            low, high = finite_range(sensor)
            ends = [low, high, *([0.0] if low <= 0.0 <= high else [])]
            still = number % 4 == 0
            values = [
                rng.choice(ends) if rng.random() < corners else rng.uniform(low, high)
                for _ in range(interface.window)
            ]
            readings[sensor.name] = tuple(values[:1] * len(values) if still else values)
        previous: dict[str, float] = {}
        for action in interface.actions:
            match action.domain:
                case Continuous(low, high):
                    x = rng.choice((low, high, action.safe, rng.uniform(low, high)))
                    previous[action.name] = min(max(x, low), high)
                case Choice(choices):
                    previous[action.name] = rng.choice(choices)
        yield Trial(readings, previous)
