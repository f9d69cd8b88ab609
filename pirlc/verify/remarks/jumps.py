"""The largest jump of an action where a guard turns.

On the boundary of a guard its two sides are equal, and readings as close as one likes make it hold
or fail. The jump there is the distance of the action's raw values with the guard held either way,
all else being equal; its supremum over all histories on the boundary is found as bounds are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

import z3

from pirlc.ir.evidence import PROVED, Kind, unknown
from pirlc.ir.operators import Operator
from pirlc.ir.policy import Program
from pirlc.ir.printer import term_text
from pirlc.ir.terms import Term
from pirlc.source import Span
from pirlc.symbolic import z3_terms as exact
from pirlc.symbolic.z3_form import BodyForm, Form, Guard, GuardKey, Inputs
from pirlc.verify.bounds.actions import operations
from pirlc.verify.bounds.extremes import Supremum, limited, supremum
from pirlc.verify.exact import exact_step
from pirlc.verify.findings import Extreme, Matter, Remark
from pirlc.verify.model import Model
from pirlc.verify.properties.asking import Limits
from pirlc.verify.properties.deciding import LARGEST
from pirlc.verify.remarks.hazards import completed
from pirlc.verify.remarks.occurrences import occurrences
from pirlc.verify.replay import Trial, as_replay, run


@dataclass(frozen=True)
class Jump:
    """At one guard, named by its text."""

    guard: str
    span: Span
    found: Supremum


def jump(program: Program, model: Model, action: str, limits: Limits) -> Iterator[Remark]:
    """One remark about a continuous action with guards; `model` is of it, over one step."""
    records = model.steps[0].records[action]
    reason = ""
    if len(records.guards) * operations(model.program, 1) > LARGEST:
        reason = "too many guards"
    if model.functions.nonlinear or model.functions.axioms:
        reason = "the action is not piecewise linear"
    if reason and records.guards:
        text = f"how far raw({action}) jumps where its guards turn is not known"
        yield Remark(Matter.JUMP, text, unknown(reason), False, _body(model, action).span)
        return
    jumps = list(_jumps(model, action, limits))
    if not jumps:
        return
    undecided = [j for j in jumps if j.found.evidence.kind is not Kind.PROVED]
    decided = [j for j in jumps if j.found.evidence.kind is Kind.PROVED]
    largest = max(decided, key=_size, default=None)
    if undecided:
        first = undecided[0]
        text = f"how far raw({action}) jumps where `{first.guard}` turns is not known"
        evidence = first.found.evidence
        yield Remark(Matter.JUMP, text, evidence, False, first.span)
    if largest is None:
        return
    found = largest.found
    if not found.value:
        if not undecided:
            text = f"{action} does not jump where a guard turns"
            size = Extreme(Fraction(0), True, PROVED)
            yield Remark(Matter.JUMP, text, PROVED, True, largest.span, size)
        return
    witness = None
    if found.trial is not None:
        trial = completed(program, found.trial)
        witness = as_replay(trial, run(program, trial))
    size = Extreme(found.value, found.attained, found.evidence, witness)
    text = f"raw({action}) jumps by up to {float(found.value):.9g} where `{largest.guard}` turns"
    yield Remark(Matter.JUMP, text, found.evidence, False, largest.span, size, witness)


def _size(jump: Jump) -> tuple[Fraction, bool]:
    return jump.found.value or Fraction(0), jump.found.attained


def _jumps(model: Model, action: str, limits: Limits) -> Iterator[Jump]:
    nodes = occurrences(_body(model, action)).guards
    inputs = Inputs(
        {name: Fraction(value) for name, value in model.program.values.items()},
        lambda sensor, index: model.window(sensor, 0)[index],
        model.previous,
    )
    for guard in model.steps[0].records[action].guards:
        boundary = exact.equal(guard.a, guard.b)
        if guard.discrete or guard.key is None or isinstance(boundary, bool):
            continue
        node = nodes[guard.key.occurrence]
        form, free = _held(model, action, inputs, guard.key)
        if not isinstance(form.value, z3.ExprRef):
            continue
        sides = [
            z3.simplify(z3.substitute(form.value, (free, side)), som=False)
            for side in _either_way(model, guard)
        ]
        if sides[0].eq(sides[1]):
            continue
        found = _largest(model, guard, guard.key, sides, boundary, limits)
        yield Jump(term_text(node), node.span, found)


def _held(model: Model, action: str, inputs: Inputs, key: GuardKey) -> tuple[Form, z3.ExprRef]:
    """The action's form with a guard's answer left free, and that."""
    form = BodyForm(action, inputs, model.functions, lambda k: None if k == key else Fraction(0))
    return form.run(_body(model, action)), form.free[0]


def _body(model: Model, action: str) -> Term:
    names = [spec.name for spec in model.program.interface.actions]
    return model.program.bodies[names.index(action)]


def _either_way(model: Model, guard: Guard) -> tuple[z3.ExprRef, z3.ExprRef]:
    if guard.relation is None:
        return z3.RealVal(1, model.context), z3.RealVal(-1, model.context)
    return z3.BoolVal(True, model.context), z3.BoolVal(False, model.context)


def _largest(
    model: Model,
    guard: Guard,
    key: GuardKey,
    sides: list[z3.ExprRef],
    boundary: z3.ExprRef,
    limits: Limits,
) -> Supremum:
    held = (1, -1) if guard.relation is None else (1, 0)
    part = model.program

    def measure(trial: Trial) -> Fraction:
        values = [
            exact_step(part, trial.readings, trial.previous, {(key.action, key.occurrence): side})
            for side in held
        ]
        return abs(Fraction(values[0].raw[key.action]) - Fraction(values[1].raw[key.action]))

    where = [boundary, guard.defined, guard.path, *_turns(model, guard, limits)]
    best: Supremum | None = None
    for a, b in (sides, sides[::-1]):
        term = z3.simplify(a - b)
        if z3.is_rational_value(term):
            term = exact.fraction(term)
        found = supremum(model, term, where, measure, limits, key)
        if found.evidence.kind is not Kind.PROVED:
            return found
        if best is None or (found.value or 0) > (best.value or 0):
            best = found
    assert best is not None
    return best


def _turns(model: Model, guard: Guard, limits: Limits) -> Iterator[exact.Truth]:
    """False unless the guard has either answer somewhere: else it has no boundary to cross."""
    if guard.relation in (Operator.EQUAL, Operator.NOT_EQUAL):
        return
    for side in (exact.less(guard.a, guard.b), exact.less(guard.b, guard.a)):
        solver = limited(model, limits)
        solver.add(*(exact.as_term(t, model.context) for t in (side, guard.path, guard.defined)))
        if solver.check() == z3.unsat:
            yield False
