"""Random well-typed programs, built straight in the intermediate representation.

Everything is drawn from a `random.Random`, so that the bulk runs need nothing but a seed and
hypothesis can drive (and shrink) the same generator through `hypothesis.strategies.randoms`.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

from pirlc.ir.operators import COMPARISONS, FOLDABLE, SIGNATURES, Operator
from pirlc.ir.policy import (
    ActionSpec,
    Choice,
    Continuous,
    Fill,
    FixedParameter,
    FreeParameter,
    Hold,
    Interface,
    MissingPolicy,
    Program,
    ProgramTemplate,
    Sensor,
    Zero,
)
from pirlc.ir.terms import (
    Apply,
    Diff,
    DiscreteLiteral,
    Fold,
    FoldLambda,
    If,
    Let,
    Literal,
    LocalRef,
    ParameterRef,
    Peek,
    PreviousAction,
    SensorRef,
    Term,
)
from pirlc.ir.types import Bool, Discrete, Real, Sequence, Type

LIBM = (Operator.EXP, Operator.TANH)

ODD_NUMBERS = (
    0.0,
    -0.0,
    5e-324,
    -5e-324,
    1e-310,
    2.2250738585072014e-308,
    1e-45,
    -1e-45,
    1e-40,
    1.1754943508222875e-38,
    3.4028234663852886e38,
    -3.4028235677973366e38,
    1e200,
    -1.7976931348623157e308,
)
"""Zeros, denormals of both precisions, and numbers near or past the end of either."""


@dataclass(frozen=True)
class Kinds:
    """Which constructs to draw."""

    libm: bool = False
    odd_numbers: bool = True
    conditionals: bool = True
    operators: tuple[Operator, ...] = tuple(
        operator for operator, signature in SIGNATURES.items() if signature.result == Real()
    )
    depth: int = 5

    @property
    def arithmetic(self) -> tuple[Operator, ...]:
        return tuple(o for o in self.operators if self.libm or o not in LIBM)


@dataclass
class Generator:
    """Draws terms over one interface."""

    rng: random.Random
    kinds: Kinds
    interface: Interface
    parameters: tuple[str, ...]
    fresh: int = 0
    locals: tuple[tuple[str, Type], ...] = field(default=())
    lambdas: int = 0

    def number(self) -> float:
        return random_number(self.rng, self.kinds.odd_numbers)

    def name(self) -> str:
        """Mostly a new name; at times one that shadows."""
        if self.locals and self.rng.random() < 0.1:
            return self.rng.choice(self.locals)[0]
        self.fresh += 1
        return f"x{self.fresh}"

    def under(self, bindings: Iterable[tuple[str, Type]], draw: Callable[[], Term]) -> Term:
        saved = self.locals
        names = {name for name, _ in bindings}
        self.locals = (*((n, t) for n, t in saved if n not in names), *bindings)
        try:
            return draw()
        finally:
            self.locals = saved

    def local(self, type_: Type) -> list[Callable[[], Term]]:
        names = [name for name, t in self.locals if t == type_]
        return [lambda: LocalRef(self.rng.choice(names), type_)] * (2 if names else 0)

    def let(self, depth: int, draw: Callable[[int], Term]) -> Term:
        window = self.interface.window
        kinds: list[Type] = [Real(), Sequence(window), Bool()]
        if window > 1:
            kinds.append(Sequence(window - 1))
        type_ = self.rng.choice(kinds)
        value = self.term(type_, depth - 1)
        name = self.name()
        return Let(name, value, self.under([(name, type_)], lambda: draw(depth - 1)))

    def term(self, type_: Type, depth: int) -> Term:
        match type_:
            case Real():
                return self.real(depth)
            case Bool():
                return self.truth(depth)
            case Discrete():
                return self.discrete(type_, depth)
            case Sequence(length):
                return self.sequence(length, depth)

    def real(self, depth: int) -> Term:
        rng = self.rng
        leaves: list[Callable[[], Term]] = [
            lambda: Literal(self.number()),
            lambda: Peek(self.sensor(), -rng.randint(1, self.interface.window)),
            *self.local(Real()),
        ]
        if self.parameters:
            leaves += [lambda: ParameterRef(rng.choice(self.parameters))] * 2
        reals = [a for a in self.interface.actions if isinstance(a.domain, Continuous)]
        if reals:
            leaves.append(lambda: PreviousAction(rng.choice(reals).name, Real()))
        if depth <= 0:
            return rng.choice(leaves)()
        nodes: list[Callable[[], Term]] = [
            *[lambda: self.operation(depth)] * 4,
            *[lambda: self.peek(depth)] * 2,
            *[lambda: self.fold(depth)] * 2,
            lambda: self.let(depth, self.real),
        ]
        if self.kinds.conditionals:
            nodes.append(
                lambda: If(self.truth(depth - 1), self.real(depth - 1), self.real(depth - 1))
            )
        if self.lambdas < 2:
            nodes.append(lambda: self.fold_lambda(depth))
        return rng.choice(nodes if rng.random() < 0.8 else leaves)()

    def sensor(self) -> Term:
        return SensorRef(self.rng.choice(self.interface.sensors).name, self.interface.window)

    def operation(self, depth: int) -> Term:
        operator = self.rng.choice(self.kinds.arithmetic)
        return Apply(
            operator, tuple(self.real(depth - 1) for _ in range(SIGNATURES[operator].arity))
        )

    def length(self) -> int:
        return self.rng.randint(max(1, self.interface.window - 2), self.interface.window)

    def peek(self, depth: int) -> Term:
        length = self.length()
        return Peek(self.sequence(length, depth - 1), -self.rng.randint(1, length))

    def fold(self, depth: int) -> Term:
        foldable = [o for o in FOLDABLE if o in self.kinds.operators]
        return Fold(self.rng.choice(foldable), self.sequence(self.length(), depth - 1))

    def fold_lambda(self, depth: int) -> Term:
        element, accumulator = self.name(), self.name()
        if element == accumulator:
            accumulator += "a"
        sequence = self.sequence(self.length(), depth - 1)
        initial = self.real(depth - 1)
        self.lambdas += 1
        bound = [(element, Real()), (accumulator, Real())]
        body = self.under(bound, lambda: self.real(min(depth - 1, 2)))
        self.lambdas -= 1
        return FoldLambda(element, accumulator, body, sequence, initial)

    def sequence(self, length: int, depth: int) -> Term:
        rng = self.rng
        window = self.interface.window
        leaves = self.local(Sequence(length))
        if length == window:
            leaves.append(self.sensor)
        if depth <= 0:
            if leaves:
                return rng.choice(leaves)()
            return Diff(self.sequence(length + 1, 0))
        nodes: list[Callable[[], Term]] = [
            *[lambda: self.elementwise(length, depth)] * 2,
            lambda: self.let(depth, lambda d: self.sequence(length, d)),
        ]
        if length < window:
            nodes.append(lambda: Diff(self.sequence(length + 1, depth - 1)))
        return rng.choice(nodes if rng.random() < 0.6 or not leaves else leaves)()

    def elementwise(self, length: int, depth: int) -> Term:
        operator = self.rng.choice(self.kinds.arithmetic)
        arity = SIGNATURES[operator].arity
        spread = self.rng.randrange(arity)
        return Apply(
            operator,
            tuple(
                self.sequence(length, depth - 1)
                if i == spread or self.rng.random() < 0.3
                else self.real(depth - 2)
                for i in range(arity)
            ),
        )

    def truth(self, depth: int) -> Term:
        rng = self.rng
        nodes: list[Callable[[], Term]] = [
            *[lambda: Apply(rng.choice(COMPARISONS), (self.real(depth - 1), self.real(depth - 1)))]
            * 3,
            *self.local(Bool()),
        ]
        choices = [a for a in self.interface.actions if isinstance(a.domain, Choice)]
        if choices:
            nodes.append(lambda: self.same(rng.choice(choices), depth))
        if depth > 0:
            nodes += [
                lambda: Apply(Operator.NOT, (self.truth(depth - 1),)),
                lambda: Apply(
                    rng.choice((Operator.AND, Operator.OR, Operator.IMPLIES)),
                    (self.truth(depth - 1), self.truth(depth - 1)),
                ),
                lambda: If(self.truth(depth - 1), self.truth(depth - 1), self.truth(depth - 1)),
                lambda: self.let(depth, self.truth),
            ]
        return rng.choice(nodes)()

    def same(self, action: ActionSpec, depth: int) -> Term:
        assert isinstance(action.domain, Choice)
        type_ = Discrete(action.domain.values)
        operator = self.rng.choice((Operator.EQUAL, Operator.NOT_EQUAL))
        return Apply(operator, (self.discrete(type_, depth - 2), self.discrete(type_, depth - 2)))

    def discrete(self, type_: Discrete, depth: int) -> Term:
        rng = self.rng
        same = [
            a.name
            for a in self.interface.actions
            if isinstance(a.domain, Choice) and a.domain.values == type_.values
        ]
        leaves: list[Callable[[], Term]] = [
            lambda: DiscreteLiteral(rng.choice(type_.values), type_),
            *self.local(type_),
        ]
        if same:
            leaves.append(lambda: PreviousAction(rng.choice(same), type_))
        if depth <= 0:
            return rng.choice(leaves)()
        nodes: list[Callable[[], Term]] = [
            lambda: If(
                self.truth(depth - 1),
                self.discrete(type_, depth - 1),
                self.discrete(type_, depth - 1),
            ),
            lambda: self.let(depth, lambda d: self.discrete(type_, d)),
        ]
        return rng.choice(nodes if rng.random() < 0.8 else leaves)()


def random_number(rng: random.Random, odd: bool = True) -> float:
    kind = rng.random()
    if odd and kind < 0.12:
        return rng.choice(ODD_NUMBERS)
    if kind < 0.4:
        return float(rng.randint(-4, 4))
    if kind < 0.9:
        return round(rng.uniform(-3.0, 3.0), rng.randint(1, 6))
    return rng.uniform(-200.0, 200.0)


def _range(rng: random.Random) -> tuple[float, float]:
    lower = rng.choice([-1.0, 0.0, -0.0, -3.5, 0.1, -100.0, round(rng.uniform(-5, 5), 3)])
    return lower, lower + rng.choice([0.3, 1.0, 2.0, 7.7, 1000.0])


def _missing(rng: random.Random) -> MissingPolicy:
    return rng.choice([Hold(), Zero(), Hold(0), Hold(1), Hold(rng.randint(2, 9))])


def random_interface(rng: random.Random, discrete: bool | None = None) -> Interface:
    """`discrete`: only discrete actions (True), only continuous ones (False), or any (None)."""
    window = rng.randint(1, 7)
    sensors = []
    for i, index in enumerate(rng.sample(range(5), rng.randint(1, 3))):
        lower, upper = _range(rng)
        sensors.append(Sensor(f"S{i}", lower, upper, index, _missing(rng)))
    actions = []
    for i, component in enumerate(rng.sample(range(3), rng.randint(1, 3))):
        domain: Continuous | Choice
        if discrete or (discrete is None and rng.random() < 0.4):
            values = tuple(rng.sample(range(-3, 6), rng.randint(1, 4)))
            domain = Choice(values, rng.choice([None, rng.choice(values)]))
        else:
            lower, upper = _range(rng)
            if rng.random() < 0.2:
                lower, upper = -upper, -lower
            domain = Continuous(lower, upper, rng.choice([None, lower, upper, (lower + upper) / 2]))
        actions.append(ActionSpec(f"A{i}", domain, component))
    return Interface(
        name="random",
        environment=None,
        sensors=tuple(sensors),
        actions=tuple(actions),
        window=window,
        latency=rng.choice([0, 0, 0, 1, 2, 3]),
        fill=rng.choice(list(Fill)),
    )


def random_program(rng: random.Random, kinds: Kinds = Kinds()) -> Program:
    interface = random_interface(rng)
    names = tuple(f"p{i}" for i in range(rng.randint(0, 4)))
    generator = Generator(rng, kinds, interface, names)
    parameters = tuple(FixedParameter(name, generator.number()) for name in names)
    bodies = tuple(
        generator.term(action.type, rng.randint(1, kinds.depth)) for action in interface.actions
    )
    return Program(interface, parameters, bodies)


def random_template(
    rng: random.Random,
    kinds: Kinds = Kinds(odd_numbers=False),
    discrete: bool | None = False,
) -> ProgramTemplate:
    """A template with free parameters in [-3, 3]."""
    interface = random_interface(rng, discrete)
    names = tuple(f"p{i}" for i in range(rng.randint(1, 5)))
    generator = Generator(rng, kinds, interface, names)
    bodies = tuple(
        generator.term(action.type, rng.randint(1, kinds.depth)) for action in interface.actions
    )
    return ProgramTemplate(
        interface, tuple(FreeParameter(name, -3.0, 3.0) for name in names), bodies
    )


def renamed(program: Program, name: str) -> Program:
    """The program under another policy name."""
    return replace(program, interface=replace(program.interface, name=name))
