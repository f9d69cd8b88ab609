"""How far the sides of a property's comparisons really go: the numbers that would just hold.

For `premise implies (a < 3 and b > 1)` the supremum of a and the infimum of b over all histories
that satisfy the premise, exactly. Only what is compared with a number, in programs and properties
that are piecewise linear.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import z3

from pirlc.ir.operators import Operator
from pirlc.ir.policy import Program, Property
from pirlc.ir.printer import term_text
from pirlc.ir.terms import Apply, Term
from pirlc.symbolic import z3_terms as exact
from pirlc.symbolic.z3_form import Form
from pirlc.symbolic.z3_terms import Real
from pirlc.verify.bounds.actions import replay_of
from pirlc.verify.bounds.extremes import CLOSE, supremum
from pirlc.verify.exact import NotRational, exact_steps
from pirlc.verify.findings import Extreme, PropertyFinding, Tightest
from pirlc.verify.model import Model, unroll
from pirlc.verify.properties.asking import DEFAULT_LIMITS, Limits
from pirlc.verify.properties.claims import Claim, part_claim, settled
from pirlc.verify.properties.cone import part_of
from pirlc.verify.properties.deciding import cost
from pirlc.verify.properties.ruling import value_of
from pirlc.verify.properties.trials import trials_of
from pirlc.verify.replay import Observed, Trial

LARGEST = 5_000
"""Operations of a model that is worth the optimiser's time."""

_SLACKS = tuple(Fraction(1, 10**n) for n in (9, 10, 11, 12, 13, 14))

_UPWARD = {
    Operator.LESS: True,
    Operator.LESS_EQUAL: True,
    Operator.GREATER: False,
    Operator.GREATER_EQUAL: False,
}


def tightened(
    program: Program, findings: tuple[PropertyFinding, ...], limits: Limits = DEFAULT_LIMITS
) -> tuple[PropertyFinding, ...]:
    """The findings of the program's properties with the numbers that would just hold."""
    claims = {claim.name: claim for claim in program.properties}
    return tuple(
        replace(finding, tightest=tightest(program, claims[finding.name], limits))
        for finding in findings
    )


def tightest(program: Program, claim: Property, limits: Limits) -> tuple[Tightest, ...]:
    """What is known of each comparison, in the order of the text."""
    if cost(program, claim) > LARGEST:
        return ()
    part = part_of(program, claim)
    model = unroll(part, claim.steps)
    if model.functions.nonlinear or model.functions.axioms:
        return ()
    slack = z3.Real("slack", model.context)
    found = []
    for premises, comparison in _comparisons(claim.body, ()):
        left, right = comparison.arguments
        for side, other, upward in (
            (left, right, _UPWARD[comparison.operator]),
            (right, left, not _UPWARD[comparison.operator]),
        ):
            bound, form = (part_claim(claim, model, t, slack).form for t in (other, side))
            if isinstance(bound.value, Fraction) and not isinstance(form.value, Fraction):
                asked = _Asked(claim, model, side, premises, 1 if upward else -1, slack)
                extreme = asked.extreme(program, form, limits)
                if extreme is not None:
                    found.append(Tightest(term_text(side), bound.value, upward, extreme))
    return tuple(found)


def _comparisons(
    term: Term, premises: tuple[Term, ...]
) -> Iterator[tuple[tuple[Term, ...], Apply]]:
    """The comparisons that a property demands, with what they are demanded under."""
    match term:
        case Apply(Operator.AND, (a, b)):
            yield from _comparisons(a, premises)
            yield from _comparisons(b, premises)
        case Apply(Operator.IMPLIES, (a, b)):
            yield from _comparisons(b, (*premises, a))
        case Apply(operator) if operator in _UPWARD:
            yield premises, term
        case _:
            pass


@dataclass(frozen=True)
class _Asked:
    """How far one side of a comparison goes, upward or downward (sign -1), under its premises."""

    claim: Property
    model: Model
    side: Term
    premises: tuple[Term, ...]
    sign: int
    slack: z3.ArithRef

    def extreme(self, program: Program, form: Form, limits: Limits) -> Extreme | None:
        """The extreme of `form`, the side's; None where it was not found."""
        assumed = [part_claim(self.claim, self.model, p, self.slack) for p in self.premises]
        if form.defined is not True or any(p.form.defined is not True for p in assumed):
            return None
        term = form.value if self.sign > 0 else exact.negate(form.value)
        where = [premise.form.value for premise in assumed]
        found = supremum(self.model, term, where, self.measure, limits)
        if found.value is None:
            return None
        trial = found.trial or self._clearly(term, found.value, assumed, limits)
        witness = None if trial is None else replay_of(program, trial)
        return Extreme(self.sign * found.value, found.attained, found.evidence, witness)

    def _clearly(
        self, term: Real, value: Fraction, assumed: Sequence[Claim], limits: Limits
    ) -> Trial | None:
        """A history of floats close to the value on which premises and guards hold with room."""
        solver = self.model.solver(limits.work)
        solver.add(term > exact.number(value - CLOSE / 2, self.model.context))
        solver.add(*(exact.as_term(p.holds, self.model.context) for p in assumed))
        solver.add(exact.as_term(settled(self.model, self.slack), self.model.context))
        for slack in _SLACKS:
            solver.push()
            solver.add(self.slack == exact.number(slack, self.model.context))
            if solver.check() == z3.sat:
                for trial in trials_of(self.model, solver.model()):
                    try:
                        if value - self.measure(trial) <= CLOSE:
                            return trial
                    except NotRational:
                        continue
            solver.pop()
        return None

    def measure(self, trial: Trial) -> Fraction:
        """The side's value on a history, exactly. Raises `NotRational` also where a premise fails:
        such a history shows nothing."""
        program, window = self.model.program, self.model.program.interface.window
        observed: list[Observed] = []
        before: Mapping[str, Any] = trial.previous
        steps = exact_steps(program, trial.readings, trial.previous, self.claim.steps)
        for number, step in enumerate(steps):
            seen = {name: r[number : number + window] for name, r in trial.readings.items()}
            raw: Mapping[str, Any] = step.raw
            applied: Mapping[str, Any] = step.applied
            observed.append(Observed(seen, before, raw, applied))
            before = applied

        def value(term: Term) -> Any:
            return value_of(program, self.claim, term, observed)

        if not all(value(premise) for premise in self.premises):
            raise NotRational
        return self.sign * Fraction(value(self.side))
