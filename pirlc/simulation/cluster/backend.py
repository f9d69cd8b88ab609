"""A Ray cluster as a backend of joblib."""

from __future__ import annotations

import os
import pickle
import re
import socket
import subprocess
import sys
import tempfile
import threading
from concurrent.futures import Future, InvalidStateError
from contextlib import suppress
from importlib.util import find_spec
from itertools import count
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import IO, Any, assert_never

from joblib.externals.loky.backend.reduction import dumps
from joblib.parallel import ParallelBackendBase, SequentialBackend

from pirlc.simulation.cluster.driver import Died, Outcome, Raised, Ready, Returned
from pirlc.simulation.cluster.problems import (
    ClusterLost,
    NoCluster,
    NodeDiffers,
    NodeUnusable,
    NotShipped,
    Problem,
    RayMissing,
    failure,
)
from pirlc.simulation.problems import WorkerDied
from pirlc.simulation.problems import failure as simulation_failure

_PATIENCE = 180.0
"""Seconds for a connection to a cluster."""

_KNOCK = 5.0
"""Seconds for an answer from an address."""

_QUIET = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_DISABLE_IMPORT_WARNING": "1",
    # Out of memory counts as a death like others: not for ever.
    "RAY_task_oom_retries": "3",
    # Seconds after which a head that does not answer is gone.
    "RAY_gcs_rpc_server_reconnect_timeout_s": "20",
}


class RayBackend(ParallelBackendBase):  # type: ignore[misc]  # joblib comes without types
    """Work of joblib done on a Ray cluster, through a process of its own.

    `most` bounds how much is done at once; None leaves that to the cluster's CPUs. Connected where
    it is made, until `close`; an interrupted call loses the connection, and the next one makes
    another. What a dead worker or node had under way is done again elsewhere.
    Raises PirlcError E0545 to E0549, and E0519 for work that kills each worker it meets.
    """

    supports_retrieve_callback = True
    supports_sharedmem = False
    uses_threads = False

    def __init__(self, address: str = "auto", most: int | None = None) -> None:
        super().__init__(nesting_level=0)
        self.address = address
        self.most = most
        self._link: _Link | None = None
        self.at_once = most or self._connected().cpus
        self._connected()

    def __enter__(self) -> RayBackend:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the cluster; what is under way there ends."""
        if self._link is not None:
            self._link.close()
            self._link = None

    def _connected(self) -> _Link:
        if self._link is None:
            self._link = _Link(self.address, self.most)
        return self._link

    # What joblib asks of a backend.

    def effective_n_jobs(self, n_jobs: int) -> int:
        return n_jobs

    def submit(self, func: Any, callback: Any = None) -> Future[Any]:
        try:
            work = bytes(dumps(func))
        except Exception as error:
            raise failure(NotShipped(str(error).split("\n")[0])) from error
        future = self._connected().submit(work)
        if callback is not None:
            future.add_done_callback(callback)
        return future

    def retrieve_result_callback(self, out: Future[Any]) -> Any:
        return out.result()

    def get_nested_backend(self) -> tuple[Any, None]:
        return SequentialBackend(nesting_level=1), None

    def abort_everything(self, ensure_ready: bool = True) -> None:
        del ensure_ready
        self.close()


class _Link:
    """The driver process, and the work that it has not answered yet."""

    def __init__(self, address: str, most: int | None) -> None:
        if find_spec("ray") is None:
            raise failure(RayMissing("there is no module called `ray`"))
        _knock(address)
        own, other = socket.socketpair()
        self._log: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 (closed by `close`)
        with other:
            told = (str(other.fileno()), address, str(most or 0))
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "pirlc.simulation.cluster", *told],
                stdin=subprocess.DEVNULL,
                stdout=self._log,
                stderr=self._log,
                pass_fds=[other.fileno()],
                # It finds the pirlc that runs here, and nothing else than that finds.
                env={**os.environ, **_QUIET, "PYTHONPATH": os.pathsep.join(_search_path())},
                # Ctrl-C at the terminal is for pirlc alone.
                start_new_session=True,
            )
        # Closing a connection does not wake who reads from it; shutting down its socket does.
        self._socket = own
        self._channel = Connection(os.dup(own.fileno()))
        self._sending = threading.Lock()
        self._numbers = count()
        self._waiting: dict[int, Future[Any]] = {}
        self._ended: Problem | None = None
        self._reader: threading.Thread | None = None
        try:
            self.cpus = self._greeted(address)
        except BaseException:
            self.close()
            raise
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _greeted(self, address: str) -> int:
        if not self._channel.poll(_PATIENCE):
            raise failure(NoCluster(address, f"no answer within {_PATIENCE:.0f} s"))
        try:
            message = pickle.loads(self._channel.recv_bytes())
        except EOFError:
            raise failure(NoCluster(address, self._last_words())) from None
        if isinstance(message, Ready):
            return message.cpus
        raise failure(message)

    def submit(self, work: bytes) -> Future[Any]:
        number = next(self._numbers)
        future: Future[Any] = Future()
        self._waiting[number] = future
        try:
            with self._sending:
                self._channel.send_bytes(pickle.dumps((number, work)))
        except OSError:
            # The reader will see the end, or has seen it.
            if self._reader is not None:
                self._reader.join()
        if self._ended is not None:
            _fail(future, self._ended)
        return future

    def _read(self) -> None:
        try:
            while self._ended is None:
                message = pickle.loads(self._channel.recv_bytes())
                match message:
                    case (int(number), outcome):
                        _settle(self._waiting.pop(number), outcome)
                    case problem:
                        self._ended = problem
        except (EOFError, OSError):
            self._ended = ClusterLost(self._last_words())
        for future in list(self._waiting.values()):
            _fail(future, self._ended)

    def _last_words(self) -> str:
        """Of the driver: Ray tells on its error output why it ends the process."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(5)
        self._log.seek(0)
        lines = self._log.read().decode("utf-8", "replace").splitlines()
        told = [line for line in lines if "GCS" in line or "raylet" in line.lower()]
        if not told:
            return "the connection to it ended"
        # [time, severity and process] file.h:12: The first sentence. Others.
        words = re.sub(r"^(\[[^]]*\])?\s*(\([^)]*\))?\s*(\S+:\d+: )?", "", told[-1])
        return words.strip().split(". ")[0].rstrip(".")

    def close(self) -> None:
        """Ends the driver, and so its work on the cluster."""
        self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        try:
            self._process.wait(5)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._reader is not None:
            self._reader.join()
        self._channel.close()
        self._log.close()


def _fail(future: Future[Any], problem: Problem) -> None:
    # Both threads may do it, when work is submitted as the connection ends.
    with suppress(InvalidStateError):
        future.set_exception(failure(problem))


def _settle(future: Future[Any], outcome: Outcome) -> None:
    match outcome:
        case Returned(value):
            try:
                future.set_result(pickle.loads(value))
            except Exception as error:
                future.set_exception(error)
        case Raised(error):
            future.set_exception(error)
        case Died(reason):
            future.set_exception(simulation_failure(WorkerDied(reason)))
        case NodeDiffers() | NodeUnusable() | NotShipped():
            future.set_exception(failure(outcome))
        case _:
            assert_never(outcome)


def _search_path() -> list[str]:
    return [entry or str(Path.cwd()) for entry in sys.path]


def _knock(address: str) -> None:
    """Ray itself tries for minutes to reach an address at which nobody is."""
    if address == "auto":
        return
    host, colon, port = address.rpartition(":")
    if not colon or "://" in address or not port.isdigit():
        reason = "an address has the form HOST:PORT, such as `10.0.0.1:6379`, or is `auto`"
        raise failure(NoCluster(address, reason))
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_KNOCK).close()
    except (OSError, OverflowError) as error:
        reason = error.strerror or str(error) if isinstance(error, OSError) else str(error)
        raise failure(NoCluster(address, reason)) from None
