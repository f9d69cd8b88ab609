from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
import scipy.linalg

from pirlc.analyze.closed_loop import Mode, closed_loop, parts_of, shape_of
from pirlc.analyze.exact import Rational, falls, is_positive_definite, rational
from pirlc.analyze.findings import Leaf, Origin, Plant, SwitchingFinding
from pirlc.analyze.lyapunov import edges_of, lyapunov, words_of
from pirlc.analyze.plants.find import find_plant
from pirlc.analyze.switching import decide, switching_of
from pirlc.analyze.transfer import leaves_of, operating_point
from pirlc.ir.evidence import Evidence, Kind
from pirlc.ir.policy import Environment, Program
from pirlc.semantics.interpreter import initial_state, step
from tests.support.plants import program

TINY = Fraction(1, 10**12)


# Exact arithmetic


def test_definiteness_agrees_with_eigenvalues() -> None:
    generator = np.random.default_rng(5)
    found = set()
    for _ in range(200):
        n = int(generator.integers(1, 7))
        half = generator.integers(-9, 10, (n, n)) / 4.0
        matrix = half @ half.T - generator.choice([0.0, 0.5, 2.0]) * np.eye(n)
        least = np.linalg.eigvalsh(matrix).min()
        if abs(least) < 1e-9:
            continue
        expected = bool(least > 0)
        assert is_positive_definite(rational(matrix.tolist())) == expected
        found.add(expected)
    assert found == {True, False}


def test_definiteness_is_exact() -> None:
    one = Fraction(1)
    edge = 1 - TINY
    assert is_positive_definite(((one, edge), (edge, one)))
    assert not is_positive_definite(((one, one), (one, one)))
    assert not is_positive_definite(((one, 1 + TINY), (1 + TINY, one)))
    assert not is_positive_definite(((Fraction(0),),))
    assert not is_positive_definite(((one, edge), (edge + TINY, one)))  # not symmetric


def test_a_function_that_fails_by_a_little_is_refused() -> None:
    # V = x^2 under x -> x/2 falls to exactly a quarter.
    half, one = ((Fraction(1, 2),),), ((Fraction(1),),)
    assert not falls(half, one, one, Fraction(1, 4))
    assert falls(half, one, one, Fraction(1, 4) + TINY)
    # A shear under which V = x' P x would rise by 1e-12 in one direction only.
    shear = ((Fraction(1, 2), Fraction(3, 4)), (Fraction(0), Fraction(1, 2)))
    best = _largest_stretch(shear)
    eye = ((Fraction(1), Fraction(0)), (Fraction(0), Fraction(1)))
    assert not falls(shear, eye, eye, best - TINY)
    assert falls(shear, eye, eye, best + TINY)


def _largest_stretch(matrix: Rational) -> Fraction:
    """The square of the largest singular value, which is rational here."""
    a = np.array([[float(v) for v in row] for row in matrix])
    value = float(np.linalg.svd(a)[1][0] ** 2)
    found = Fraction(value).limit_denominator(1000)
    assert abs(float(found) - value) < 1e-14
    return found


# Pairs of modes: x' = A x sampled every h, after Dayawansa and Martin (1999)


def pair(a: float, h: float) -> list[Rational]:
    """One quadratic function serves both in continuous time just where a < 3 + sqrt(8) = 5.83."""
    first = np.array([[-1.0, -1.0], [1.0, -1.0]])
    second = np.array([[-1.0, -a], [1.0 / a, -1.0]])
    return [rational(scipy.linalg.expm(h * matrix).tolist()) for matrix in (first, second)]


def decided(matrices: list[Rational]) -> SwitchingFinding:
    names = [f"mode {i + 1}" for i in range(len(matrices))]
    return decide(names, ("x", "y")[: len(matrices[0])], matrices)


def energies_fall(finding: SwitchingFinding, matrices: list[Rational]) -> None:
    """The function found is checked along random orders of the modes, by other arithmetic."""
    assert finding.decay is not None
    generator = np.random.default_rng(11)
    numbers = [np.array([[float(v) for v in row] for row in mode]) for mode in matrices]
    names = [f"mode {i + 1}" for i in range(len(matrices))]
    ahead = max((key.count(", then ") + 1 for key in finding.pieces), default=0)
    for _ in range(20):
        order = generator.integers(len(matrices), size=60)
        z = generator.standard_normal(len(numbers[0]))
        values = []
        for k in range(40):
            if finding.lyapunov is not None:
                chosen = finding.lyapunov
            else:
                chosen = finding.pieces[", then ".join(names[i] for i in order[k : k + ahead])]
            p = np.array([[float(v) for v in row] for row in chosen])
            values.append(z @ p @ z)
            z = numbers[order[k]] @ z
        for before, after in pairwise(values):
            assert 0.0 < after < float(finding.decay) * before * (1 + 1e-9)


def test_a_pair_with_a_common_function() -> None:
    finding = decided(pair(5.7, 0.02))
    assert finding.evidence == Evidence(
        Kind.LINEARISED, "stable in any order of the modes; saturation left out"
    )
    assert finding.lyapunov is not None
    assert not finding.pieces
    assert finding.decay is not None
    assert finding.decay < 1
    assert finding.tried[-1] == (
        "one quadratic function for all modes: found, confirmed in exact rationals"
    )
    energies_fall(finding, pair(5.7, 0.02))


def test_a_pair_that_is_stable_in_any_order_without_a_common_function() -> None:
    finding = decided(pair(8.0, 0.2))
    assert lyapunov(pair(8.0, 0.2), 0) is None
    assert finding.evidence.kind is Kind.LINEARISED
    assert finding.lyapunov is None
    assert set(finding.pieces) == {"mode 1", "mode 2"}
    assert finding.tried[-2:] == (
        "one quadratic function for all modes (LMI): none found",
        "a quadratic function for each mode: found, confirmed in exact rationals",
    )
    energies_fall(finding, pair(8.0, 0.2))


def test_a_pair_that_needs_to_know_what_comes_next() -> None:
    finding = decided(pair(6.0, 0.02))
    assert len(finding.pieces) == 4
    assert "mode 1, then mode 2" in finding.pieces
    energies_fall(finding, pair(6.0, 0.02))


def test_a_pair_that_diverges_in_some_order() -> None:
    matrices = pair(12.0, 0.5)
    finding = decided(matrices)
    order = "mode 1, mode 1, mode 2, mode 2"
    assert finding.evidence == Evidence(
        Kind.REFUTED, f"for the linearisation, {order} in turn diverges"
    )
    assert finding.lyapunov is None
    assert order in finding.tried[-1]
    one, two = (np.array([[float(v) for v in row] for row in m]) for m in matrices)
    z = np.array([1.0, 0.3])
    for _ in range(300):
        z = two @ two @ one @ one @ z
    assert np.linalg.norm(z) > 1e6


def test_a_mode_that_is_unstable_by_itself() -> None:
    good, bad = ((Fraction(1, 2),),), ((Fraction(-11, 10),),)
    finding = decided([good, bad])
    assert finding.evidence == Evidence(
        Kind.REFUTED, "unstable by itself, for the linearisation: mode 2"
    )
    assert finding.tried == (
        "mode 1 alone: spectral radius 0.5",
        "mode 2 alone: spectral radius 1.1",
        "no Lyapunov function: a mode that is unstable by itself has none",
    )


def test_a_mode_that_does_not_settle() -> None:
    finding = decided([((Fraction(1),),), ((Fraction(1, 2),),)])
    assert finding.evidence == Evidence(
        Kind.UNKNOWN, "on the border of stability by itself: mode 1"
    )


def test_what_cannot_be_decided_is_unknown() -> None:
    finding = decided(pair(10.0, 0.02))
    assert finding.evidence == Evidence(
        Kind.UNKNOWN, "no Lyapunov function was found, and no order of the modes diverges"
    )
    assert [text.split(" (")[0] for text in finding.tried[3:]] == [
        "one quadratic function for all modes",
        "a quadratic function for each mode",
        "a quadratic function for each two modes in turn",
        "a quadratic function for each three modes in turn",
        "a quadratic function for each four modes in turn",
    ]


def test_modes_of_many_states() -> None:
    numbers = 0.5 * np.eye(70)
    numbers[0, 1] = 0.1
    alike = [rational(numbers.tolist()), rational(numbers.T.tolist())]
    finding = decide(("one", "two"), [f"x{i}" for i in range(70)], alike)
    assert finding.evidence.kind is Kind.LINEARISED
    numbers[0, 1] = 1.2
    apart = [rational(numbers.tolist()), rational(numbers.T.tolist())]
    finding = decide(("one", "two"), [f"x{i}" for i in range(70)], apart)
    assert finding.evidence.kind is Kind.REFUTED
    hard = []
    for mode in pair(10.0, 0.02):
        numbers = 0.5 * np.eye(70)
        numbers[:2, :2] = [[float(v) for v in row] for row in mode]
        hard.append(rational(numbers.tolist()))
    finding = decide(("one", "two"), [f"x{i}" for i in range(70)], hard)
    assert finding.evidence.kind is Kind.UNKNOWN
    assert finding.tried[-1] == (
        "one quadratic function for all modes (too many states for an LMI): none found"
    )


def test_words_follow_each_other() -> None:
    assert words_of(2, 0) == ((),)
    assert [(e.mode, e.here, e.there) for e in edges_of(words_of(2, 0), 2)] == [
        (0, 0, 0),
        (1, 0, 0),
    ]
    words = words_of(3, 2)
    for edge in edges_of(words, 3):
        assert words[edge.here][0] == edge.mode
        assert words[edge.here][1] == words[edge.there][0]
    assert len(edges_of(words, 3)) == 27


# Programs

MANY = """policy many
sensor a : [-1000, 1000] = 0
sensor b : [-1000, 1000] = 1
window 4
latency 1
fill zero
action u : [-1e6, 1e6] = 0.4 * peek(a, -1) - 0.3 * fold(+, a) + 0.2 * (peek(b, -1) - peek(b, -3))
                         + 0.5 * previous(u) - 0.1 * previous(v)
action v : [-1e6, 1e6] = 0.3 * fold(+, b) - 0.2 * peek(a, -4)
"""


def leaves(policy: Program) -> tuple[Leaf, ...]:
    return leaves_of(policy, operating_point(policy, {}))[0]


def given(a: np.ndarray, b: np.ndarray, c: np.ndarray, inputs: str, outputs: str) -> Plant:
    rows = [tuple(tuple(map(float, row)) for row in matrix) for matrix in (a, b, c)]
    d = tuple((0.0,) * len(inputs) for _ in outputs)
    states = tuple(f"x{i}" for i in range(len(a)))
    return Plant(
        "given", Origin.GIVEN, rows[0], rows[1], rows[2], d, states, tuple(inputs),
        tuple(outputs), None, {}, Evidence(Kind.UNKNOWN, "made up"),
    )  # fmt: skip


def test_the_closed_loop_is_what_interpreter_and_plant_do() -> None:
    generator = np.random.default_rng(2)
    policy = program(MANY)
    for _ in range(5):
        a, b = 0.5 * generator.standard_normal((3, 3)), generator.standard_normal((3, 2))
        c = generator.standard_normal((2, 3))
        plant = given(a, b, c, "uv", "ab")
        shape = shape_of(plant, leaves(policy), policy.interface.latency)
        by_action = {leaf.action: leaf for leaf in leaves(policy)}
        matrix = np.array(closed_loop(shape, Mode("all", by_action)), dtype=np.float64)
        x = generator.standard_normal(3)
        z = np.concatenate([x, np.zeros(len(matrix) - 3)])
        state = initial_state(policy)
        for _ in range(12):
            result = step(policy, state, (c @ x).tolist())
            state = result.state
            x = a @ x + b @ np.array(result.actions)
            z = matrix @ z
            assert np.allclose(z[:3], x, rtol=1e-9, atol=1e-9)
        assert np.allclose(z[-2:], result.actions, rtol=1e-9)
        assert shape.states[-2:] == ("previous(u)", "previous(v)")
        assert "a, 1 step ago" in shape.states


SWITCHED = """policy switched
environment "Pendulum-v1"
sensor Side : [-1, 1] = 1
sensor Speed : [-8, 8] = 2
action Torque : [-2, 2] = if peek(Speed, -1) > 0
                          then -16 * peek(Side, -1) - 4 * peek(Speed, -1)
                          else -10 * peek(Side, -1) - 3 * peek(Speed, -1)
"""


def test_a_program_that_switches_between_two_laws() -> None:
    policy = program(SWITCHED)
    plant = find_plant(policy, Environment("Pendulum-v1"))
    (finding,) = switching_of(plant, leaves(policy), policy.interface.latency)
    assert finding.modes == ("Torque 1", "Torque 2")
    assert finding.states == ("rod angle", "rod speed")
    assert finding.evidence.kind is Kind.LINEARISED
    assert finding.lyapunov is not None
    assert finding.decay is not None
    p = finding.lyapunov
    assert is_positive_definite(p)
    # Written out by hand, and checked by the exact arithmetic once more.
    a, b = np.array(plant.a), np.array(plant.b)
    for gains in ([-16.0, -4.0], [-10.0, -3.0]):
        mode = a + b @ np.array([gains])
        v = np.array([[float(x) for x in row] for row in p])
        gap = float(finding.decay) * v - mode.T @ v @ mode
        assert np.linalg.eigvalsh(gap).min() > 0.0


def test_laws_that_differ_in_their_setpoint_alone() -> None:
    text = SWITCHED.replace("-10 * peek(Side, -1) - 3", "1 - 16 * peek(Side, -1) - 4")
    policy = program(text)
    plant = find_plant(policy, Environment("Pendulum-v1"))
    (finding,) = switching_of(plant, leaves(policy), 0)
    assert finding.evidence.kind is Kind.LINEARISED
    assert finding.lyapunov is not None
    assert finding.notes == (
        "the 2 modes have 1 linear parts: some differ only in where they rest",
        "the modes rest at different points (the offsets of Torque differ): the statement is that "
        "trajectories under the same switching come together, not that they come to one point",
    )


def test_latency_is_part_of_the_loop() -> None:
    policy = program(SWITCHED)
    plant = find_plant(policy, Environment("Pendulum-v1"))
    (finding,) = switching_of(plant, leaves(policy), 4)
    assert finding.evidence.kind is Kind.REFUTED
    assert "Side, 4 steps ago" in finding.states


def test_programs_that_do_not_switch_are_passed_over() -> None:
    policy = program(SWITCHED.replace("-10", "-16").replace("- 3 *", "- 4 *"))
    plant = find_plant(policy, Environment("Pendulum-v1"))
    assert switching_of(plant, leaves(policy)[:1], 0) == ()


def test_parts_that_have_nothing_to_do_with_each_other_are_apart() -> None:
    text = """policy apart
sensor a : [-1, 1] = 0
sensor b : [-1, 1] = 1
action u : [-1, 1] = if peek(b, -1) > 0 then -0.5 * peek(a, -1) else -0.2 * peek(a, -1)
action v : [-1, 1] = 3 * peek(b, -1)
"""
    policy = program(text)
    plant = given(np.diag([0.9, 0.8]), np.eye(2), np.eye(2), "uv", "ab")
    parts = parts_of(plant, leaves(policy))
    assert [(part.inputs, part.outputs) for part, _ in parts] == [
        (("u",), ("a",)),
        (("v",), ("b",)),
    ]
    # v's loop is unstable, and no concern of u's.
    (finding,) = switching_of(plant, leaves(policy), 0)
    assert finding.modes == ("u 1", "u 2")
    assert finding.evidence.kind is Kind.LINEARISED
    joined = given(np.array([[0.9, 0.1], [0.0, 0.8]]), np.eye(2), np.eye(2), "uv", "ab")
    (finding,) = switching_of(joined, leaves(policy), 0)
    assert finding.modes == ("u 1 + v", "u 2 + v")
    assert finding.evidence.kind is Kind.REFUTED


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (("peek(Side, -1) - 4", "peek(Side, -1) * peek(Side, -1) - 4"), None),
        (("= 1\n", "= 0\n"), "Side, on which Torque 1 depends, is no part of the plant"),
    ],
)
def test_what_makes_no_linear_loop(change: tuple[str, str], reason: str | None) -> None:
    policy = program(SWITCHED.replace(*change))
    plant = find_plant(program(SWITCHED), Environment("Pendulum-v1"))
    if reason is not None:
        plant = given(np.array(plant.a), np.array(plant.b), np.array([[0.0, 1.0]]), "u", "s")
        plant = Plant(
            **{
                **{name: getattr(plant, name) for name in plant.__dataclass_fields__},
                "inputs": ("Torque",),
                "outputs": ("Speed",),
            }
        )
    (finding,) = switching_of(plant, leaves(policy), 0)
    if reason is None:
        # A tangent is taken: Side * Side has no slope at 0.
        assert finding.evidence.kind is Kind.REFUTED
    else:
        assert reason in finding.notes
