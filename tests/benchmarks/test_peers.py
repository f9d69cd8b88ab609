"""Peers: what they are made of, against the programs and networks that they stand for."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.peers import dagger, linear, symbolic, tree_code, trees
from benchmarks.peers.footprint import c_source, footprint, measure_program, recorded
from benchmarks.peers.network import OnnxPolicy
from benchmarks.peers.simulators import KINDS, Array, returns_of
from benchmarks.peers.tasks import Task, actions_of, task
from pirlc.backend.policies import python_policy
from pirlc.frontend import parse_sketch
from pirlc.ir.expansion import close
from pirlc.ir.policy import Environment, Program
from pirlc.ir.printer import program_text, term_text
from pirlc.oracle.network import Greedy, Network, NetworkOracle, Scaling
from pirlc.simulation.rollout import run_returns
from pirlc.simulation.workers import shared_simulator
from pirlc.source import SourceText
from tests.support.oracles import balancer

ENVIRONMENTS = tuple(KINDS)
QUICK = dagger.Settings(iterations=2, episodes=5, samples=500, finalists=1)


def observations(of: Task, count: int = 2_000) -> Array:
    """Random readings in the sensors' ranges, as binary32 has them."""
    generator = np.random.default_rng(3)
    wide = generator.uniform(-1, 1, (count, len(of.scales))) * of.scales
    return wide.astype(np.float32).astype(np.float64)


@lru_cache
def fitted(environment: str, leaves: int = 12) -> Any:
    """A tree of labels that mean nothing."""
    from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor

    of = task(environment)
    x, generator = observations(of), np.random.default_rng(4)
    if of.discrete:
        return DecisionTreeClassifier(max_leaf_nodes=leaves, random_state=0).fit(
            x, generator.choice(of.values, len(x))
        )
    return DecisionTreeRegressor(max_leaf_nodes=leaves, random_state=0).fit(x, x[:, 0] - x[:, 1])


def rated() -> NetworkOracle:
    """The balancer, its outputs called returns: Q = -+ (0.1, 0.5, 3, 1) . x."""
    return NetworkOracle(balancer().network, Greedy((0, 1), rated=True))


@pytest.mark.parametrize("environment", ENVIRONMENTS)
def test_a_tree_as_a_program_answers_as_scikit_learn(environment: str) -> None:
    of, learner = task(environment), fitted(environment)
    program = trees.program_of(trees.from_sklearn(learner), of)
    x = observations(of)
    theirs = learner.predict(x.astype(np.float32)).astype(float)
    assert np.array_equal(trees.predict(learner, x)[:, 0], theirs)
    assert np.array_equal(actions_of(program)(x)[:, 0], theirs)
    policy = python_policy(program)
    for row, wanted in zip(x[:200], theirs, strict=False):
        policy.reset()
        assert policy.act(row) == (wanted,)
    again = close(parse_sketch(SourceText("tree.pirl", program_text(program))))
    assert again == program


def test_the_size_of_a_tree_is_pirlcs_own() -> None:
    of = task("CartPole-v1")
    one = trees.Split(2, 0.5, trees.Leaf(0.0), trees.Leaf(1.0))
    assert term_text(trees.program_of(one, of).bodies[0]) == (
        "if peek(Angle, -1) <= 0.5 then 0 else 1"
    )
    assert trees.program_of(one, of).size == 8
    assert trees.program_of(trees.Split(3, -1.0, one, trees.Leaf(0.0)), of).size == 15


def test_splits_between_equal_actions_are_left_out() -> None:
    from sklearn.tree import DecisionTreeClassifier

    # The first two thirds are told apart by how sure the answer is, not by the answer.
    x = np.repeat(np.float32([[0.1], [0.2], [0.3]]), 100, axis=0).repeat(4, axis=1)
    y = np.concatenate([np.arange(100) < count for count in (0, 40, 100)]).astype(int)
    learner = DecisionTreeClassifier(max_leaf_nodes=3, random_state=0).fit(x, y)
    assert learner.get_n_leaves() == 3
    found = trees.from_sklearn(learner)
    assert trees.leaves(found) == 2
    policy = actions_of(trees.program_of(found, task("CartPole-v1")))
    wide = x.astype(np.float64)
    assert np.array_equal(policy(wide)[:, 0], learner.predict(x))


def test_vipers_weights_are_the_spread_of_the_q_values() -> None:
    weigh = dagger.q_weights(rated(), "CartPole-v1", "by hand")
    x = np.array([[0.0, 0.0, 0.1, 0.0], [1.0, 0.0, 0.0, -2.0]])
    assert weigh(x) == pytest.approx([2 * 0.3, 2 * 1.9], rel=1e-6)
    assert np.array_equal(dagger.unit_weights(x), [1.0, 1.0])


def test_viper_is_refused_without_q_values() -> None:
    with pytest.raises(SystemExit) as refusal:
        dagger.q_weights(balancer(), "CartPole-v1", "ppo")
    assert str(refusal.value) == (
        "viper on CartPole-v1: its weights are max Q - min Q, and an oracle trained by ppo has no "
        "Q values; use dagger-tree, or an oracle of dqn or duel-ddqn"
    )


def test_log_probabilities_may_stand_for_q_values() -> None:
    x = np.array([[0.0, 0.0, 0.1, 0.0], [1.0, 0.0, 0.0, -2.0]])
    weigh = dagger.logit_weights(balancer(), "CartPole-v1", "ppo")
    assert weigh(x) == pytest.approx([2 * 0.3, 2 * 1.9], rel=1e-6)
    with pytest.raises(dagger.NoValues):
        dagger.logit_weights(rated(), "CartPole-v1", "dqn")


def test_a_tree_grown_from_the_balancer_balances() -> None:
    of = task("CartPole-v0")
    weigh = dagger.q_weights(rated(), of.environment, "by hand")
    grown = dagger.grow(of, rated(), weigh, 12, 0, dagger.Settings(iterations=8))
    assert trees.leaves(grown.tree) <= 12
    again = dagger.grow(of, rated(), weigh, 12, 0, dagger.Settings(iterations=8))
    assert grown.tree == again.tree
    assert grown.validation > 150
    program = trees.program_of(grown.tree, of)
    assert returns_of(of.environment, actions_of(program), dagger.RUN_OFF).mean() == (
        grown.validation
    )


@pytest.mark.parametrize("environment", ENVIRONMENTS)
def test_simulators_repeat_gymnasium(environment: str) -> None:
    program = trees.program_of(trees.from_sklearn(fitted(environment)), task(environment))
    seeds = range(1_000_000, 1_000_020)
    mine = returns_of(environment, actions_of(program), seeds)
    simulator = shared_simulator(Environment(environment))
    theirs = run_returns(simulator, python_policy(program), seeds)
    assert mine == pytest.approx(theirs, rel=1e-13, abs=0)


@pytest.mark.parametrize("environment", ENVIRONMENTS)
@pytest.mark.parametrize("maker", [tree_code.by_m2cgen, tree_code.by_emlearn])
def test_trees_as_c_answer_as_scikit_learn(environment: str, maker: Any) -> None:
    learner = fitted(environment)
    found = tree_code.measured(maker(learner), learner, observations(task(environment)))
    assert 40 < found.code_bytes < 5_000
    assert 0 < found.step_nanoseconds < 10_000
    assert (found.observations, found.disagreements) == (2_000, 0)
    assert found.probes > 20
    if maker is tree_code.by_m2cgen:
        assert found.at_thresholds == 0


def test_emlearn_does_not_change_how_numpy_computes() -> None:
    tree_code.by_emlearn(fitted("MountainCar-v0"))
    assert "raise" not in np.geterr().values()


def test_emlearn_rounds_thresholds() -> None:
    """It prints six digits after the point, and compares with < where scikit-learn has <=."""
    learner = fitted("MountainCar-v0")
    source = tree_code.by_emlearn(learner)
    assert tree_code.measured(source, learner, observations(task("MountainCar-v0"))).at_thresholds


def test_the_harness_measures_what_pirlc_emits() -> None:
    of = task("CartPole-v1")
    small = trees.program_of(trees.from_sklearn(fitted("CartPole-v1", 2)), of)
    large = trees.program_of(trees.from_sklearn(fitted("CartPole-v1", 64)), of)
    x = recorded(small)
    assert x.shape == (5_000, 4)
    found = footprint(c_source(large), x, 1)
    assert np.array_equal(found.actions, actions_of(large)(x))
    few, nanoseconds = measure_program(small)
    assert 100 < few < found.code_bytes < 20_000
    assert 0 < nanoseconds < 10_000


def test_the_harness_needs_no_simulator_of_torcs() -> None:
    path = Path("examples/torcs/printed/aalborg.pirl")
    program = close(parse_sketch(SourceText(path.name, path.read_text(encoding="utf-8"))))
    assert isinstance(program, Program)
    code_bytes, nanoseconds = measure_program(program)
    assert code_bytes > 500
    assert nanoseconds > 0


def test_code_that_does_not_compile_is_told() -> None:
    source = c_source(trees.program_of(trees.Leaf(1.0), task("CartPole-v1")))
    broken = {name: text.replace("int", "imt", 1) for name, text in source.files.items()}
    with pytest.raises(SystemExit, match="error"):
        footprint(
            tree_code.CSource(broken, source.unit, source.adapter, source.roots),
            np.zeros((10, 4)),
            1,
        )


@pytest.mark.parametrize(
    ("environment", "rows"),
    [("CartPole-v0", 1), ("MountainCar-v0", 1), ("MountainCar-v0", 3), ("Pendulum-v1", 1)],
)
def test_a_tuned_line_is_the_program_that_is_printed(environment: str, rows: int) -> None:
    of = task(environment)
    found = linear.tune(of, rows, 0, linear.Settings(1, 2, 4, 2, 1))
    x = observations(of)
    sums = x @ found.rows[:, :-1].T + found.rows[:, -1]
    wanted = linear._actions(of, sums)
    apart = np.abs(actions_of(linear.program_of(found, of))(x) - wanted)
    # Six digits of each weight are printed.
    assert (apart > 1e-4).mean() < 0.001


def test_a_tuned_line_balances() -> None:
    found = linear.tune(task("CartPole-v0"), 1, 0, linear.Settings(1, 20, 12, 8, 2))
    assert found.validation > 190


def test_formulas_are_read_as_pyoperon_writes_them() -> None:
    text = "(0.5 + (2.0 * (abs((X3 / (-1.5))) - ((-2.0) * X4))))"
    pendulum = symbolic.program_of(task("CartPole-v1"), text)
    assert term_text(pendulum.bodies[0]) == (
        "if abs(peek(Angle, -1) / -1.5) - -2 * peek(AngularVelocity, -1) > -0.25 then 1 else 0"
    )
    turned = symbolic.program_of(task("CartPole-v1"), "(0.5 + ((-2.0) * X1))")
    assert term_text(turned.bodies[0]) == "if 0.5 + -2 * peek(Position, -1) > 0 then 1 else 0"
    torque = symbolic.program_of(task("Pendulum-v1"), "(X1 * (-(X2)))")
    assert term_text(torque.bodies[0]) == "peek(Height, -1) * -peek(Side, -1)"
    x = observations(task("Pendulum-v1"))
    assert np.array_equal(actions_of(torque)(x)[:, 0], np.clip(-x[:, 0] * x[:, 1], -2, 2))
    with pytest.raises(ValueError, match="sin"):
        symbolic.program_of(task("Pendulum-v1"), "sin(X1)")


def test_a_formula_of_the_balancer_balances() -> None:
    effort = symbolic.Settings(rounds=1, episodes=3, samples=300, evaluations=3_000, population=100)
    found = symbolic.regress(task("CartPole-v0"), balancer(), 10, 0, effort)
    assert found.validation > 120
    assert found.program.size < 60


def test_onnx_runtime_answers_as_the_oracle() -> None:
    policy, x = OnnxPolicy(balancer()), observations(task("CartPole-v1"), 300)
    assert np.array_equal(policy.actions(x), balancer().actions(x))
    assert policy.act(x[0]) == tuple(balancer().actions(x[:1])[0])
    assert policy.parameters == 10
    assert 300 < len(policy.data) < 2_000
    assert 500 < policy.step_nanoseconds(x) < 1e7
    flat = Network(
        Scaling(np.zeros(3, np.float32), np.ones(3, np.float32)),
        (np.ones((1, 3), np.float32),),
        (np.zeros(1, np.float32),),
        "relu",
    )
    from pirlc.oracle.network import Bounded

    torque = NetworkOracle(flat, Bounded((-2.0,), (2.0,), squashed=True))
    x = observations(task("Pendulum-v1"), 100)
    assert OnnxPolicy(torque).actions(x) == pytest.approx(torque.actions(x), abs=1e-5)
