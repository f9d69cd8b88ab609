"""Rounding bounds against exact rational arithmetic, and against gappa's."""

from __future__ import annotations

import random
import re
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest
from flint import arb, ctx

from pirlc.frontend import parse_sketch
from pirlc.ir.expansion import close
from pirlc.ir.operators import Operator
from pirlc.ir.policy import Choice, Continuous, Fill, Program
from pirlc.semantics.interpreter import Scope, applied, evaluate
from pirlc.semantics.precision import BINARY32, BINARY64, Precision, widened
from pirlc.source import SourceText
from pirlc.verify.exact import NotRational, exact_steps
from pirlc.verify.rounding import rounding
from tests.support.programs import Kinds, random_program

PRINTED = Path(__file__).parents[2] / "examples" / "torcs" / "printed"
RATIONAL = replace(
    Kinds(),
    operators=tuple(
        o for o in Kinds().operators if o not in (Operator.SQRT, Operator.EXP, Operator.TANH)
    ),
)


def program_of(text: str) -> Program:
    program = close(parse_sketch(SourceText("test.pirl", text)))
    assert program is not None
    return program


def small(body: str, sensor: str = "[-1, 1]", window: int = 2) -> Program:
    return program_of(
        f"policy p\nsensor x : {sensor} = 0\nsensor y : {sensor} = 1\nwindow {window}\n"
        f"action A : [-1, 1] safe 0 = {body}\n"
    )


def reading(rng: random.Random, lower: float, upper: float, precision: Precision) -> float:
    """A good reading: anywhere, at an end, at or next to zero."""
    low, high = widened(lower, upper)
    kind = rng.random()
    if kind < 0.15:
        x = low
    elif kind < 0.3:
        x = high
    elif kind < 0.4:
        x = rng.choice([0.0, 1e-320, -1e-45, 2.0**-1074, 1e-40, -(2.0**-149)])
    elif kind < 0.55:
        x = rng.choice([-1.0, 1.0]) * 2.0 ** rng.uniform(-40, 2)
    else:
        x = rng.uniform(low, high)
    return precision.round(min(max(x, low), high))


def histories(
    program: Program, precision: Precision, steps: int, rng: random.Random, count: int
) -> Iterator[tuple[dict[str, list[float]], dict[str, float]]]:
    interface = program.interface
    for _ in range(count):
        readings = {
            sensor.name: [
                reading(rng, sensor.lower, sensor.upper, precision)
                for _ in range(interface.window + steps - 1)
            ]
            for sensor in interface.sensors
        }
        previous: dict[str, float] = {}
        for action in interface.actions:
            match action.domain:
                case Continuous(lower, upper):
                    low, high = precision.round(lower), precision.round(upper)
                    x = rng.choice([low, high, rng.uniform(low, high)])
                    previous[action.name] = min(max(precision.round(x), low), high)
                case Choice(values):
                    previous[action.name] = rng.choice(values)
        yield readings, previous


def computed(
    program: Program,
    readings: Mapping[str, list[float]],
    previous: Mapping[str, float],
    precision: Precision,
    steps: int,
) -> list[tuple[dict[str, float], dict[str, float]]]:
    """The interpreter's raw and applied actions, step by step."""
    interface = program.interface
    done = []
    for i in range(steps):
        scope = Scope(
            {name: precision.round(value) for name, value in program.values.items()},
            {s: tuple(taken[i : i + interface.window]) for s, taken in readings.items()},
            previous,
            {},
        )
        raw = {
            action.name: evaluate(body, scope, precision)
            for action, body in zip(interface.actions, program.bodies, strict=True)
        }
        after = {
            action.name: applied(action, raw[action.name], precision)
            for action in interface.actions
        }
        done.append((raw, after))
        previous = after
    return done


def check_sound(program: Program, precision: Precision, rng: random.Random, count: int) -> int:
    """Asserts that no history exceeds the bounds; the number of values compared."""
    steps = 2
    bounds = rounding(program, precision, steps)
    compared = 0
    for readings, previous in histories(program, precision, steps, rng, count):
        try:
            reals = exact_steps(program, readings, previous, steps)
        except NotRational:
            continue
        floats = computed(program, readings, previous, precision, steps)
        for bound, real, (raw, after) in zip(bounds.steps, reals, floats, strict=True):
            # Where a comparison's sides are closer than its margin rounding may turn it.
            if any(
                margin is None or 0 < margin >= decision.distance
                for name, margins in bound.margins.items()
                for margin, decision in zip(margins, real.decisions[name], strict=True)
            ):
                break
            for action in program.interface.actions:
                name = action.name
                if isinstance(action.domain, Choice):
                    assert raw[name] == real.raw[name]
                elif (most := bound.raw[name]) is not None:
                    assert abs(Fraction(raw[name]) - real.raw[name]) <= most
                    assert abs(Fraction(after[name]) - real.applied[name]) <= bound.applied[name]
                    compared += 1
    return compared


def check_random_programs(precision: Precision, seed: int, count: int) -> tuple[int, int]:
    """How many values were compared, and of how many programs."""
    rng = random.Random(seed)
    compared = bounded = 0
    for i in range(count):
        program = random_program(rng, replace(RATIONAL, depth=2 + i % 4, odd_numbers=i % 3 == 0))
        found = check_sound(program, precision, rng, 12)
        compared += found
        bounded += found > 0
    return compared, bounded


@pytest.mark.parametrize("precision", Precision)
def test_no_random_program_exceeds_its_bound(precision: Precision) -> None:
    compared, bounded = check_random_programs(precision, 41, 250)
    assert compared > 2500
    assert bounded > 100


@pytest.mark.slow
@pytest.mark.parametrize("precision", Precision)
def test_no_program_of_many_exceeds_its_bound(precision: Precision) -> None:
    compared, bounded = check_random_programs(precision, 42, 4000)
    assert compared > 40_000
    assert bounded > 1600


REALS = {
    "sqrt(x2)": lambda x, y: abs(arb(0.3) * x - arb(0.1) * y).sqrt(),
    "exp(x)": lambda x, _: (arb(0.7) * x).exp(),
    "tanh(x)": lambda x, _: (arb(0.7) * x).tanh(),
    "exp(-x) * sqrt(abs(y))": lambda x, y: (-arb(0.7) * x).exp() * abs(arb(0.7) * y).sqrt(),
}


@pytest.mark.parametrize("precision", Precision)
@pytest.mark.parametrize("function", REALS)
def test_functions_stay_within_their_bounds(function: str, precision: Precision) -> None:
    body = function.replace("x2", "abs(0.3 * peek(x, -1) - 0.1 * peek(y, -1))")
    body = re.sub(r"\b([xy])\b(?!,)", r"(0.7 * peek(\1, -1))", body)
    program = small(body, "[-30, 30]")
    (bound,) = rounding(program, precision).steps
    rng = random.Random(3)
    old = ctx.prec
    ctx.prec = 200
    try:
        for readings, previous in histories(program, precision, 1, rng, 300):
            ((raw, _),) = computed(program, readings, previous, precision, 1)
            x, y = (arb(readings[name][-1]) for name in "xy")
            real = REALS[function](x, y)
            most = bound.raw["A"]
            assert most is not None
            assert not abs(arb(raw["A"]) - real) > most
    finally:
        ctx.prec = old


@pytest.mark.parametrize(
    ("body", "sensor", "bound64"),
    [
        # Nothing is rounded.
        ("peek(x, -1)", "[-1, 1]", 0.0),
        ("0 - abs(peek(x, -1))", "[-1, 1]", 0.0),
        ("max(peek(x, -1), min(peek(y, -1), 0.25))", "[-1, 1]", 0.0),
        # One rounding of something up to 2 (but not beyond): half the distance of 1 and its
        # neighbour.
        ("peek(x, -1) + peek(y, -1)", "[-1, 1]", 2.0**-52),
        ("peek(x, -1) * peek(y, -1)", "[-1, 1]", 2.0**-53),
        ("peek(x, -1) / peek(y, -1)", "[1, 3]", 2.0**-52),
    ],
)
def test_bounds_worked_out_by_hand(body: str, sensor: str, bound64: float) -> None:
    (step,) = rounding(small(body, sensor), BINARY64).steps
    found = step.raw["A"]
    assert found is not None
    assert bound64 <= found <= bound64 * 1.000001


def test_constants_count_in_binary32() -> None:
    (step,) = rounding(small("0.1"), BINARY32).steps
    assert step.raw["A"] == abs(BINARY32.round(0.1) - 0.1)
    (step,) = rounding(small("0.1"), BINARY64).steps
    assert step.raw["A"] == 0.0


@pytest.mark.parametrize(
    "body",
    [
        "1 / peek(x, -1)",
        "sqrt(peek(x, -1))",
        "sqrt(0.5 - abs(peek(x, -1)) / 2 - 0.0000000000000001)",
        "exp(1000 * peek(x, -1))",
        "1e300 * peek(x, -1) * 1e300",
        "min(1, 1 / peek(x, -1))",
    ],
)
def test_no_finite_bound(body: str) -> None:
    for precision in Precision:
        (step,) = rounding(small(body), precision).steps
        assert step.raw["A"] is None
        # What leaves the controller lies between the action's bounds all the same.
        assert 2.0 <= step.applied["A"] < 2.0000001


def test_binary32_overflows_earlier() -> None:
    program = small("1e30 * peek(x, -1) * 1e20")
    assert rounding(program, BINARY64).steps[0].raw["A"] is not None
    assert rounding(program, BINARY32).steps[0].raw["A"] is None


def test_margins_of_comparisons() -> None:
    program = small(
        "if peek(x, -1) > 0 and 0.1 + peek(x, -1) < 1 / peek(y, -1)"
        " then sign(peek(x, -1) * 3) else 0"
    )
    (step,) = rounding(program, BINARY64).steps
    first, second, third = step.margins["A"]
    assert first == 0.0
    assert second is None
    assert third is not None
    assert 2.0**-52 <= third <= 2.0**-51


def test_what_a_step_applied_is_the_next_one_previous() -> None:
    program = small("previous(A) * 0.9 + 0.3 * peek(x, -1)")
    first, second, third = (s.raw["A"] for s in rounding(program, BINARY64, 3).steps)
    assert first is not None
    assert second is not None
    assert third is not None
    assert first < second < third
    assert second == pytest.approx(1.9 * first, rel=1e-6)


def test_filled_windows_lie_in_the_ranges() -> None:
    """The bounds speak of good readings; a window of zeros may lie outside."""
    program = replace(small("1 / peek(x, -1)", "[1, 2]"))
    assert program.interface.fill is Fill.FIRST
    assert rounding(program, BINARY64).steps[0].raw["A"] is not None


def worst_seen(program: Program, action: str, precision: Precision, seed: int) -> float:
    """The largest error that a random search with improvements finds."""
    rng = random.Random(seed)
    interface = program.interface

    def error(readings: dict[str, list[float]]) -> float:
        previous = {a.name: a.safe for a in interface.actions}
        ((raw, _),) = computed(program, readings, previous, precision, 1)
        (real,) = exact_steps(program, readings, previous, 1)
        return float(abs(Fraction(raw[action]) - real.raw[action]))

    worst, best = 0.0, None
    for trial in range(1500):
        if best is None or trial % 3 == 0:
            readings = {
                s.name: [
                    precision.round(rng.uniform(s.lower, s.upper)) for _ in range(interface.window)
                ]
                for s in interface.sensors
            }
        else:
            readings = {name: list(taken) for name, taken in best.items()}
            sensor = rng.choice(interface.sensors)
            place = rng.randrange(interface.window)
            readings[sensor.name][place] = precision.round(rng.uniform(sensor.lower, sensor.upper))
        seen = error(readings)
        if seen > worst:
            worst, best = seen, readings
    return worst


@pytest.mark.parametrize("precision", Precision)
@pytest.mark.parametrize("name", ["aalborg", "g-track-1"])
def test_not_absurdly_loose_on_the_printed_programs(name: str, precision: Precision) -> None:
    program = program_of((PRINTED / f"{name}.pirl").read_text())
    (step,) = rounding(program, precision).steps
    for action in program.interface.actions:
        bound = step.raw[action.name]
        assert bound is not None
        worst = worst_seen(program, action.name, precision, 7)
        assert worst <= bound <= 20 * worst


GAPPA = shutil.which("gappa")

STEER = """
@rnd = float<{format},ne>;
kp = rnd({kp}); ki = rnd({ki}); kd = rnd({kd});
{readings}
Se rnd= {sum};
S = {sum};
Y rnd= kp * (0 - x5) + ki * Se + kd * (x4 - x5);
R = {kp} * (0 - x5) + {ki} * S + {kd} * (x4 - x5);
{{ {ranges} -> Y - R in ? }}
"""


@pytest.mark.skipif(GAPPA is None, reason="gappa (apt install gappa) is not here")
@pytest.mark.parametrize("precision", Precision)
@pytest.mark.parametrize("name", ["aalborg", "g-track-1"])
def test_gappa_finds_a_bound_of_the_same_size(name: str, precision: Precision) -> None:
    """On the steering of the printed programs: never above ours by more than its own looseness,
    and ours within a small factor."""
    program = program_of((PRINTED / f"{name}.pirl").read_text())
    values = {key.removeprefix("steer_"): Fraction(value) for key, value in program.values.items()}

    def exactly(x: Fraction) -> str:
        return f"({x.numerator}b-{x.denominator.bit_length() - 1})"

    fold = "(0 - x1)"
    for i in range(2, 6):
        fold = f"((0 - x{i}) + {fold})"
    text = STEER.format(
        format="ieee_64" if precision is BINARY64 else "ieee_32",
        readings="\n".join(f"x{i} = rnd(X{i});" for i in range(1, 6)),
        ranges=" /\\ ".join(f"X{i} in [-1, 1]" for i in range(1, 6)),
        sum=fold,
        **{key: exactly(values[key]) for key in ("kp", "ki", "kd")},
    )
    assert GAPPA is not None
    run = subprocess.run([GAPPA], input=text, capture_output=True, text=True, check=False)
    found = re.findall(r"\{(-?[0-9.e+-]+),", run.stdout + run.stderr)
    assert len(found) == 2, run.stderr
    theirs = max(abs(float(end)) for end in found)
    ours = rounding(program, precision).steps[0].raw["steer"]
    assert ours is not None
    print(f"{name} {precision.value}: ours {ours:.4g}, gappa's {theirs:.4g}")
    assert theirs / 1.5 <= ours <= 3 * theirs
