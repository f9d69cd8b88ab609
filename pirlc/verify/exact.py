"""A program in exact rational arithmetic, on one history.

What `symbolic.walk` computes with fractions instead of floats: the value that a witness really
has, and what rounding is measured against. `sqrt`, `exp` and `tanh` are left out, as their values
are no rationals; so is dividing by zero.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from pirlc.ir.operators import Operator
from pirlc.ir.policy import Choice, Continuous, Program
from pirlc.ir.types import Real
from pirlc.symbolic.walk import Algebra, walk

Exact = Fraction | int | bool


class NotRational(ArithmeticError):
    """The value is no rational number, or there is none."""


@dataclass(frozen=True)
class Decision:
    """A comparison's answer, and how far apart its sides were (for a `sign`, from zero)."""

    answer: bool | int
    distance: Fraction


@dataclass(frozen=True)
class ExactStep:
    """By action: the value before and after clipping, and every comparison in walking order."""

    raw: Mapping[str, Exact]
    applied: Mapping[str, Exact]
    decisions: Mapping[str, tuple[Decision, ...]]


def exact_step(
    program: Program,
    windows: Mapping[str, Sequence[float | Fraction]],
    previous: Mapping[str, float | Fraction],
    forced: Mapping[tuple[str, int], int] = {},
) -> ExactStep:
    """One step on full windows (oldest reading first). Raises `NotRational`.

    `forced` gives comparisons (action, occurrence) an answer of their own.
    """
    raw: dict[str, Exact] = {}
    applied: dict[str, Exact] = {}
    decisions: dict[str, tuple[Decision, ...]] = {}
    for action, body in zip(program.interface.actions, program.bodies, strict=True):
        made: list[Decision] = []
        own = {
            occurrence: answer
            for (name, occurrence), answer in forced.items()
            if name == action.name
        }
        value = walk(body, _algebra(program, windows, previous, made, own))
        raw[action.name] = value
        match action.domain:
            case Continuous(lower, upper):
                applied[action.name] = min(max(value, Fraction(lower)), Fraction(upper))
            case Choice():
                applied[action.name] = value
        decisions[action.name] = tuple(made)
    return ExactStep(raw, applied, decisions)


def exact_steps(
    program: Program,
    readings: Mapping[str, Sequence[float | Fraction]],
    previous: Mapping[str, float | Fraction],
    count: int,
) -> tuple[ExactStep, ...]:
    """`count` steps on as many good readings (oldest first) as they need."""
    window = program.interface.window
    steps: list[ExactStep] = []
    for i in range(count):
        windows = {name: taken[i : i + window] for name, taken in readings.items()}
        steps.append(exact_step(program, windows, previous))
        previous = steps[-1].applied
    return tuple(steps)


def _algebra(
    program: Program,
    windows: Mapping[str, Sequence[float | Fraction]],
    previous: Mapping[str, float | Fraction],
    made: list[Decision],
    forced: Mapping[int, int],
) -> Algebra[Exact]:
    values = program.values

    def compare(test: Callable[[Exact, Exact], bool]) -> Callable[[Exact, Exact], bool]:
        def compared(a: Exact, b: Exact) -> bool:
            answer = bool(forced.get(len(made), test(a, b)))
            made.append(Decision(answer, abs(Fraction(a) - Fraction(b))))
            return answer

        return compared

    def sign(a: Exact) -> Exact:
        answer = forced.get(len(made), (a > 0) - (a < 0))
        made.append(Decision(answer, abs(Fraction(a))))
        return Fraction(answer)

    def divide(a: Exact, b: Exact) -> Exact:
        if b == 0:
            raise NotRational
        return Fraction(a) / Fraction(b)

    def irrational(_: Exact) -> Exact:
        raise NotRational

    def read(sensor: str, index: int) -> Exact:
        return Fraction(windows[sensor][index])

    return Algebra(
        literal=Fraction,
        discrete=lambda value, _type: value,
        parameter=lambda name: Fraction(values[name]),
        element=read,
        previous=lambda action, type_: (
            Fraction(previous[action]) if type_ == Real() else int(previous[action])
        ),
        operators={
            Operator.ADD: lambda a, b: a + b,
            Operator.SUBTRACT: lambda a, b: a - b,
            Operator.MULTIPLY: lambda a, b: a * b,
            Operator.DIVIDE: divide,
            Operator.NEGATE: lambda a: -a,
            Operator.ABS: abs,
            Operator.MIN: lambda a, b: a if a < b else b,
            Operator.MAX: lambda a, b: a if a > b else b,
            Operator.CLIP: lambda x, low, high: low if x < low else high if x > high else x,
            Operator.SQRT: irrational,
            Operator.EXP: irrational,
            Operator.TANH: irrational,
            Operator.SIGN: sign,
            Operator.LESS: compare(lambda a, b: a < b),
            Operator.LESS_EQUAL: compare(lambda a, b: a <= b),
            Operator.GREATER: compare(lambda a, b: a > b),
            Operator.GREATER_EQUAL: compare(lambda a, b: a >= b),
            Operator.EQUAL: compare(lambda a, b: a == b),
            Operator.NOT_EQUAL: compare(lambda a, b: a != b),
            Operator.NOT: lambda a: not a,
            Operator.AND: lambda a, b: a and b,
            Operator.OR: lambda a, b: a or b,
            Operator.IMPLIES: lambda a, b: not a or b,
        },
        choose=lambda condition, a, b: a if condition else b,
    )
