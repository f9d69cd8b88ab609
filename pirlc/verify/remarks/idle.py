"""Parameters without effect: no history and no other value of theirs changes any action."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

import z3

from pirlc.ir.evidence import PROVED, Evidence, unknown
from pirlc.ir.policy import Continuous, FixedParameter, Program
from pirlc.ir.terms import ParameterRef, subterms
from pirlc.symbolic import z3_terms as exact
from pirlc.symbolic.z3_form import BodyForm, Form, Inputs
from pirlc.verify.bounds.extremes import limited, why
from pirlc.verify.findings import Matter, Remark
from pirlc.verify.model import unroll, working_range
from pirlc.verify.properties.asking import Limits
from pirlc.verify.remarks.hazards import some_trials, tries
from pirlc.verify.replay import run

_TRIALS = 60


def idle(program: Program, limits: Limits) -> Iterator[Remark]:
    """One remark for each parameter that no history was seen to feel."""
    for parameter in program.parameters:
        used = any(
            isinstance(term, ParameterRef) and term.name == parameter.name
            for body in program.bodies
            for term in subterms(body)
        )
        if used and _felt(program, parameter):
            continue
        evidence = _proof(program, parameter, limits) if used else PROVED
        if evidence is None:
            continue
        text = f"{parameter.name} has no effect on any action"
        if evidence != PROVED:
            text = f"{parameter.name} was seen to have no effect on any action"
        yield Remark(Matter.NO_EFFECT, text, evidence, False, parameter.span)


def _felt(program: Program, parameter: FixedParameter) -> bool:
    """Some history gives another action under another value."""
    rng = random.Random(0)
    value = parameter.value
    for trial in some_trials(program, min(_TRIALS, tries(program))):
        other = rng.choice(
            [value + 1.0, value - 1.0, 2.0 * value, -value, 0.0, 100.0, -100.0, value * 1.01]
        )
        changed = replace(
            program,
            parameters=tuple(
                replace(p, value=other) if p.name == parameter.name else p
                for p in program.parameters
            ),
        )
        if run(program, trial)[-1].applied != run(changed, trial)[-1].applied:
            return True
    return False


def _proof(program: Program, parameter: FixedParameter, limits: Limits) -> Evidence | None:
    """Proved, or unknown; None if z3 finds that the parameter has an effect after all."""
    model = unroll(program, 1)
    other = z3.Real(f"another {parameter.name}", model.context)
    values: dict[str, exact.Real] = {
        name: Fraction(value) for name, value in program.values.items()
    }
    inputs = Inputs(
        {**values, parameter.name: other},
        lambda sensor, index: model.window(sensor, 0)[index],
        model.previous,
    )
    differs: list[exact.Truth] = []
    for spec, body in zip(program.interface.actions, program.bodies, strict=True):
        changed = BodyForm(spec.name, inputs, model.functions).run(body)
        original = model.steps[0].raw[spec.name]
        if isinstance(spec.domain, Continuous):
            ends = working_range(spec)
            before, after = (exact.clip(f.value, *ends) for f in (original, changed))
        else:
            before, after = original.value, changed.value
        differs.append(exact.negation(exact.equal(before, after)))
        differs.append(exact.negation(_alike(original, changed)))
    solver = limited(model, limits)
    solver.add(exact.as_term(exact.disjunction(differs), model.context))
    match solver.check():
        case z3.unsat:
            return PROVED
        case z3.sat:
            return None
        case _:
            return unknown(why(solver))


def _alike(a: Form, b: Form) -> exact.Truth:
    """Both are defined."""
    return exact.conjunction((a.defined, b.defined))
