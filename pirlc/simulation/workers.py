"""Work spread over processes, of this machine or of a cluster, that are kept between calls."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from pirlc.diagnostics import PirlcError
from pirlc.ir.policy import Environment
from pirlc.simulation.environments import Simulator, make
from pirlc.simulation.policy import PolicyFactory
from pirlc.simulation.problems import WorkerDied, failure
from pirlc.simulation.rollout import Episode, run_episode, run_returns

if TYPE_CHECKING:
    from pirlc.simulation.cluster.backend import RayBackend

Item = TypeVar("Item")
Result = TypeVar("Result")

_PIECES = 3
"""Pieces of work a process, so that none waits long for the slowest."""


@dataclass(frozen=True)
class Workers:
    """Who does the work: so many processes of this machine, or of a cluster.

    `backend` is one of joblib's. A single worker is this process itself.
    """

    count: int = 1
    backend: Literal["loky"] | RayBackend = "loky"

    def here(self) -> Workers:
        """Those for work that must stay on this machine."""
        return self if self.backend == "loky" else Workers(os.cpu_count() or 1)


ALONE = Workers()
"""This process."""


def parallel_map(
    function: Callable[[Item], Result], items: Sequence[Item], workers: Workers
) -> list[Result]:
    """``[function(item) for item in items]``, shared among the workers; the same for any.

    What `function` raises is raised here (of several PirlcErrors the first in the order of the
    items); a process that dies is PirlcError E0519. Ctrl-C interrupts this process alone,
    which then ends the others. On a cluster also PirlcError E0545 to E0549.
    """
    if workers.count <= 1 or len(items) <= 1:
        return [function(item) for item in items]
    from joblib import Parallel, delayed
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    try:
        outcomes: list[Result | _Failed] = Parallel(
            n_jobs=workers.count, backend=workers.backend, batch_size=1, pre_dispatch="all"
        )(delayed(_undisturbed)(function, item) for item in items)
    except TerminatedWorkerError as error:
        raise failure(WorkerDied(str(error).split("\n")[0])) from error
    results: list[Result] = []
    for outcome in outcomes:
        if isinstance(outcome, _Failed):
            raise outcome.error
        results.append(outcome)
    return results


@dataclass(frozen=True)
class _Failed:
    """Carried back as a value: raised in the worker, whichever came first in time would win."""

    error: PirlcError


def _undisturbed(function: Callable[[Item], Result], item: Item) -> Result | _Failed:
    # The terminal sends Ctrl-C to every process; only the first may show what it does with it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        return function(item)
    except PirlcError as error:
        return _Failed(error)


@lru_cache(maxsize=8)
def _made(key: str, environment: Environment, trust: bool) -> Simulator:  # noqa: ARG001
    return make(environment, trust)


def shared_simulator(environment: Environment, trust: bool = False) -> Simulator:
    """The environment, made once in each process. Episodes in it begin with a seeded reset."""
    # The key tells 1 from 1.0 and True, which compare equal.
    return _made(repr(environment), environment, trust)


def _pieces(seeds: Sequence[int], workers: Workers) -> list[Sequence[int]]:
    count = min(len(seeds), 1 if workers.count <= 1 else workers.count * _PIECES)
    cuts = [len(seeds) * i // count for i in range(count + 1)] if count else []
    return [seeds[a:b] for a, b in pairwise(cuts)]


def collect_returns(
    factory: PolicyFactory,
    environment: Environment,
    seeds: Sequence[int],
    workers: Workers = ALONE,
    trust: bool = False,
) -> NDArray[np.float64]:
    """The return of one episode from each seed, shape (len(seeds),), in the order of the seeds.

    The same for any number of workers. Raises PirlcError E0501 to E0506 and E0514 to E0519.
    """

    def work(piece: Sequence[int]) -> NDArray[np.float64]:
        return run_returns(shared_simulator(environment, trust), factory(), piece)

    parts = parallel_map(work, _pieces(seeds, workers), workers)
    return np.concatenate([np.empty(0), *parts])


def collect_returns_of_each(
    factories: Sequence[PolicyFactory],
    environment: Environment,
    seeds: Sequence[int],
    workers: Workers = ALONE,
    trust: bool = False,
) -> NDArray[np.float64]:
    """The returns of several policies from the same seeds, shape (len(factories), len(seeds))."""

    def work(factory: PolicyFactory) -> NDArray[np.float64]:
        return run_returns(shared_simulator(environment, trust), factory(), seeds)

    rows = parallel_map(work, factories, workers)
    return np.array(rows, dtype=np.float64).reshape(len(factories), len(seeds))


def collect_episodes(
    factory: PolicyFactory,
    environment: Environment,
    seeds: Sequence[int],
    workers: Workers = ALONE,
    trust: bool = False,
) -> list[Episode]:
    """One episode from each seed, in the order of the seeds; raises as `collect_returns` does."""

    def work(piece: Sequence[int]) -> list[Episode]:
        simulator, policy = shared_simulator(environment, trust), factory()
        return [run_episode(simulator, policy, seed) for seed in piece]

    parts = parallel_map(work, _pieces(seeds, workers), workers)
    return [episode for part in parts for episode in part]
