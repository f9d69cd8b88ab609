"""The interpreter, construct by construct, on numbers that were worked out by hand."""

from __future__ import annotations

import math
import struct
import subprocess
import sys

import pytest

from pirlc.ir.operators import Operator
from pirlc.ir.policy import (
    ActionSpec,
    Choice,
    Continuous,
    Fill,
    FixedParameter,
    Hold,
    Interface,
    Program,
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
from pirlc.ir.types import Bool, Discrete, Real, Sequence
from pirlc.semantics.interpreter import MISSING, OUT_OF_RANGE, SAFE_USED, initial_state, step
from pirlc.semantics.policies import InterpretedPolicy
from pirlc.semantics.precision import BINARY32, BINARY64, Precision

INF, NAN = math.inf, math.nan
BIG = 1.7976931348623157e308
TINY = 5e-324


def apply(operator: Operator, *arguments: Term | float) -> Term:
    return Apply(operator, tuple(a if not isinstance(a, float) else Literal(a) for a in arguments))


def program(
    *bodies: Term,
    actions: tuple[ActionSpec, ...] | None = None,
    sensors: tuple[Sensor, ...] = (Sensor("h", -10.0, 10.0, 0),),
    parameters: dict[str, float] | None = None,
    window: int = 3,
    latency: int = 0,
    fill: Fill = Fill.FIRST,
) -> Program:
    wide = Continuous(-1e300, 1e300)
    given = actions or tuple(ActionSpec(f"A{i}", wide, i) for i in range(len(bodies)))
    fixed = tuple(FixedParameter(name, value) for name, value in (parameters or {}).items())
    return Program(Interface("p", None, sensors, given, window, None, latency, fill), fixed, bodies)


def run(
    of: Program, *observations: float | tuple[float, ...], precision: Precision = BINARY64
) -> list[object]:
    """The step results for readings of the first sensor, or for whole observations."""
    state, results = initial_state(of, precision), []
    for observation in observations:
        vector = observation if isinstance(observation, tuple) else (observation,)
        result = step(of, state, vector, precision)
        state = result.state
        results.append(result)
    return results


def raw(of: Program, *observations: float, precision: Precision = BINARY64) -> list[float]:
    return [result.raw[0] for result in run(of, *observations, precision=precision)]


def actions(of: Program, *observations: float | tuple[float, ...]) -> list[float]:
    return [result.actions[0] for result in run(of, *observations)]


def bits(x: float) -> bytes:
    return b"NaN" if math.isnan(x) else struct.pack("<d", x)


H = SensorRef("h", 3)
NOW = Peek(H, -1)

OPERATORS = [
    (Operator.ADD, (1.0, 2.0), 3.0),
    (Operator.ADD, (-0.0, -0.0), -0.0),
    (Operator.ADD, (BIG, BIG), INF),
    (Operator.SUBTRACT, (1.0, 1.0), 0.0),
    (Operator.SUBTRACT, (TINY, TINY), 0.0),
    (Operator.MULTIPLY, (-0.0, 3.0), -0.0),
    (Operator.MULTIPLY, (BIG, -2.0), -INF),
    (Operator.MULTIPLY, (TINY, 0.5), 0.0),
    (Operator.DIVIDE, (1.0, 3.0), 1.0 / 3.0),
    (Operator.DIVIDE, (1.0, 0.0), INF),
    (Operator.DIVIDE, (1.0, -0.0), -INF),
    (Operator.DIVIDE, (-2.0, 0.0), -INF),
    (Operator.DIVIDE, (0.0, 0.0), NAN),
    (Operator.DIVIDE, (0.0, -3.0), -0.0),
    (Operator.DIVIDE, (BIG, TINY), INF),
    (Operator.NEGATE, (0.0,), -0.0),
    (Operator.NEGATE, (-2.5,), 2.5),
    (Operator.ABS, (-0.0,), 0.0),
    (Operator.ABS, (-2.5,), 2.5),
    (Operator.MIN, (1.0, 2.0), 1.0),
    (Operator.MIN, (0.0, -0.0), -0.0),
    (Operator.MIN, (-0.0, 0.0), 0.0),
    (Operator.MAX, (1.0, 2.0), 2.0),
    (Operator.MAX, (0.0, -0.0), -0.0),
    (Operator.CLIP, (5.0, 0.0, 1.0), 1.0),
    (Operator.CLIP, (-5.0, 0.0, 1.0), 0.0),
    (Operator.CLIP, (-0.0, 0.0, 1.0), -0.0),
    (Operator.CLIP, (0.5, 1.0, 0.0), 1.0),
    (Operator.CLIP, (2.0, 1.0, 0.0), 0.0),
    (Operator.SQRT, (2.0,), 1.4142135623730951),
    (Operator.SQRT, (-0.0,), -0.0),
    (Operator.SQRT, (-1.0,), NAN),
    (Operator.EXP, (0.0,), 1.0),
    (Operator.EXP, (1000.0,), INF),
    (Operator.EXP, (-1000.0,), 0.0),
    (Operator.TANH, (-0.0,), -0.0),
    (Operator.TANH, (50.0,), 1.0),
    (Operator.SIGN, (3.0,), 1.0),
    (Operator.SIGN, (-TINY,), -1.0),
    (Operator.SIGN, (-0.0,), 0.0),
]


@pytest.mark.parametrize(("operator", "arguments", "result"), OPERATORS)
def test_operators(operator: Operator, arguments: tuple[float, ...], result: float) -> None:
    [value] = raw(program(apply(operator, *arguments)), 0.0)
    assert bits(value) == bits(result)


NOT_A_NUMBER = apply(Operator.DIVIDE, 0.0, 0.0)
INFINITE = apply(Operator.DIVIDE, 1.0, 0.0)


@pytest.mark.parametrize(
    ("term", "result"),
    [
        (apply(Operator.MIN, NOT_A_NUMBER, 1.0), 1.0),
        (apply(Operator.MIN, 1.0, NOT_A_NUMBER), NAN),
        (apply(Operator.MAX, NOT_A_NUMBER, 1.0), 1.0),
        (apply(Operator.MAX, 1.0, NOT_A_NUMBER), NAN),
        (apply(Operator.CLIP, NOT_A_NUMBER, 0.0, 1.0), NAN),
        (apply(Operator.CLIP, 0.5, NOT_A_NUMBER, 1.0), 0.5),
        (apply(Operator.SIGN, NOT_A_NUMBER), NAN),
        (apply(Operator.SUBTRACT, INFINITE, INFINITE), NAN),
        (apply(Operator.SQRT, INFINITE), INF),
        (apply(Operator.EXP, apply(Operator.NEGATE, INFINITE)), 0.0),
        (apply(Operator.TANH, INFINITE), 1.0),
        (apply(Operator.MULTIPLY, INFINITE, 0.0), NAN),
        (apply(Operator.DIVIDE, INFINITE, -0.0), -INF),
        (apply(Operator.DIVIDE, NOT_A_NUMBER, 0.0), NAN),
    ],
)
def test_not_a_number_and_infinity(term: Term, result: float) -> None:
    [value] = raw(program(term), 0.0)
    assert bits(value) == bits(result)


@pytest.mark.parametrize(
    ("operator", "less", "same", "more", "nan"),
    [
        (Operator.LESS, 1, 0, 0, 0),
        (Operator.LESS_EQUAL, 1, 1, 0, 0),
        (Operator.GREATER, 0, 0, 1, 0),
        (Operator.GREATER_EQUAL, 0, 1, 1, 0),
        (Operator.EQUAL, 0, 1, 0, 0),
        (Operator.NOT_EQUAL, 1, 0, 1, 1),
    ],
)
def test_comparisons(operator: Operator, less: int, same: int, more: int, nan: int) -> None:
    def holds(a: Term | float, b: Term | float) -> float:
        return raw(program(If(apply(operator, a, b), Literal(1.0), Literal(0.0))), 0.0)[0]

    assert [holds(1.0, 2.0), holds(0.0, -0.0), holds(2.0, 1.0)] == [less, same, more]
    assert [holds(NOT_A_NUMBER, 1.0), holds(1.0, NOT_A_NUMBER)] == [nan, nan]
    assert holds(NOT_A_NUMBER, NOT_A_NUMBER) == nan


@pytest.mark.parametrize("a", [False, True])
@pytest.mark.parametrize("b", [False, True])
def test_logic(a: bool, b: bool) -> None:
    def truth(value: bool) -> Term:
        return apply(Operator.GREATER, 1.0 if value else -1.0, 0.0)

    def holds(term: Term) -> bool:
        return bool(raw(program(If(term, Literal(1.0), Literal(0.0))), 0.0)[0])

    assert holds(apply(Operator.AND, truth(a), truth(b))) == (a and b)
    assert holds(apply(Operator.OR, truth(a), truth(b))) == (a or b)
    assert holds(apply(Operator.IMPLIES, truth(a), truth(b))) == (not a or b)
    assert holds(apply(Operator.NOT, truth(a))) == (not a)
    assert holds(Let("g", truth(a), LocalRef("g", Bool()))) == a


def test_only_the_taken_branch_counts() -> None:
    body = If(apply(Operator.GREATER, 1.0, 0.0), Literal(4.0), NOT_A_NUMBER)
    assert raw(program(body), 0.0) == [4.0]


def test_peeks_count_from_the_newest() -> None:
    for index, expected in ((-1, [1, 2, 3, 4]), (-2, [1, 1, 2, 3]), (-3, [1, 1, 1, 2])):
        assert raw(program(Peek(H, index)), 1.0, 2.0, 3.0, 4.0) == expected


def test_folds_start_from_the_oldest() -> None:
    # 0.1 + (0.2 + 0.3) and (0.1 + 0.2) + 0.3 differ: the newest element is added last, on the left.
    assert raw(program(Fold(Operator.ADD, H)), 0.3, 0.2, 0.1)[-1] == 0.1 + (0.2 + 0.3)
    assert raw(program(Fold(Operator.ADD, H)), 0.1, 0.2, 0.3)[-1] == 0.3 + (0.2 + 0.1)
    assert raw(program(Fold(Operator.MULTIPLY, H)), 2.0, 3.0, 5.0)[-1] == 30.0
    assert raw(program(Fold(Operator.MIN, H)), 2.0, 1.0, 5.0)[-1] == 1.0
    assert raw(program(Fold(Operator.MAX, H)), 2.0, 1.0, 5.0)[-1] == 5.0


def test_fold_min_keeps_the_older_of_equal_elements() -> None:
    # element < acc ? element : acc -- the accumulator stays where they are equal.
    [*_, last] = raw(program(Fold(Operator.MIN, H)), 0.0, -0.0, -0.0)
    assert bits(last) == bits(0.0)
    [*_, last] = raw(program(Fold(Operator.MAX, H)), -0.0, 0.0, 0.0)
    assert bits(last) == bits(-0.0)


def test_a_sum_of_negative_zeros_has_no_leading_zero() -> None:
    assert bits(raw(program(Fold(Operator.ADD, H)), -0.0)[0]) == bits(-0.0)


def test_fold_with_a_lambda() -> None:
    # Horner's rule: acc * 10 + v.
    v, acc = LocalRef("v", Real()), LocalRef("acc", Real())
    body = apply(Operator.ADD, apply(Operator.MULTIPLY, acc, 10.0), v)
    assert raw(program(FoldLambda("v", "acc", body, H, Literal(0.0))), 1.0, 2.0, 3.0)[-1] == 123.0


def test_differences_are_newer_minus_older() -> None:
    assert raw(program(Peek(Diff(H), -1)), 1.0, 4.0, 9.0) == [0.0, 3.0, 5.0]
    assert raw(program(Fold(Operator.MAX, Diff(Diff(H)))), 1.0, 4.0, 9.0)[-1] == 2.0


def test_atoms_stand_beside_every_element() -> None:
    e = apply(Operator.SUBTRACT, 10.0, H)
    both = apply(Operator.MULTIPLY, LocalRef("e", Sequence(3)), H)
    body = Let("e", e, Fold(Operator.ADD, both))
    assert raw(program(body), 1.0, 2.0, 3.0)[-1] == 7.0 * 3.0 + (8.0 * 2.0 + 9.0 * 1.0)


def test_an_inner_let_hides_an_outer_one() -> None:
    x = LocalRef("x", Real())
    body = Let("x", Literal(2.0), apply(Operator.ADD, Let("x", apply(Operator.ADD, x, 1.0), x), x))
    assert raw(program(body), 0.0) == [5.0]


def test_parameters() -> None:
    of = program(apply(Operator.MULTIPLY, ParameterRef("k"), NOW), parameters={"k": 1.5})
    assert raw(of, 2.0) == [3.0]


def test_previous_is_the_applied_action_and_starts_at_safe() -> None:
    one = ActionSpec("A", Continuous(0.0, 2.0, 0.5), 0)
    body = apply(Operator.ADD, PreviousAction("A", Real()), 1.0)
    assert actions(program(body, actions=(one,)), 0.0, 0.0, 0.0) == [1.5, 2.0, 2.0]


def test_every_action_sees_the_actions_of_the_step_before() -> None:
    specs = tuple(ActionSpec(name, Continuous(-9.0, 9.0, 0.0), i) for i, name in enumerate("AB"))
    count = apply(Operator.ADD, PreviousAction("A", Real()), 1.0)
    results = run(program(count, PreviousAction("A", Real()), actions=specs), 0.0, 0.0, 0.0)
    assert [r.actions for r in results] == [(1.0, 0.0), (2.0, 1.0), (3.0, 2.0)]


@pytest.mark.parametrize(
    ("domain", "safe"),
    [
        (Continuous(-1.0, 1.0), 0.0),
        (Continuous(2.0, 3.0), 2.0),
        (Continuous(-3.0, -2.0), -2.0),
        (Continuous(-3.0, -2.0, -2.5), -2.5),
    ],
)
def test_safe_values_of_continuous_actions(domain: Continuous, safe: float) -> None:
    [result] = run(program(NOT_A_NUMBER, actions=(ActionSpec("A", domain, 0),)), 0.0)
    assert (result.actions, result.status) == ((safe,), SAFE_USED)


def test_clipping() -> None:
    one = (ActionSpec("A", Continuous(0.0, 2.0), 0),)
    of = program(NOW, actions=one)
    assert actions(of, -1.0, 1.0, 3.0) == [0.0, 1.0, 2.0]
    assert bits(actions(of, -0.0)[0]) == bits(-0.0), "-0 is not below 0"
    assert actions(program(INFINITE, actions=one), 0.0) == [2.0]


def test_discrete_actions() -> None:
    values = Discrete((3, 1, 2))
    spec = ActionSpec("A", Choice((3, 1, 2)), 0)
    was_three = apply(Operator.EQUAL, PreviousAction("A", values), DiscreteLiteral(3, values))
    body = If(was_three, DiscreteLiteral(2, values), DiscreteLiteral(3, values))
    results = actions(program(body, actions=(spec,)), 0.0, 0.0, 0.0)
    assert results == [2, 3, 2]
    assert all(isinstance(value, int) for value in results)


def test_a_failed_reading_makes_every_action_safe() -> None:
    values = Discrete((0, 1))
    specs = (ActionSpec("A", Continuous(-5.0, 5.0, -4.0), 0), ActionSpec("B", Choice((0, 1), 1), 1))
    of = program(
        NOW,
        DiscreteLiteral(0, values),
        actions=specs,
        sensors=(Sensor("h", -10.0, 10.0, 0, Hold(0)),),
    )
    good, bad, again = run(of, 2.0, NAN, 3.0)
    assert (good.actions, good.status, good.flags) == ((2.0, 0), 0, (0,))
    assert (bad.actions, bad.status, bad.flags) == ((-4.0, 1), MISSING | SAFE_USED, (MISSING,))
    assert bad.raw == (2.0, 0), "the window holds the last good reading"
    assert (again.actions, again.status) == ((3.0, 0), 0)


NEWEST_TWO = apply(Operator.ADD, apply(Operator.MULTIPLY, NOW, 100.0), Peek(H, -2))


@pytest.mark.parametrize(
    ("missing", "fill", "expected"),
    [
        # 100 * newest + the one before, for the readings NaN 1 inf 2 (range [0, 10]).
        (Hold(), Fill.FIRST, [505, 101, 101, 201]),
        (Hold(), Fill.ZERO, [0, 100, 101, 201]),
        (Zero(), Fill.FIRST, [505, 101, 1, 200]),
        (Zero(), Fill.ZERO, [0, 100, 1, 200]),
    ],
)
def test_warm_up_and_missing_readings(missing: Hold | Zero, fill: Fill, expected: list) -> None:
    of = program(NEWEST_TWO, sensors=(Sensor("h", 0.0, 10.0, 0, missing),), fill=fill)
    assert raw(of, NAN, 1.0, INF, 2.0) == expected


@pytest.mark.parametrize("fill", list(Fill))
def test_staleness_limit_counts_from_the_last_good_reading_or_the_start(fill: Fill) -> None:
    of = program(NOW, sensors=(Sensor("h", -10.0, 10.0, 0, Hold(2)),), fill=fill)
    readings = [NAN, NAN, NAN, NAN, 1.0, NAN, NAN, NAN, NAN, NAN, 1.0, NAN]
    failed = [bool(r.status & SAFE_USED) for r in run(of, *readings)]
    assert failed == [False, False, True, True, False, False, False, True, True, True, False, False]


def test_latency_delays_readings_and_nothing_else() -> None:
    of = program(NOW, latency=2, sensors=(Sensor("h", 0.0, 10.0, 0, Hold(0)),))
    results = run(of, 1.0, 2.0, 3.0, NAN, 20.0)
    assert [r.raw[0] for r in results] == [1.0, 1.0, 1.0, 2.0, 3.0]
    assert [r.status for r in results] == [0, 0, 0, MISSING | SAFE_USED, OUT_OF_RANGE]


def test_ranges_are_widened_to_binary32() -> None:
    of = program(NOW, sensors=(Sensor("h", -0.1, 0.1, 0),))
    seen = struct.unpack("<f", struct.pack("<f", 0.1))[0]
    assert seen > 0.1
    status = [r.status for r in run(of, seen, -seen, math.nextafter(seen, 1.0), 0.2, -0.2)]
    assert status == [0, 0, OUT_OF_RANGE, OUT_OF_RANGE, OUT_OF_RANGE]


def test_each_sensor_has_its_flags() -> None:
    sensors = (Sensor("h", 0.0, 1.0, 2), Sensor("g", 0.0, 1.0, 0))
    of = program(NOW, sensors=sensors)
    [result] = run(of, (5.0, 0.0, NAN))
    assert result.flags == (MISSING, OUT_OF_RANGE)
    assert result.status == MISSING | OUT_OF_RANGE


def test_binary32_rounds_every_operation() -> None:
    third = apply(Operator.DIVIDE, 1.0, 3.0)
    assert raw(program(third), 0.0, precision=BINARY32) == [0.3333333432674408]
    assert raw(program(Literal(0.1)), 0.0, precision=BINARY32) == [0.10000000149011612]
    assert raw(program(Literal(1e300)), 0.0, precision=BINARY32) == [INF]
    assert raw(program(ParameterRef("p"), parameters={"p": 1e-60}), 0.0, precision=BINARY32) == [0]
    assert raw(program(NOW), 0.1, precision=BINARY32) == [0.10000000149011612]
    one = (ActionSpec("A", Continuous(0.0, 0.1), 0),)
    [result] = run(program(NOW, actions=one), 5.0, precision=BINARY32)
    assert result.actions == (0.10000000149011612,)


def test_a_reading_too_large_for_binary32_is_missing_there() -> None:
    wide = (Sensor("h", -1e300, 1e300, 0),)
    of = program(NOW, sensors=wide)
    assert [r.status for r in run(of, 1e200)] == [0]
    assert [r.status for r in run(of, 1e200, precision=BINARY32)] == [MISSING]


def test_the_policy_acts_in_component_order_and_resets() -> None:
    specs = (
        ActionSpec("A", Continuous(-9.0, 9.0), 1),
        ActionSpec("B", Continuous(-9.0, 9.0, 0.0), 0),
    )
    of = program(NOW, apply(Operator.ADD, PreviousAction("B", Real()), 1.0), actions=specs)
    policy = InterpretedPolicy(of)
    assert [policy.act((5.0,)), policy.act((7.0,))] == [(1.0, 5.0), (2.0, 7.0)]
    policy.reset()
    assert policy.act((3.0,)) == (1.0, 3.0)


def test_the_interpreter_loads_no_numpy() -> None:
    code = "import sys, pirlc.semantics.policies; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
