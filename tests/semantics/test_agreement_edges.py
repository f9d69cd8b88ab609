"""Each construct once, on every combination of edge values, by every evaluator.

Where libm is involved the evaluators differ in the last places: numpy, the C library and Python
each bring their own `exp` and `tanh`. `ULPS` is what this project promises.
"""

from __future__ import annotations

import itertools
import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pirlc.ir.operators import COMPARISONS, FOLDABLE, SIGNATURES, Operator
from pirlc.ir.policy import ActionSpec, Continuous, Interface, Program, Sensor
from pirlc.ir.terms import Apply, Fold, If, Literal, Peek, SensorRef, Term
from pirlc.ir.types import Real
from pirlc.lower import lower
from pirlc.semantics.histories import histories_of
from pirlc.semantics.precision import Precision
from pirlc.semantics.vectorised import apply_actions, evaluate
from tests.support.emitted import (
    Case,
    Library,
    compare_all,
    differences,
    interpreted,
    random_case,
    run_c,
    run_python,
)
from tests.support.programs import LIBM, Kinds

EDGES = (0.0, -0.0, 1.0, -1.0, 0.1, 5e-324, -1e-310, 1e-40, 3.4e38, -1e38, 2.0**-126, 7.0)

ULPS = {Operator.EXP: 2, Operator.TANH: 4}
"""The most units in the last place by which two evaluators may differ on one exp or tanh."""


def quotient(index: int) -> Term:
    """Sensor S<i> by sensor T<i>: so NaN and infinities arise as operands."""
    return Apply(
        Operator.DIVIDE, (Peek(SensorRef(f"S{index}", 3), -1), Peek(SensorRef(f"T{index}", 3), -1))
    )


def policy(name: str, body: Term, operands: int) -> Program:
    sensors = [Sensor(f"S{i}", -4e38, 4e38, i) for i in range(operands)]
    sensors += [Sensor(f"T{i}", 0.0, 1.0, operands + i) for i in range(operands)]
    action = ActionSpec("A", Continuous(-1.7e308, 1.7e308, 12345.0), 0)
    return Program(Interface(name, None, tuple(sensors), (action,), window=3), (), (body,))


def edge_observations(operands: int) -> np.ndarray:
    """Every combination of edges; every operand also NaN and infinite."""
    operand = [(edge, 1.0) for edge in EDGES] + [(1.0, 0.0), (-1.0, 0.0), (0.0, 0.0)]
    rows = [
        [*(a for a, _ in combination), *(b for _, b in combination)]
        for combination in itertools.product(operand, repeat=operands)
    ]
    return np.array(rows)


def edge_cases() -> list[Case]:
    cases = []
    for precision, operator in itertools.product(Precision, Operator):
        signature = SIGNATURES[operator]
        if operator in LIBM or signature.argument != Real():
            continue
        operands = tuple(quotient(i) for i in range(signature.arity))
        body: Term = Apply(operator, operands)
        if operator in COMPARISONS:
            body = If(body, Literal(1.0), Literal(2.0))
        name = f"e{precision.value}{operator.name.lower()}"
        program = policy(name, body, signature.arity)
        cases.append(Case(program, precision, (edge_observations(signature.arity),)))
    for precision, operator in itertools.product(Precision, FOLDABLE):
        body = Fold(operator, SensorRef("S0", 3))
        edges = [[a, 1.0] for row in itertools.product(EDGES, repeat=3) for a in row]
        program = policy(f"f{precision.value}{operator.name.lower()}", body, 1)
        cases.append(Case(program, precision, (np.array(edges),)))
    return cases


def vectorised_actions(case: Case) -> np.ndarray:
    """The applied actions of a program that does not look at previous ones."""
    trajectories = [(o, np.zeros((len(o), 1))) for o in case.observations]
    histories = histories_of(case.program.interface, trajectories, case.precision)
    return apply_actions(evaluate(case.program, {}, histories), histories).actions


def test_every_operator_on_every_edge(tmp_path: Path) -> None:
    cases = edge_cases()
    tally = compare_all(cases, tmp_path)
    assert (tally.programs, tally.mismatches) == (2 * (17 + 4), 0)
    for case in cases:
        [trace] = interpreted(case)
        ours = np.ascontiguousarray(vectorised_actions(case))
        assert ours.tobytes() == trace.actions.tobytes(), case.program.interface.name


def ulps_apart(a: np.ndarray, b: np.ndarray, precision: Precision) -> int:
    """The largest number of steps between two arrays of numbers of one precision."""
    kind, bits = (
        (np.float64, np.int64) if precision is Precision.BINARY64 else (np.float32, np.int32)
    )

    def line(x: np.ndarray) -> np.ndarray:
        order = x.astype(kind).view(bits).astype(np.int64)
        return np.where(order < 0, np.iinfo(bits).min - order, order)

    return int(np.abs(line(a) - line(b)).max())


@pytest.mark.parametrize("precision", list(Precision))
@pytest.mark.parametrize("operator", LIBM)
def test_exp_and_tanh_within_their_bound(
    precision: Precision, operator: Operator, tmp_path: Path
) -> None:
    rng = random.Random(5)
    numbers = [
        *EDGES,
        *(rng.uniform(-1, 1) * 2.0 ** rng.uniform(-60, 11) for _ in range(20_000)),
        *(rng.uniform(-5, 5) for _ in range(20_000)),
    ]
    observations = np.array([[x, 1.0] for x in numbers])
    name = f"m{precision.value}{operator.name.lower()}"
    case = Case(policy(name, Apply(operator, (quotient(0),)), 1), precision, (observations,))
    controller = lower(case.program)
    [expected] = interpreted(case)
    [python] = run_python(case, controller)
    [c] = run_c(case, controller, Library([(controller, precision)], tmp_path))
    assert differences([expected], [python]) == 0, "both are Python's math"
    finite = np.abs(expected.actions) < 1e300
    assert finite.sum() > 30_000
    for ours in (c.actions, vectorised_actions(case)):
        assert ulps_apart(ours[finite], expected.actions[finite], precision) <= ULPS[operator]
        np.testing.assert_array_equal(np.abs(ours[~finite]) >= 1e300, True)


@given(rng=st.randoms(use_true_random=False))
@settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
def test_hypothesis_programs(tmp_path_factory: pytest.TempPathFactory, rng: random.Random) -> None:
    cases = [
        random_case(rng, f"h{precision.value}", precision, (25, 8), Kinds(depth=4))
        for precision in Precision
    ]
    folder = tmp_path_factory.mktemp("emitted")
    compare_all(cases, folder, ("-std=c99", "-O0", "-ffp-contract=off"))
