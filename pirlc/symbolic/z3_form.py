"""Bodies and properties as z3 terms over exact reals.

The numbers are those of the binary64 values, exactly. What IEEE arithmetic answers with a NaN or an
infinity (`x / 0`, `sqrt(-1)`) has no value here: every form carries the condition under which it is
`defined`, and whoever proves must not trust it elsewhere. A form that does not count, such as the
branch that is not taken, need not be defined.

`BodyForm` can be told how far rounding may move the sides of a guard (`guard_margin`): where they
are closer than that, the guard's outcome is free.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction

import z3

from pirlc.ir.operators import COMPARISONS, Operator
from pirlc.ir.terms import If, Term
from pirlc.ir.types import Discrete, Type
from pirlc.source import NOWHERE, Span
from pirlc.symbolic import z3_terms as exact
from pirlc.symbolic.walk import Algebra, walk
from pirlc.symbolic.z3_functions import Functions
from pirlc.symbolic.z3_terms import Real, Truth


@dataclass(frozen=True, slots=True)
class Form:
    """A real (`Fraction` or z3 term) or a truth (`bool` or z3 term) where `defined` holds."""

    value: Real | Truth
    defined: Truth = True
    discrete: bool = False


@dataclass(frozen=True, slots=True)
class GuardKey:
    """A comparison of reals or a `sign` in an action's body: the how manieth that a walk calls,
    from 0; one in a fold or over sequences counts for each element, one of discrete actions not.
    """

    action: str
    occurrence: int


@dataclass(frozen=True)
class Guard:
    """A comparison `a relation b`; for `sign(a)` the relation is None and b zero.

    One between discrete actions has no key. `path` is the condition under which the branch that it
    is in is taken; `defined` that of a and b.
    """

    key: GuardKey | None
    relation: Operator | None
    a: Real
    b: Real
    outcome: Real | Truth
    defined: Truth
    path: Truth
    span: Span

    @property
    def discrete(self) -> bool:
        return self.key is None


@dataclass(frozen=True)
class Partial:
    """A division or square root: `argument` is the denominator, or what the root is taken of."""

    operator: Operator
    argument: Real
    defined: Truth
    path: Truth
    span: Span


@dataclass(frozen=True)
class Branching:
    """An `if`, its condition, and its two values."""

    term: If
    condition: Form
    consequent: Form
    alternative: Form
    path: Truth


@dataclass(frozen=True)
class Records:
    """What a body's walk met, in its order."""

    guards: tuple[Guard, ...]
    partials: tuple[Partial, ...]
    branchings: tuple[Branching, ...]


@dataclass(frozen=True)
class Inputs:
    """What the leaves of one step stand for.

    `element(sensor, index)` counts from the newest, -1; `previous` are applied actions.
    """

    parameters: Mapping[str, Fraction]
    element: Callable[[str, int], Real]
    previous: Mapping[str, Real]


GuardMargin = Callable[[GuardKey], Fraction | None]
"""How far a - b may be off; None: by any amount."""


def exactly(_: GuardKey) -> Fraction | None:
    return Fraction(0)


def _all(*forms: Form) -> Truth:
    return exact.conjunction(form.defined for form in forms)


@dataclass
class BodyForm:
    """The walk of one action's body in one step: what it records, and the free truths it makes.

    `functions` collects the axioms of sqrt, exp and tanh, and belongs to the whole model.
    """

    action: str
    inputs: Inputs
    functions: Functions
    guard_margin: GuardMargin = exactly
    free: list[z3.ExprRef] = field(default_factory=list)
    constraints: list[Truth] = field(default_factory=list)
    _guards: list[Guard] = field(default_factory=list)
    _partials: list[Partial] = field(default_factory=list)
    _branchings: list[Branching] = field(default_factory=list)
    _path: list[Truth] = field(default_factory=list)
    _keys: int = 0
    _if: If | None = None
    _span: Span = NOWHERE

    def run(self, body: Term) -> Form:
        return walk(body, self._algebra())

    @property
    def records(self) -> Records:
        return Records(tuple(self._guards), tuple(self._partials), tuple(self._branchings))

    # The watcher's part.

    def at(self, term: Term) -> None:
        self._span = term.span
        if isinstance(term, If):
            self._if = term

    def enter(self, term: If, condition: Form, taken: bool) -> None:
        del term
        self._path.append(condition.value if taken else exact.negation(condition.value))

    def leave(self) -> None:
        self._path.pop()

    # The algebra's.

    def _algebra(self) -> Algebra[Form]:
        def previous(action: str, type_: Type) -> Form:
            return Form(self.inputs.previous[action], discrete=isinstance(type_, Discrete))

        return Algebra(
            literal=lambda value: Form(Fraction(value)),
            discrete=lambda value, _: Form(Fraction(value), discrete=True),
            parameter=lambda name: Form(self.inputs.parameters[name]),
            element=lambda sensor, index: Form(self.inputs.element(sensor, index)),
            previous=previous,
            operators=self.operators(),
            choose=self._choose,
            watcher=self,
        )

    def operators(self) -> dict[Operator, Callable[..., Form]]:
        def compared(relation: Operator) -> Callable[[Form, Form], Form]:
            return lambda a, b: self._compare(relation, a, b)

        return {
            **TOTAL,
            **{relation: compared(relation) for relation in COMPARISONS},
            Operator.SIGN: self._sign,
            Operator.MULTIPLY: self._multiply,
            Operator.DIVIDE: self._divide,
            Operator.SQRT: self._sqrt,
            Operator.EXP: lambda a: Form(self.functions.exp(a.value), a.defined),
            Operator.TANH: lambda a: Form(self.functions.tanh(a.value), a.defined),
        }

    def _here(self) -> Truth:
        return exact.conjunction(self._path)

    def _compare(self, relation: Operator, a: Form, b: Form) -> Form:
        outcome = exact.compare(relation, a.value, b.value)
        key = None if a.discrete or b.discrete else self._next_key()
        margin = Fraction(0) if key is None else self.guard_margin(key)
        if margin != 0:
            free = self._free(z3.FreshBool("guard", self.functions.context))
            outcome = _unless_close(a.value, b.value, margin, outcome, free)
        defined = _all(a, b)
        self._record(key, relation, a.value, b.value, outcome, defined)
        return Form(outcome, defined)

    def _sign(self, x: Form) -> Form:
        key, zero = self._next_key(), Fraction(0)
        outcome = exact.sign(x.value)
        margin = self.guard_margin(key)
        if margin != 0:
            free = self._free(z3.FreshReal("sign", self.functions.context))
            self.constraints.append(z3.Or(free == -1, free == 0, free == 1))
            outcome = _unless_close(x.value, zero, margin, outcome, free)
        self._record(key, None, x.value, zero, outcome, x.defined)
        return Form(outcome, x.defined)

    def _next_key(self) -> GuardKey:
        self._keys += 1
        return GuardKey(self.action, self._keys - 1)

    def _record(
        self,
        key: GuardKey | None,
        relation: Operator | None,
        a: Real,
        b: Real,
        outcome: Real | Truth,
        defined: Truth,
    ) -> None:
        path, span = self._here(), self._span
        self._guards.append(Guard(key, relation, a, b, outcome, defined, path, span))

    def _free(self, variable: z3.ExprRef) -> z3.ExprRef:
        self.free.append(variable)
        return variable

    def _multiply(self, a: Form, b: Form) -> Form:
        if not exact.is_linear_product(a.value, b.value):
            self.functions.nonlinear = True
        return Form(exact.multiply(a.value, b.value), _all(a, b))

    def _divide(self, a: Form, b: Form) -> Form:
        if exact.choice_leaves(b.value) is None:
            self.functions.nonlinear = True
        nonzero = exact.negation(exact.equal(b.value, Fraction(0)))
        self._partials.append(
            Partial(Operator.DIVIDE, b.value, _all(a, b), self._here(), self._span)
        )
        defined = exact.conjunction((_all(a, b), nonzero))
        return Form(exact.divide(a.value, b.value), defined)

    def _sqrt(self, x: Form) -> Form:
        self._partials.append(Partial(Operator.SQRT, x.value, x.defined, self._here(), self._span))
        possible = exact.at_most(Fraction(0), x.value)
        defined = exact.conjunction((x.defined, possible))
        return Form(self.functions.sqrt(x.value), defined)

    def _choose(self, condition: Form, yes: Form, no: Form) -> Form:
        assert self._if is not None
        self._branchings.append(Branching(self._if, condition, yes, no, self._here()))
        return choose(condition, yes, no)


def _unless_close(
    a: Real, b: Real, margin: Fraction | None, outcome: Real | Truth, free: z3.ExprRef
) -> Real | Truth:
    """The outcome, free where a and b are within the margin of each other."""
    if margin is None:
        return free
    close = exact.within(exact.subtract(a, b), -margin, margin)
    return exact.choose(close, free, outcome)


def choose(condition: Form, yes: Form, no: Form) -> Form:
    taken = exact.choose(condition.value, yes.defined, no.defined)
    return Form(
        exact.choose(condition.value, yes.value, no.value),
        exact.conjunction((condition.defined, taken)),
        yes.discrete,
    )


def _strict(operation: Callable[..., Real | Truth]) -> Callable[..., Form]:
    """An operator that is defined where its arguments are."""

    def applied(*arguments: Form) -> Form:
        return Form(operation(*(a.value for a in arguments)), _all(*arguments))

    return applied


def _and(a: Form, b: Form) -> Form:
    """Every comparison answers, also one with a NaN: a false side decides."""
    decided = (exact.conjunction((side.defined, exact.negation(side.value))) for side in (a, b))
    defined = exact.disjunction((_all(a, b), *decided)) if _all(a, b) is not True else True
    return Form(exact.conjunction((a.value, b.value)), defined)


def _not(a: Form) -> Form:
    return Form(exact.negation(a.value), a.defined)


def _or(a: Form, b: Form) -> Form:
    return _not(_and(_not(a), _not(b)))


TOTAL: dict[Operator, Callable[..., Form]] = {
    Operator.ADD: _strict(exact.add),
    Operator.SUBTRACT: _strict(exact.subtract),
    Operator.NEGATE: _strict(exact.negate),
    Operator.ABS: _strict(exact.absolute),
    Operator.MIN: _strict(exact.minimum),
    Operator.MAX: _strict(exact.maximum),
    Operator.CLIP: _strict(exact.clip),
    Operator.NOT: _not,
    Operator.AND: _and,
    Operator.OR: _or,
    Operator.IMPLIES: lambda a, b: _or(_not(a), b),
}
"""The operators that record nothing and are total, but for what their arguments lack."""
