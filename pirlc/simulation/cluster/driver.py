"""The process that stands between pirlc and a Ray cluster.

Ray ends the process that uses it when the cluster is gone, writes to its output and changes its
signal handlers; so that process is one of its own, run as ``python -m`` with the number of an open
socket, an address, and how much may be under way at once (0: no matter). Messages are pickled. It
is sent ``(number, work)`` with the bytes of a function, and answers `Ready`, then
``(number, outcome)`` each; a `Problem` ends it.

Goals: work whose worker or node dies is done again elsewhere, a bounded number of times.
Non-goals: order, and what the work means.
"""

from __future__ import annotations

import os
import pickle
import socket
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from typing import Any

from pirlc.simulation.cluster.problems import (
    ClusterLost,
    NoCluster,
    NodeDiffers,
    NodeUnusable,
    NotShipped,
    Problem,
    RayMissing,
)
from pirlc.simulation.cluster.sameness import Traits, first_difference, traits

RETRIES = 3
"""How often work is done again whose worker died."""

_PATIENCE = 15.0
"""Seconds without any node that could work after which the cluster counts as gone."""

_LOOK = 2.0
"""Seconds between two looks at the nodes."""


@dataclass(frozen=True)
class Ready:
    """The cluster is there, and all its nodes compute as this machine does."""

    cpus: int


@dataclass(frozen=True)
class Returned:
    """The pickled value."""

    value: bytes


@dataclass(frozen=True)
class Raised:
    error: BaseException


@dataclass(frozen=True)
class Died:
    """The workers that tried, each with its process."""

    reason: str


Outcome = Returned | Raised | Died | NodeDiffers | NodeUnusable | NotShipped


def work_on(here: Traits, work: bytes, node: str = "") -> Outcome:
    """On a node: what the pickled function gives.

    Compares first, for the node may have joined late.
    """
    difference = first_difference(here, traits())
    if difference is not None:
        return NodeDiffers(node or socket.gethostname(), *difference)
    from joblib.externals.loky.backend.reduction import dumps

    try:
        function: Callable[[], Any] = pickle.loads(work)
    except Exception as error:
        return NotShipped(f"{_words(error)} on {socket.gethostname()}")
    try:
        value = function()
    except Exception as error:
        error.add_note("".join(traceback.format_exception(error)))
        return Raised(error)
    try:
        return Returned(bytes(dumps(value)))
    except Exception as error:
        return NotShipped(_words(error))


def _words(error: BaseException) -> str:
    lines = [line.strip() for line in str(error).strip().splitlines() if line.strip()]
    return lines[-1] if lines else type(error).__name__


class _Driver:
    """Hands work on, and tells outcomes in the order in which they come."""

    def __init__(self, channel: Connection, most: int) -> None:
        self._channel = channel
        self._most = most
        self._lock = threading.RLock()
        self._ahead: deque[tuple[int, bytes]] = deque()
        self._under_way: dict[int, Any] = {}
        self._remote: Any = None

    def tell(self, message: object) -> None:
        with self._lock:
            self._channel.send_bytes(pickle.dumps(message))

    def run(self, address: str) -> Problem | None:
        """Until the other side closes the channel, or with what went wrong."""
        try:
            import ray
        except ImportError as error:
            return RayMissing(_words(error))
        try:
            ray.init(address=address, log_to_driver=False, logging_level="critical")
        except Exception as error:
            return NoCluster(address, _words(error))
        cpus = 0
        for node in self._nodes():
            problem = self._probe(node)
            if problem is not None:
                return problem
            cpus += int(node["Resources"]["CPU"])
        if cpus == 0:
            return NoCluster(address, "none of its nodes has a CPU to work with")
        self.tell(Ready(cpus))
        self._remote = ray.remote(max_retries=RETRIES, num_cpus=1, scheduling_strategy="SPREAD")(
            work_on
        )
        seen = time.monotonic()
        while True:
            try:
                if self._channel.poll(_LOOK):
                    self._ahead.append(pickle.loads(self._channel.recv_bytes()))
                    self._fill()
                    continue
            except EOFError:
                ray.shutdown()
                return None
            if not self._under_way or self._some_node():
                seen = time.monotonic()
            elif time.monotonic() - seen > _PATIENCE:
                return ClusterLost("none of its nodes is left")

    def _fill(self) -> None:
        with self._lock:
            while self._ahead and (self._most == 0 or len(self._under_way) < self._most):
                number, work = self._ahead.popleft()
                reference = self._under_way[number] = self._remote.remote(traits(), work)
                reference.future().add_done_callback(partial(self._finished, number))

    def _nodes(self) -> list[dict[str, Any]]:
        """Those that can work."""
        import ray

        return [n for n in ray.nodes() if n["Alive"] and n["Resources"].get("CPU", 0) >= 1]

    def _some_node(self) -> bool:
        try:
            return bool(self._nodes())
        except Exception:
            return False  # the head does not answer: perhaps at the next look

    def _probe(self, node: dict[str, Any]) -> Problem | None:
        import ray
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        strategy = NodeAffinitySchedulingStrategy(node["NodeID"], soft=False)
        name = f"{node['NodeManagerAddress']} ({node['NodeManagerHostname']})"
        work = pickle.dumps(_nothing)
        remote = ray.remote(num_cpus=0, max_retries=RETRIES)(work_on)
        try:
            found = ray.get(
                remote.options(scheduling_strategy=strategy).remote(traits(), work, name)
            )
        except Exception as error:
            alive = any(n["NodeID"] == node["NodeID"] for n in self._nodes())
            return NodeUnusable(name, _words(error)) if alive else None
        return found if isinstance(found, NodeDiffers | NodeUnusable | NotShipped) else None

    def _finished(self, number: int, future: Any) -> None:
        from ray.exceptions import RayError

        with self._lock:
            del self._under_way[number]
            self._fill()
        error = future.exception()
        outcome: Outcome
        if error is None:
            outcome = future.result()
        elif isinstance(error, RayError):
            outcome = Died(_words(error))
        else:
            outcome = NodeUnusable("?", _words(error))
        self.tell((number, outcome))


def _nothing() -> None:
    """Work for a probe."""


def main() -> None:
    """The process."""
    channel = Connection(int(sys.argv[1]))
    driver = _Driver(channel, int(sys.argv[3]))
    try:
        problem = driver.run(sys.argv[2])
        if problem is not None:
            driver.tell(problem)
    except (BrokenPipeError, EOFError, ConnectionResetError):
        pass
    sys.stderr.flush()
    # Ray's own threads may wait for a cluster that is gone.
    os._exit(0)
