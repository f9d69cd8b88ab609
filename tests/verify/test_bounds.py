"""Tight bounds: known answers by hand, random programs against sampling and vertices."""

from __future__ import annotations

import itertools
import random
import re
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest

from pirlc.frontend import parse_sketch
from pirlc.ir.evidence import Kind
from pirlc.ir.expansion import close
from pirlc.ir.operators import Operator
from pirlc.ir.policy import Choice, Continuous, Program
from pirlc.semantics.precision import BINARY64, Precision, widened
from pirlc.source import SourceText
from pirlc.verify.bounds.actions import bounds
from pirlc.verify.exact import exact_steps
from pirlc.verify.findings import ActionBounds, ChoiceBounds, Extreme
from pirlc.verify.properties.asking import Limits
from pirlc.verify.replay import Trial, run
from tests.support.programs import Kinds, random_program

EXAMPLES = Path(__file__).parents[2] / "examples"
CLOSE = Fraction(1, 10**9)


def program_of(text: str) -> Program:
    program = close(parse_sketch(SourceText("test.pirl", text)))
    assert program is not None
    return program


def small(body: str, action: str = "[-100, 100]", window: int = 2) -> Program:
    return program_of(
        f"policy p\nsensor x : [-1, 1] = 0\nsensor y : [0, 2] = 1\nwindow {window}\n"
        f"action A : {action} safe 0 = {body}\n"
    )


def of(program: Program) -> ActionBounds:
    (found,) = bounds(program)
    assert isinstance(found, ActionBounds)
    return found


def extremes(found: ActionBounds) -> Iterator[tuple[str, Extreme]]:
    for name in ("lower", "upper", "change"):
        for stage in ("raw", "applied"):
            yield f"{stage}_{name}", getattr(found, f"{stage}_{name}")


def value_at(program: Program, found: ActionBounds, which: str, extreme: Extreme) -> Fraction:
    """What the witness gives, in exact arithmetic."""
    assert extreme.witness is not None
    history = extreme.witness.history
    steps = exact_steps(
        program, history.readings, history.previous, 2 if which.endswith("change") else 1
    )
    values = [
        Fraction((s.raw if which.startswith("raw") else s.applied)[found.action]) for s in steps
    ]
    return abs(values[1] - values[0]) if which.endswith("change") else values[0]


def test_the_papers_programs() -> None:
    """A PID on e = target - h over five readings, with gains P, I, D, weighs the readings, newest
    first, with -(P + I + D), D - I, -I, -I, -I: the extremes are at the ranges' ends."""
    q = Fraction
    for name, gains in {
        "aalborg": {
            "steer": (0.97, 0.05, 49.98),
            "accel": (3.97, 0.01, 48.79),
            "setpoints": (0.40, 0.44),
        },
        "g-track-1": {
            "steer": (0.86, 0.09, 46.51),
            "accel": (0.95, 5.02, 43.89),
            "setpoints": (0.60, 0.64),
        },
    }.items():
        program = program_of((EXAMPLES / "torcs" / "printed" / f"{name}.pirl").read_text())
        steer, accel = bounds(program)
        assert isinstance(steer, ActionBounds)
        assert isinstance(accel, ActionBounds)
        p, i, d = map(q, gains["steer"])
        top = (p + i + d) + abs(d - i) + 3 * i
        assert steer.raw_upper.value == top
        assert steer.raw_lower.value == -top
        assert (steer.applied_lower.value, steer.applied_upper.value) == (-1, 1)
        # One step on, a reading has moved to the next weight: the differences of neighbours count.
        weights = [-(p + i + d), d - i, -i, -i, -i]
        moves = [a - b for a, b in zip([*weights, q(0)], [q(0), *weights], strict=True)]
        assert steer.raw_change.value == sum(map(abs, moves))
        assert steer.applied_change.value == 2
        p, i, d = map(q, gains["accel"])
        slow, fast = map(q, gains["setpoints"])
        weights = [-(p + i + d), d - i, -i, -i, -i]
        gain = p + 5 * i
        assert accel.raw_upper.value == fast * gain + sum(max(w, q(0)) for w in weights)
        assert accel.raw_lower.value == slow * gain + sum(min(w, q(0)) for w in weights)
        moves = [a - b for a, b in zip([*weights, q(0)], [q(0), *weights], strict=True)]
        up = sum(max(m, q(0)) for m in moves)
        down = sum(max(-m, q(0)) for m in moves)
        assert accel.raw_change.value == max(up, down) + (fast - slow) * gain
        for found in (steer, accel):
            for which, extreme in extremes(found):
                assert extreme.attained
                assert extreme.evidence.kind is Kind.PROVED
                off = abs(value_at(program, found, which, extreme) - extreme.value)
                assert off <= CLOSE
    aalborg = program_of((EXAMPLES / "torcs" / "printed" / "aalborg.pirl").read_text())
    steer, accel = bounds(aalborg)
    assert isinstance(steer, ActionBounds)
    assert isinstance(accel, ActionBounds)
    # The paper's universal bounds: |Steer| < 101.08 and -54.53 < Accel < 53.03.
    assert steer.raw_upper.value is not None
    assert abs(steer.raw_upper.value - q("101.08")) < q(1, 10**13)
    assert accel.raw_upper.value == pytest.approx(q("50.5488"), abs=1e-13)
    assert accel.raw_lower.value == pytest.approx(q("-51.192"), abs=1e-13)


@pytest.mark.parametrize(
    ("body", "lower", "upper", "change"),
    [
        ("peek(x, -1)", (-1, True), (1, True), (2, True)),
        ("abs(peek(x, -1)) - peek(y, -1)", (-2, True), (1, True), (3, True)),
        ("0.5", (0.5, True), (0.5, True), (0, True)),
        ("fold(max, x) - fold(min, y)", (-3, True), (1, True), (4, True)),
        # Not attained: the branch is open where its value is largest.
        ("if peek(x, -1) < 0.5 then peek(x, -1) else -2", (-2, True), (0.5, False), (2.5, False)),
        ("if peek(x, -1) <= 0.5 then peek(x, -1) else -2", (-2, True), (0.5, True), (2.5, True)),
        # A limit of the rate: the change is the limit's, wherever it starts.
        (
            "previous(A) + clip(100 * peek(x, -1) - previous(A), -0.25, 0.25)",
            (-100, True),
            (100, True),
            (0.25, True),
        ),
        ("sign(peek(x, -1)) * peek(y, -1)", (-2, True), (2, True), (4, True)),
    ],
)
def test_worked_out_by_hand(
    body: str, lower: tuple[float, bool], upper: tuple[float, bool], change: tuple[float, bool]
) -> None:
    program = small(body)
    found = of(program)
    for extreme, (value, attained) in (
        (found.raw_lower, lower),
        (found.raw_upper, upper),
        (found.raw_change, change),
    ):
        assert extreme.value == Fraction(value)
        assert extreme.attained == attained
        assert extreme.evidence.kind is Kind.PROVED
    for which, extreme in extremes(found):
        assert extreme.value is not None
        assert abs(value_at(program, found, which, extreme) - extreme.value) <= CLOSE


def test_clipped() -> None:
    found = of(small("3 * peek(x, -1)", "[-2, 0.5]"))
    assert found.raw_upper.value == 3
    assert found.applied_upper.value == Fraction(1, 2)
    assert found.applied_lower.value == -2
    assert found.applied_change.value == Fraction(5, 2)
    assert found.rounding64 is not None
    assert found.rounding32 is not None
    assert found.rounding64 < found.rounding32 < 1e-6


@pytest.mark.parametrize("precision", Precision)
def test_bounds_of_what_runs(precision: Precision) -> None:
    """Guards that rounding turns, and rounding, stay inside; they are hardly wider than the
    bounds over the reals."""
    body = (
        "if 0.1 * peek(x, -1) + 0.2 * peek(x, -2) < 0.3 * peek(y, -1) then peek(x, -1) / 3 else 2"
    )
    program = small(body)
    found = of(program)
    computed = found.binary64 if precision is BINARY64 else found.binary32
    assert computed is not None
    assert computed.raw_lower is not None
    assert computed.raw_upper is not None
    assert computed.raw_change is not None
    assert computed.applied_change is not None
    assert found.raw_lower.value is not None
    assert found.raw_change.value is not None
    off = 2.0**-50 if precision is BINARY64 else 2.0**-22
    assert abs(found.raw_lower.value - Fraction(computed.raw_lower)) <= off
    assert abs(found.raw_change.value - Fraction(computed.raw_change)) <= off
    rng = random.Random(9)
    for readings, previous in some_histories(program, 2, rng, 300):
        if rng.random() < 0.5:
            # On the guard's boundary, nearly.
            readings["y"] = [abs(x) for x in readings["x"]]
            readings["x"][:-1] = readings["x"][1:]
        given = {s: tuple(map(precision.round, taken)) for s, taken in readings.items()}
        steps = run(program, Trial(given, previous), precision)
        raw = [step.raw["A"] for step in steps]
        assert all(computed.raw_lower <= value <= computed.raw_upper for value in raw)
        assert abs(Fraction(raw[1]) - Fraction(raw[0])) <= computed.raw_change


def test_nonlinear_actions_run_in_the_range_of_floats() -> None:
    found = of(small("exp(peek(x, -1))"))
    assert found.binary64 is not None
    assert found.binary64.raw_upper is None
    found = of(small("peek(x, -1) * peek(y, -1)"))
    assert found.binary64 is not None
    assert (found.binary64.raw_lower, found.binary64.raw_upper) == (-2.0, 2.0)


def test_ranges_are_widened_to_binary32() -> None:
    program = program_of("policy p\nsensor x : [-1, 0.1] = 0\naction A : [-1, 1] = peek(x, -1)\n")
    assert of(program).raw_upper.value == Fraction(widened(-1.0, 0.1)[1]) > Fraction(0.1)


@pytest.mark.parametrize(
    ("body", "lower", "upper"),
    [
        ("peek(x, -1) * peek(y, -1)", -2, 2),
        ("peek(x, -1) * peek(x, -1)", 0, 1),
        ("1 / (2 + peek(x, -1))", Fraction(1, 3), 1),
        ("sqrt(peek(y, -1) + 2)", None, 2),
        # A guard that is no hyperplane, over branches that are.
        ("if peek(x, -1) * peek(y, -1) > 0.5 then peek(x, -1) else -peek(y, -1)", -2, 1),
    ],
)
def test_beyond_linear(body: str, lower: Fraction | None, upper: Fraction | None) -> None:
    found = of(small(body))
    for extreme, value in ((found.raw_lower, lower), (found.raw_upper, upper)):
        assert extreme.evidence.kind is Kind.PROVED
        assert extreme.value is not None
        if value is not None:
            assert abs(extreme.value - value) <= CLOSE


def test_irrational_suprema_are_within_a_billionth() -> None:
    found = of(small("exp(peek(x, -1)) + tanh(peek(y, -1))"))
    assert found.raw_upper.value == pytest.approx(2.718281828459045 + 0.9640275800758169, abs=1e-9)
    assert found.raw_lower.value == pytest.approx(0.36787944117144233, abs=1e-9)
    assert str(found.raw_upper.evidence) == "proved (to within 1e-9)"
    assert found.raw_upper.witness is not None
    assert found.raw_upper.witness.steps[0].raw["A"] == pytest.approx(3.682309408535, abs=1e-9)


def test_what_is_not_found_is_unknown_with_an_enclosure() -> None:
    found = of(small("(peek(x, -1) - peek(y, -1)) * (peek(y, -1) - 3 * peek(x, -2)) * peek(x, -2)"))
    assert found.raw_lower.value == -3
    assert found.raw_upper.value == 15
    assert found.raw_change.evidence.kind is Kind.UNKNOWN
    assert found.raw_change.value is None
    low, high = map(float, re.findall(r"[0-9.]+(?= and| after)", found.raw_change.evidence.reason))
    assert 15.9 < low < 16 < high < 16.1


def test_a_division_by_zero_leaves_no_bound() -> None:
    found = of(small("1 / peek(x, -1)", "[-1, 1]"))
    assert found.raw_upper.value is None
    assert found.raw_upper.evidence.kind is Kind.UNKNOWN
    assert "a division by zero" in found.raw_upper.evidence.reason
    assert (found.applied_lower.value, found.applied_upper.value) == (-1, 1)
    assert found.rounding64 is None


def test_limits_make_it_unknown() -> None:
    program = small("if fold(+, x) > fold(max, y) - 1 then fold(+, abs(x - y)) else fold(min, x)")
    (found,) = bounds(program, Limits(work=5))
    assert isinstance(found, ActionBounds)
    assert found.raw_upper.value is None
    assert found.raw_upper.evidence.kind is Kind.UNKNOWN
    assert "limit" in found.raw_upper.evidence.reason


def test_values_of_a_discrete_action() -> None:
    program = program_of(
        "policy p\nsensor x : [-1, 1] = 0\n"
        "action A : {0, 1, 2, 5} =\n"
        "  if peek(x, -1) > 0 then 1 else if peek(x, -1) > 3 then 2 else 5\n"
    )
    (found,) = bounds(program)
    assert isinstance(found, ChoiceBounds)
    assert found.values == (1, 5)
    assert found.unreachable == (0, 2)
    assert found.evidence.kind is Kind.PROVED


def test_what_only_a_nan_takes_is_not_called_never_taken() -> None:
    program = program_of(
        "policy p\nsensor x : [0, 1] = 0\n"
        "action A : {0, 1, 2} =\n"
        "  let q = peek(x, -1) / peek(x, -1) in if q > 0 then 1 else if q <= 0 then 2 else 0\n"
    )
    (found,) = bounds(program)
    assert isinstance(found, ChoiceBounds)
    assert found.unreachable == ()
    assert found.evidence.kind is Kind.UNKNOWN
    assert "a division by zero" in found.evidence.reason


LINEAR = Kinds(
    odd_numbers=False,
    depth=4,
    operators=(
        Operator.ADD,
        Operator.SUBTRACT,
        Operator.NEGATE,
        Operator.ABS,
        Operator.MIN,
        Operator.MAX,
        Operator.CLIP,
        Operator.SIGN,
    ),
)


def some_histories(
    program: Program, steps: int, rng: random.Random, count: int
) -> Iterator[tuple[dict[str, list[float]], dict[str, float]]]:
    interface = program.interface
    for _ in range(count):
        corner = rng.random()
        readings = {}
        for sensor in interface.sensors:
            low, high = widened(sensor.lower, sensor.upper)
            readings[sensor.name] = [
                rng.choice((low, high)) if rng.random() < corner else rng.uniform(low, high)
                for _ in range(interface.window + steps - 1)
            ]
        previous: dict[str, float] = {}
        for action in interface.actions:
            match action.domain:
                case Continuous(low, high):
                    x = rng.choice((low, high, rng.uniform(low, high)))
                    previous[action.name] = min(max(x, low), high)
                case Choice(values):
                    previous[action.name] = rng.choice(values)
        yield readings, previous


def check_against_sampling(program: Program, rng: random.Random, count: int) -> int:
    """Nothing sampled exceeds a bound, and witnesses come within 1e-9; the bounds proved."""
    found = [f for f in bounds(program) if isinstance(f, ActionBounds)]
    proved = 0
    for readings, previous in some_histories(program, 2, rng, count):
        steps = exact_steps(program, readings, previous, 2)
        for one in found:
            raw = [s.raw[one.action] for s in steps]
            applied = [s.applied[one.action] for s in steps]
            for values, low, high, change in (
                (raw, one.raw_lower, one.raw_upper, one.raw_change),
                (applied, one.applied_lower, one.applied_upper, one.applied_change),
            ):
                assert low.value is None or all(low.value <= v for v in values)
                assert high.value is None or all(v <= high.value for v in values)
                assert change.value is None or abs(values[1] - values[0]) <= change.value
    for one in found:
        for which, extreme in extremes(one):
            assert extreme.evidence.kind is Kind.PROVED, (which, extreme.evidence)
            assert extreme.value is not None
            if extreme.witness is not None:
                value = value_at(program, one, which, extreme)
                assert abs(value - extreme.value) <= CLOSE
                proved += 1
    return proved


def check_random_linear_programs(seed: int, count: int) -> int:
    rng = random.Random(seed)
    proved = asked = 0
    while asked < count:
        program = random_program(rng, replace(LINEAR, depth=3 + asked % 3))
        if program.size > 80:
            continue
        asked += 1
        proved += check_against_sampling(program, rng, 30)
    return proved


def test_random_linear_programs_against_sampling() -> None:
    assert check_random_linear_programs(5, 20) > 80


@pytest.mark.slow
def test_many_random_linear_programs_against_sampling() -> None:
    assert check_random_linear_programs(6, 150) > 600


def test_affine_programs_against_all_vertices() -> None:
    """Without choices the extremes are at vertices of the box of histories."""
    rng = random.Random(11)
    for _ in range(15):
        weights = [round(rng.uniform(-3, 3), 2) for _ in range(4)]
        terms = "peek(x, -1)", "peek(x, -2)", "peek(y, -1)", "previous(A)"
        body = " + ".join(f"{w} * {t}" for w, t in zip(weights, terms, strict=True))
        program = small(body, "[-1, 0.5]")
        found = of(program)
        values: list[Fraction] = []
        changes: list[Fraction] = []
        sides = itertools.product([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0], [0.0, 2.0], [0.0, 2.0])
        for x2, x1, x0, y1, y0 in sides:
            for before in (-1.0, 0.5):
                readings = {"x": [x2, x1, x0], "y": [0.0, y1, y0]}
                first, second = exact_steps(program, readings, {"A": before}, 2)
                values.append(Fraction(first.raw["A"]))
                changes.append(abs(Fraction(second.raw["A"]) - Fraction(first.raw["A"])))
        assert found.raw_lower.value == min(values)
        assert found.raw_upper.value == max(values)
        # The second step starts from a clipped action, which may bend it between the vertices.
        assert found.raw_change.value is not None
        assert found.raw_change.value >= max(changes)


@pytest.mark.parametrize("name", ["racer-aalborg-0", "paper-aalborg-2", "noif-g-track-1-0"])
def test_synthesised_programs(name: str) -> None:
    program = program_of((EXAMPLES / "torcs" / "synthesised" / f"{name}.pirl").read_text())
    for found in bounds(program):
        assert isinstance(found, ActionBounds)
        for _, extreme in extremes(found):
            assert extreme.evidence.kind is Kind.PROVED
            assert extreme.witness is not None
