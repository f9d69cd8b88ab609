"""The evaluation of the study, and what can be proved of a peer."""

from __future__ import annotations

import numpy as np

from benchmarks.peers.simulators import Batch, returns_of
from benchmarks.peers.tasks import Array, actions_of
from benchmarks.study.records import EPISODES, FIRST_SEED, Return
from pirlc.backend.policies import python_policy
from pirlc.ir.evidence import Kind
from pirlc.ir.policy import Environment, Program
from pirlc.simulation.policy import Policy
from pirlc.simulation.rollout import estimate, run_returns
from pirlc.simulation.workers import shared_simulator

SEEDS = range(FIRST_SEED, FIRST_SEED + EPISODES)
REPEATED = SEEDS[:: EPISODES // 10]
"""Those that are played again, in Gymnasium itself and by the emitted Python."""


def in_words(returns: Array) -> Return:
    found = estimate(returns)
    return Return(found.mean, found.low, found.high, found.episodes, FIRST_SEED)


def evaluate(program: Program) -> Return:
    """The return of a peer's program. Raises SystemExit if episodes are not what they are in
    Gymnasium."""
    environment = program.interface.environment
    assert environment is not None
    returns = returns_of(environment.id, actions_of(program), SEEDS)
    if differing(environment.id, python_policy(program), returns):
        raise SystemExit(f"{environment.id}: episodes differ from Gymnasium's")
    return in_words(returns)


def evaluate_network(environment: str, batch: Batch, policy: Policy) -> tuple[Return, int]:
    """The return of a network, and how many of the repeated episodes differ: networks round
    otherwise for many observations than for one."""
    returns = returns_of(environment, batch, SEEDS)
    return in_words(returns), differing(environment, policy, returns)


def differing(environment: str, policy: Policy, returns: Array) -> int:
    """How many of the repeated episodes are others in Gymnasium."""
    again = run_returns(shared_simulator(Environment(environment)), policy, REPEATED)
    mine = returns[:: EPISODES // 10]
    return int((np.abs(again - mine) > 1e-6 * np.maximum(1.0, np.abs(mine))).sum())


def provable(program: Program) -> str:
    """What pirlc proves of the program: the sketch's properties, and that its C is the program."""
    from pirlc.verify.emitted.check import check_emitted
    from pirlc.verify.properties.asking import Limits
    from pirlc.verify.properties.prove import prove

    kinds: dict[Kind, list[str]] = {}
    for finding in prove(program, Limits(seconds=20.0)):
        kinds.setdefault(finding.evidence.kind, []).append(finding.name)
    told = [f"{', '.join(names)} {kind.value}" for kind, names in kinds.items()]
    same = check_emitted(program, "double").evidence.kind
    return f"printed as .pirl: {'; '.join(told)}; emitted C equal to it: {same.value}"


def distance(task_range: float | None, ours: Array, theirs: Array) -> float:
    """To the oracle, as pirlc measures it: disagreement, or the error divided by the range."""
    if task_range is None:
        return float((ours != theirs).mean())
    return float(np.abs(ours - theirs).mean() / task_range)
