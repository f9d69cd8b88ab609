"""A real Ray cluster on this machine, whose nodes can be killed."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from tests.support.command_line import ROOT

_PATIENCE = 150
_ATTEMPTS = 3
_MEMORY = ["--object-store-memory", "80000000"]
_QUIET = ["--disable-usage-stats"]


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


@dataclass
class Node:
    """A machine of the cluster: one `ray start` with all that it started."""

    process: subprocess.Popen[bytes]

    def processes(self) -> set[int]:
        """Those of the node, and the workers on it."""
        children: dict[int, set[int]] = {}
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit():
                try:
                    stat = (entry / "stat").read_text()
                except OSError:
                    continue
                state, parent = stat.rpartition(")")[2].split()[:2]
                if state != "Z":
                    children.setdefault(int(parent), set()).add(int(entry.name))
        found = {self.process.pid}
        ahead = [self.process.pid]
        while ahead:
            new = children.get(ahead.pop(), set()) - found
            found |= new
            ahead += new
        return found

    def workers(self) -> dict[int, str]:
        """The processes that work on tasks, each with what it is at."""
        found = {}
        for process in self.processes():
            try:
                title = Path(f"/proc/{process}/cmdline").read_bytes().rstrip(b"\0").decode()
            except OSError:
                continue
            if title.startswith(("ray::work_on", "ray::IDLE")):
                found[process] = title
        return found

    def kill_at_work(self) -> None:
        """Kill it as soon as it has something to do."""
        deadline = time.monotonic() + _PATIENCE
        while not any("work_on" in title for title in self.workers().values()):
            assert time.monotonic() < deadline
            time.sleep(0.01)
        self.kill()

    def kill(self) -> None:
        """As if its power were cut."""
        for process in self.processes():
            try:
                os.kill(process, signal.SIGKILL)
            except ProcessLookupError:
                continue
        self.process.wait(_PATIENCE)


@dataclass
class LocalCluster:
    """Nodes of one core each; the head is the first."""

    folder: Path
    port: int = field(default_factory=free_port)
    nodes: list[Node] = field(default_factory=list)

    @property
    def address(self) -> str:
        return f"127.0.0.1:{self.port}"

    def start(self, cpus: int = 1, path: Path = ROOT, options: Sequence[str] = ()) -> Node:
        """One more node, on which `path` is where Python finds pirlc; `options` for others."""
        ray = Path(sys.executable).parent / "ray"
        own = list(options)
        if not own and self.nodes:
            own = ["--address", self.address, *_QUIET]
        elif not own:
            own = ["--head", "--port", str(self.port), "--include-dashboard", "false", *_QUIET]
        if not self.nodes:
            own += ["--temp-dir", str(self.folder)]
        own += ["--node-ip-address", "127.0.0.1", "--num-cpus", str(cpus), "--block"]
        for _ in range(_ATTEMPTS):
            if self._started([str(ray), "start", *own, *_MEMORY], path):
                return self.nodes[-1]
        raise AssertionError(self._log.read_text())

    def _started(self, command: list[str], path: Path) -> bool:
        """Ray gives a new node 30 seconds, which may be too few on a busy machine."""
        before = len(self.alive())
        with self._log.open("wb") as log:
            process = subprocess.Popen(
                command,
                cwd=self.folder,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                # Ray's workers are nicer than all others, and would wait long on a busy machine.
                env={**os.environ, "PYTHONPATH": str(path), "RAY_worker_niceness": "0"},
                start_new_session=True,
            )
        node = Node(process)
        self.nodes.append(node)
        deadline = time.monotonic() + _PATIENCE
        while len(self.alive()) <= before and process.poll() is None:
            assert time.monotonic() < deadline, self._log.read_text()
            time.sleep(0.2)
        if process.poll() is None:
            return True
        self.nodes.remove(node)
        assert "timed out during startup" in self._log.read_text(), self._log.read_text()
        return False

    @property
    def _log(self) -> Path:
        return self.folder / "node.log"

    def alive(self) -> list[str]:
        """The nodes that the head knows of."""
        from ray._raylet import GcsClient

        try:
            socket.create_connection(("127.0.0.1", self.port), timeout=1).close()
        except OSError:
            return []
        infos = GcsClient(address=self.address).get_all_node_info()
        return [node.hex() for node, info in infos.items() if info.state == 0]

    def wait_for(self, nodes: int) -> None:
        """Until the head knows that so many are left."""
        deadline = time.monotonic() + _PATIENCE
        while len(self.alive()) != nodes:
            assert time.monotonic() < deadline
            time.sleep(0.2)

    def stop(self) -> None:
        for node in reversed(self.nodes):
            node.kill()


@contextmanager
def local_cluster(folder: Path, nodes: int = 2) -> Iterator[LocalCluster]:
    """A cluster of so many nodes, all of which end with the test."""
    # Sockets have short names.
    cluster = LocalCluster(folder)
    try:
        for _ in range(nodes):
            cluster.start()
        yield cluster
    finally:
        cluster.stop()
