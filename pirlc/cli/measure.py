"""Episodes of a policy, counted up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pirlc.cli.progress import counting
from pirlc.cli.subjects import Subject
from pirlc.simulation.native import is_deterministic
from pirlc.simulation.policy import Policy
from pirlc.simulation.rollout import ReturnEstimate, estimate, run_return
from pirlc.simulation.workers import Workers, parallel_map, shared_simulator

_BITS = ((1, "missing"), (2, "out_of_range"), (4, "safe_used"))


@dataclass(frozen=True)
class Tally:
    """The return of each episode; for controllers, the steps in all and those of each status.

    `seeds` are those that were run: in a `deterministic` environment the first alone, for it
    stands for all.
    """

    returns: NDArray[np.float64]
    steps: int
    statuses: dict[str, int] | None
    seeds: range
    deterministic: bool

    @property
    def estimate(self) -> ReturnEstimate:
        return estimate(self.returns, deterministic=self.deterministic)


class _Watched:
    """A policy that counts its steps and what its status says."""

    def __init__(self, policy: Policy) -> None:
        self.policy = policy
        self.reset = policy.reset
        self.steps = 0
        self.seen: dict[int, int] = {}

    def act(self, observation: NDArray[np.float64]) -> tuple[float, ...]:
        action = self.policy.act(observation)
        self.steps += 1
        status = getattr(self.policy, "status", 0)
        if status:
            self.seen[status] = self.seen.get(status, 0) + 1
        return action


@dataclass(frozen=True)
class _Part:
    returns: list[float]
    steps: int
    seen: dict[int, int]


def _play(subject: Subject, trust: bool, seeds: Sequence[int]) -> _Part:
    simulator = shared_simulator(subject.environment, trust)
    policy = _Watched(subject.factory())
    returns = [run_return(simulator, policy, seed) for seed in seeds]
    return _Part(returns, policy.steps, policy.seen)


def measure(subject: Subject, seeds: range, workers: Workers, trust: bool) -> Tally:
    """One episode from each seed; the same for any number of workers."""
    deterministic = is_deterministic(shared_simulator(subject.environment, trust))
    if deterministic:
        seeds = seeds[:1]
    parts: list[_Part] = []
    with counting("episodes", len(seeds)) as (shown, advance):
        # Few large rounds where nobody watches, more small ones for a bar that moves.
        rounds = min(20 if shown else 1, max(1, len(seeds) // workers.count))
        for turn in _split(seeds, rounds):
            pieces = _split(turn, min(len(turn), workers.count * (1 if shown else 3)))
            parts += parallel_map(partial(_play, subject, trust), pieces, workers)
            advance(len(turn))
    statuses = None
    if subject.watched:
        statuses = {
            name: sum(n for part in parts for status, n in part.seen.items() if status & bit)
            for bit, name in _BITS
        }
    returns = np.array([r for part in parts for r in part.returns])
    return Tally(returns, sum(part.steps for part in parts), statuses, seeds, deterministic)


def _split(seeds: range, count: int) -> list[range]:
    cuts = [len(seeds) * i // count for i in range(count + 1)]
    return [seeds[a:b] for a, b in pairwise(cuts) if b > a]


def in_words(subject: Subject, tally: Tally) -> str:
    """What `pirlc rollout` prints."""
    found, seeds = tally.estimate, tally.seeds
    words = "episode" if found.episodes == 1 else "episodes"
    span = f"seeds {seeds[0]} to {seeds[-1]}" if found.episodes > 1 else f"seed {seeds[0]}"
    lines = [
        f"{subject.words} in {subject.environment.id}",
        f"return {number(found.mean)}   {interval(found)}   {found.episodes:,} {words}, {span}",
    ]
    for key, text in (
        ("missing", "steps with a missing reading"),
        ("out_of_range", "steps with a reading outside its range"),
        ("safe_used", "steps with a safe action"),
    ):
        if tally.statuses and tally.statuses[key]:
            lines.append(f"{tally.statuses[key]:,} of {tally.steps:,} {text}")
    return "\n".join(lines)


def number(value: float) -> str:
    """A return with as many decimals as are worth reading."""
    return f"{value:.2f}" if abs(value) < 10_000 else f"{value:,.0f}"


def interval(found: ReturnEstimate) -> str:
    if found.exact:
        return "exact: the environment is deterministic"
    if found.episodes == 1:
        return "no interval"
    return f"95 % interval [{number(found.low)}, {number(found.high)}]"


def estimate_data(found: ReturnEstimate) -> dict[str, object]:
    return {
        "mean": found.mean,
        "low": found.low,
        "high": found.high,
        "std": found.std,
        "episodes": found.episodes,
    }


def as_data(subject: Subject, tally: Tally) -> dict[str, object]:
    """The same for `--json`."""
    return {
        "policy": subject.words,
        "environment": subject.environment.id,
        "return": estimate_data(tally.estimate),
        "first_seed": tally.seeds[0],
        "deterministic": tally.deterministic,
        "steps": tally.steps,
        "steps_with": tally.statuses,
    }
