"""The CasADi form agrees with the vectorised evaluator away from guards."""

from __future__ import annotations

import random

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pirlc.ir.operators import Operator
from pirlc.ir.policy import (
    ActionSpec,
    Choice,
    Continuous,
    FixedParameter,
    FreeParameter,
    Interface,
    ProgramTemplate,
    Sensor,
)
from pirlc.ir.terms import (
    Apply,
    DiscreteLiteral,
    Fold,
    If,
    Literal,
    ParameterRef,
    Peek,
    PreviousAction,
    SensorRef,
    Term,
)
from pirlc.ir.types import Discrete
from pirlc.semantics.histories import HistorySet, histories_of
from pirlc.semantics.interpreter import TRUTH
from pirlc.semantics.vectorised import KERNELS, evaluate
from pirlc.symbolic.affine import DesignMatrices, affine_split
from pirlc.symbolic.casadi_form import casadi_form
from pirlc.symbolic.smooth import SmoothedObjective
from pirlc.symbolic.walk import Algebra, walk
from tests.support.observations import random_observations
from tests.support.programs import Kinds, random_template


def random_histories(rng: random.Random, template: ProgramTemplate, steps: int) -> HistorySet:
    actions = np.array(
        [
            [
                rng.choice(a.domain.values)
                if isinstance(a.domain, Choice)
                else rng.uniform(a.domain.lower, a.domain.upper)
                for a in template.interface.actions
            ]
            for _ in range(steps)
        ],
        dtype=np.float64,
    )
    observations = random_observations(rng, template.interface, steps, nasty=False)
    half = steps // 2
    return histories_of(
        template.interface,
        [(observations[:half], actions[:half]), (observations[half:], actions[half:])],
    )


def all_finite(
    template: ProgramTemplate, values: dict[str, float], histories: HistorySet
) -> np.ndarray:
    """The histories (N,) on which no step of the computation gives a NaN or an infinity.

    CasADi takes `x / x` for 1 and `x - x` for 0 whatever x is.
    """
    finite = np.ones(len(histories), np.bool_)

    def watched(operator: Operator):
        def operation(*operands):
            operands = [np.asarray(operand) for operand in operands]
            shape = np.broadcast_shapes(*(operand.shape for operand in operands))
            out = np.empty(shape, bool if operator in TRUTH else float)
            KERNELS[operator](*operands, out)
            np.logical_and(finite, np.isfinite(out), out=finite)
            return out

        return operation

    algebra: Algebra[object] = Algebra(
        literal=lambda value: value,
        discrete=lambda value, _: float(value),
        parameter=lambda name: values[name],
        element=histories.element,
        previous=lambda action, _: histories.of_histories(histories.previous[action]),
        operators={operator: watched(operator) for operator in Operator},
        choose=np.where,
    )
    with np.errstate(all="ignore"):
        for body in template.bodies:
            walk(body, algebra)
    return finite


def compare(rng: random.Random) -> int:
    """Checks one random template; the number of results compared."""
    template = random_template(rng, Kinds(odd_numbers=False, libm=True), discrete=None)
    histories = random_histories(rng, template, 24)
    values = {p.name: rng.uniform(-3, 3) for p in template.free}
    expected = evaluate(template, values, histories)
    ours, margins = casadi_form(template, len(histories)).run(values, histories)
    clear = (np.abs(margins) > 1e-6).all(axis=0)
    clear &= all_finite(template, values, histories)
    compared = 0
    for theirs, mine in zip(expected.T, ours.T, strict=True):
        rows = clear & (np.abs(theirs) < 1e12)
        compared += int(rows.sum())
        np.testing.assert_allclose(mine[rows], theirs[rows], rtol=1e-9, atol=1e-9)
    return compared


def test_many_templates() -> None:
    compared = sum(compare(random.Random(seed)) for seed in range(250))
    assert compared > 5_000, "most results are to be compared, not passed over"


@given(rng=st.randoms(use_true_random=False))
@settings(max_examples=50, deadline=None, suppress_health_check=list(HealthCheck))
def test_hypothesis_templates(rng: random.Random) -> None:
    compare(rng)


WINDOW = 5
HISTORIES = 5_000


def sensor(name: str) -> Term:
    return SensorRef(name, WINDOW)


def apply(operator: Operator, *arguments: Term) -> Term:
    return Apply(operator, arguments)


def times(name: str, term: Term) -> Term:
    return apply(Operator.MULTIPLY, ParameterRef(name), term)


def plus(*terms: Term) -> Term:
    total, *rest = terms
    for term in rest:
        total = apply(Operator.ADD, total, term)
    return total


def pid(prefix: str, setpoint: str, h: Term) -> Term:
    e = apply(Operator.SUBTRACT, ParameterRef(setpoint), h)
    return plus(
        times(prefix + "p", Peek(e, -1)),
        times(prefix + "i", Fold(Operator.ADD, e)),
        times(prefix + "d", apply(Operator.SUBTRACT, Peek(h, -2), Peek(h, -1))),
    )


def guard(prefix: str, *sensors: str) -> Term:
    terms = [times(f"{prefix}{i + 1}", Peek(sensor(s), -1)) for i, s in enumerate(sensors)]
    return apply(Operator.GREATER, plus(ParameterRef(prefix + "0"), *terms), Literal(0.0))


def template_of(body: Term, parameters: str, domain: Continuous | Choice) -> ProgramTemplate:
    return ProgramTemplate(
        Interface(
            "t",
            None,
            tuple(Sensor(name, -1.0, 1.0, i) for i, name in enumerate("xyzw")),
            (ActionSpec("A", domain, 0),),
            WINDOW,
        ),
        tuple(FreeParameter(name, -100.0, 100.0) for name in parameters.split()),
        (body,),
    )


def some_histories(template: ProgramTemplate, count: int = HISTORIES) -> HistorySet:
    generator = np.random.default_rng(3)
    return histories_of(
        template.interface,
        [(generator.uniform(-1, 1, (100, 4)), np.zeros((100, 1))) for _ in range(count // 100)],
    )


def three_guards() -> ProgramTemplate:
    """Three linear guards behind a discrete action: nine parameters."""
    condition = apply(
        Operator.OR,
        apply(Operator.AND, guard("a", "x", "y"), guard("b", "z", "w")),
        guard("c", "x", "w"),
    )
    values = Discrete((0, 1, 2))
    body = If(condition, DiscreteLiteral(2, values), DiscreteLiteral(0, values))
    return template_of(body, "a0 a1 a2 b0 b1 b2 c0 c1 c2", Choice((0, 1, 2)))


def check_gradient(objective: SmoothedObjective, theta: np.ndarray, temperature: float) -> None:
    _, gradient = objective(theta, temperature)
    for i in range(len(theta)):
        nudge = np.zeros(len(theta))
        nudge[i] = 1e-6
        slope = (
            objective(theta + nudge, temperature)[0] - objective(theta - nudge, temperature)[0]
        ) / 2e-6
        assert gradient[i] == pytest.approx(slope, rel=1e-4, abs=1e-7)


def test_discrete_objective() -> None:
    template = three_guards()
    histories = some_histories(template)
    truth = dict(
        zip(
            ["a0", "a1", "a2", "b0", "b1", "b2", "c0", "c1", "c2"],
            (0.3, 1.0, -2.0, 0.1, -1.0, 0.5, -0.4, 1.0, 1.0),
            strict=True,
        )
    )
    labels = evaluate(template, truth, histories)
    objective = SmoothedObjective(template, histories, labels)
    assert objective.names == tuple(truth)
    theta = np.array(list(truth.values()))
    objective.set_scales(objective.scales_at(theta))
    assert objective.scales_at(theta)[0] == pytest.approx(np.sqrt(5 / 3), rel=0.05)
    assert objective(theta, 1e-6)[0] < 1e-2, "cold, it is the program itself"
    rng = np.random.default_rng(0)
    check_gradient(objective, theta, 1.0)
    check_gradient(objective, rng.normal(size=9), 0.3)
    # Going down the slope brings a wrong start nearer to the oracle.
    start = theta + rng.normal(size=9) * 0.5
    value, gradient = objective(start, 0.3)
    assert objective(start - 0.1 * gradient, 0.3)[0] < value


def test_weights_choose_histories() -> None:
    template = three_guards()
    histories = some_histories(template, 1000)
    labels = np.where(np.arange(1000) < 500, 0.0, 2.0)[:, None]
    first = (np.arange(1000) < 500).astype(float)
    theta = np.linspace(-1, 1, 9)
    whole = SmoothedObjective(template, histories, labels)(theta, 0.5)[0]
    parts = [
        SmoothedObjective(template, histories, labels, w)(theta, 0.5)[0] for w in (first, 1 - first)
    ]
    assert whole == pytest.approx(sum(parts) / 2)
    alone = SmoothedObjective(template, histories.select(range(500)), labels[:500])(theta, 0.5)[0]
    assert alone == pytest.approx(parts[0])


def test_continuous_objective() -> None:
    body = If(guard("g", "x", "y"), pid("k", "r", sensor("x")), ParameterRef("c"))
    template = template_of(body, "g0 g1 g2 kp ki kd r c", Continuous(-2.0, 2.0))
    histories = some_histories(template)
    theta = np.array([0.1, 1.0, -1.0, 1.5, 0.2, 3.0, 0.3, -1.0])
    values = dict(zip((p.name for p in template.free), theta, strict=True))
    labels = np.clip(evaluate(template, values, histories), -2.0, 2.0)
    objective = SmoothedObjective(template, histories, labels)
    assert objective(theta, 1e-5)[0] < 1e-4
    check_gradient(objective, theta, 0.5)
    check_gradient(objective, theta * 0.7 + 0.1, 0.2)


def test_discrete_previous_and_equality_are_exact_where_no_parameter_enters() -> None:
    values = Discrete((0, 1, 2))
    one = DiscreteLiteral(1, values)
    condition = apply(Operator.EQUAL, PreviousAction("A", values), one)
    body = If(condition, DiscreteLiteral(2, values), one)
    template = template_of(body, "", Choice((0, 1, 2), 1))
    histories = some_histories(template, 100)
    labels = evaluate(template, {}, histories)
    assert set(labels[:, 0]) == {1.0, 2.0}
    assert SmoothedObjective(template, histories, labels)(np.zeros(0), 5.0)[0] < 1e-2


def test_a_pid_is_affine_given_its_setpoint() -> None:
    template = template_of(pid("k", "r", sensor("x")), "kp ki kd r", Continuous(-2.0, 2.0))
    split = affine_split(template)
    assert (split.linear, split.others) == (("kp", "ki", "kd"), ("r",))
    histories = some_histories(template, 500)
    [design] = DesignMatrices(template, split, histories)({"r": 0.4})
    raw = evaluate(template, {"kp": 2.0, "ki": -0.3, "kd": 7.0, "r": 0.4}, histories)
    np.testing.assert_allclose(
        design.matrix @ [2.0, -0.3, 7.0] + design.offset, raw[:, 0], rtol=1e-12, atol=1e-12
    )


def test_leaves_are_affine_given_the_guards() -> None:
    body = If(guard("g", "x", "y"), pid("k", "r", sensor("x")), ParameterRef("c"))
    template = template_of(body, "g0 g1 g2 kp ki kd r c", Continuous(-2.0, 2.0))
    split = affine_split(template)
    assert split.linear == ("kp", "ki", "kd", "c")
    assert split.others == ("g0", "g1", "g2", "r")
    histories = some_histories(template, 500)
    others = {"g0": 0.1, "g1": 1.0, "g2": -1.0, "r": 0.3}
    [design] = DesignMatrices(template, split, histories)(others)
    linear = {"kp": 2.0, "ki": -0.3, "kd": 7.0, "c": -0.5}
    raw = evaluate(template, others | linear, histories)
    np.testing.assert_allclose(
        design.matrix @ list(linear.values()) + design.offset, raw[:, 0], rtol=1e-12, atol=1e-12
    )


@pytest.mark.parametrize(
    "body",
    [
        apply(Operator.ABS, ParameterRef("p")),
        apply(Operator.MIN, ParameterRef("p"), Peek(sensor("x"), -1)),
        apply(Operator.SIGN, ParameterRef("p")),
        apply(Operator.DIVIDE, Peek(sensor("x"), -1), ParameterRef("p")),
        times("p", ParameterRef("p")),
        If(
            apply(Operator.GREATER, ParameterRef("p"), Peek(sensor("x"), -1)),
            Literal(1.0),
            Literal(0.0),
        ),
    ],
)
def test_not_affine(body: Term) -> None:
    template = template_of(body, "p", Continuous(-2.0, 2.0))
    assert affine_split(template).others == ("p",)


def test_fixed_parameters_are_constants() -> None:
    template = template_of(times("p", ParameterRef("q")), "p", Continuous(-2.0, 2.0))
    template = ProgramTemplate(
        template.interface, (*template.parameters, FixedParameter("q", 3.0)), template.bodies
    )
    assert affine_split(template).linear == ("p",)
