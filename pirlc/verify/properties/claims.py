"""Properties as z3 terms over an unrolled program, with some room for what rounding takes away."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction

import z3

from pirlc.ir import terms
from pirlc.ir.operators import COMPARISONS, Operator
from pirlc.ir.policy import Choice, Property
from pirlc.ir.types import Type
from pirlc.symbolic import z3_terms as exact
from pirlc.symbolic.walk import Algebra, walk
from pirlc.symbolic.z3_form import TOTAL, BodyForm, Form, Inputs
from pirlc.symbolic.z3_terms import Term, Truth
from pirlc.verify.model import Model


@dataclass(frozen=True, slots=True)
class Claim:
    """A property, or a part of it. `form` says what it is; of a truth, `fails` and `holds` that it
    does so with `slack` to spare in each comparison."""

    form: Form
    holds: Truth = True
    fails: Truth = True


@dataclass(frozen=True)
class Question:
    """What z3 is asked about one property: `wrong` is a violation or an undefined property.

    `clear` is a violation by the slack at least, with every guard of the program that far from
    turning; slack is z3's variable for it.
    """

    model: Model
    wrong: Truth
    undefined: Truth
    violated: Truth
    clear: Truth
    slack: Term


def question(claim: Property, model: Model) -> Question:
    """What is asked of a model unrolled over the property's steps."""
    slack = z3.Real("slack", model.context)
    said = walk(claim.body, _algebra(claim, model, slack))
    undefined = exact.negation(said.form.defined)
    violated = exact.conjunction((said.form.defined, exact.negation(said.form.value)))
    clear = exact.conjunction((said.form.defined, said.fails, settled(model, slack)))
    return Question(
        model, exact.disjunction((undefined, violated)), undefined, violated, clear, slack
    )


def settled(model: Model, slack: Term) -> Truth:
    """No guard of the program is nearer to turning than the slack."""
    apart = []
    for step in model.steps:
        for records in step.records.values():
            for guard in records.guards:
                if guard.key is not None:
                    room = exact.absolute(exact.subtract(guard.a, guard.b))
                    meant = exact.negation(guard.defined)
                    apart.append(exact.disjunction((meant, exact.at_most(slack, room))))
    return exact.conjunction(apart)


def part_claim(claim: Property, model: Model, part: terms.Term, slack: Term) -> Claim:
    """A part of a property (an atom without local names of the rest) over the model's steps."""
    return walk(part, _algebra(claim, model, slack))


def _algebra(claim: Property, model: Model, slack: Term) -> Algebra[Claim]:
    steps = model.steps
    discrete = {
        spec.name: isinstance(spec.domain, Choice) for spec in model.program.interface.actions
    }

    def element(sensor: str, index: int) -> Claim:
        if not claim.ranged:
            return Claim(Form(model.window(sensor, 0)[index]))
        return Claim(Form(model.window(sensor, len(steps) + index)[-1]))

    def values(forms: list[Form]) -> Claim | tuple[Claim, ...]:
        return tuple(map(Claim, forms)) if claim.ranged else Claim(forms[-1])

    def action(name: str, raw: bool, _: Type) -> Claim | tuple[Claim, ...]:
        return values([(step.raw if raw else step.applied)[name] for step in steps])

    def previous(name: str, _: Type) -> Claim | tuple[Claim, ...]:
        first = Form(model.previous[name], True, discrete[name])
        return values([first, *(step.applied[name] for step in steps[:-1])])

    # The property's own operators are exact, and record nothing that anybody asks for.
    own = BodyForm("", Inputs({}, lambda *_: None, {}), model.functions)
    return Algebra(
        literal=lambda value: Claim(Form(Fraction(value))),
        discrete=lambda value, _: Claim(Form(Fraction(value), discrete=True)),
        parameter=lambda name: Claim(Form(Fraction(model.program.values[name]))),
        element=element,
        previous=previous,
        operators={
            **{operator: _lifted(operation) for operator, operation in own.operators().items()},
            **{relation: _comparison(relation, slack) for relation in COMPARISONS},
            **_LOGIC,
        },
        choose=_choose,
        action=action,
    )


def _lifted(operation: Callable[..., Form]) -> Callable[..., Claim]:
    return lambda *claims: Claim(operation(*(c.form for c in claims)))


_OPPOSITE: Mapping[Operator, Operator] = {
    Operator.LESS: Operator.GREATER_EQUAL,
    Operator.LESS_EQUAL: Operator.GREATER,
    Operator.GREATER: Operator.LESS_EQUAL,
    Operator.GREATER_EQUAL: Operator.LESS,
    Operator.EQUAL: Operator.NOT_EQUAL,
    Operator.NOT_EQUAL: Operator.EQUAL,
}


def _comparison(relation: Operator, slack: Term) -> Callable[[Claim, Claim], Claim]:
    def compared(a: Claim, b: Claim) -> Claim:
        defined = exact.conjunction((a.form.defined, b.form.defined))
        value = exact.compare(relation, a.form.value, b.form.value)
        if a.form.discrete or b.form.discrete:
            return Claim(Form(value, defined), value, exact.negation(value))
        holds, fails = (_clearly(r, a.form, b.form, slack) for r in (relation, _OPPOSITE[relation]))
        return Claim(Form(value, defined), holds, fails)

    return compared


def _clearly(relation: Operator, a: Form, b: Form, slack: Term) -> Truth:
    """The comparison holds, and not by less than the slack (an equality: just holds).

    Beside a constant the slack is a share of it: in `sum < 0.006 implies change < 0.1` both sides
    get their due.
    """
    plain = exact.compare(relation, a.value, b.value)
    if relation is Operator.EQUAL:
        return plain
    sizes = [abs(x.value) for x in (a, b) if isinstance(x.value, Fraction) and x.value]
    room = exact.multiply(min(sizes, default=Fraction(1)), slack)
    apart = exact.absolute(exact.subtract(a.value, b.value))
    return exact.conjunction((plain, exact.at_most(room, apart)))


def _and(a: Claim, b: Claim) -> Claim:
    form = TOTAL[Operator.AND](a.form, b.form)
    return Claim(form, exact.conjunction((a.holds, b.holds)), exact.disjunction((a.fails, b.fails)))


def _not(a: Claim) -> Claim:
    return Claim(TOTAL[Operator.NOT](a.form), a.fails, a.holds)


def _or(a: Claim, b: Claim) -> Claim:
    return _not(_and(_not(a), _not(b)))


_LOGIC: dict[Operator, Callable[..., Claim]] = {
    Operator.NOT: _not,
    Operator.AND: _and,
    Operator.OR: _or,
    Operator.IMPLIES: lambda a, b: _or(_not(a), b),
}


def _choose(condition: Claim, yes: Claim, no: Claim) -> Claim:
    taken = condition.form
    form = Form(
        exact.choose(taken.value, yes.form.value, no.form.value),
        exact.conjunction(
            (taken.defined, exact.choose(taken.value, yes.form.defined, no.form.defined))
        ),
        yes.form.discrete,
    )
    return Claim(
        form,
        exact.choose(taken.value, yes.holds, no.holds),
        exact.choose(taken.value, yes.fails, no.fails),
    )
