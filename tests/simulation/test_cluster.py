"""Work on a Ray cluster, whose nodes are processes of this machine and can be killed."""

from __future__ import annotations

import signal
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("ray")

from pirlc.diagnostics import Diagnostic, PirlcError, render
from pirlc.search.candidate import Candidate
from pirlc.search.journal import Budget, Journal
from pirlc.search.settings import Progress
from pirlc.simulation.cluster.backend import RayBackend
from pirlc.simulation.workers import ALONE, Workers, parallel_map
from tests.support.cluster_work import dies_once, fails_at_3, kills_its_worker, squared
from tests.support.ray_cluster import local_cluster
from tests.support.small_search import Run, imitate, search_in


@pytest.fixture(autouse=True)
def no_hang() -> Iterator[None]:
    """A cluster that does not answer ends the test, not the patience of who waits for it."""

    def too_long(*_: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, too_long)
    signal.alarm(500)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture
def folder() -> Iterator[Path]:
    """With a short name, for Ray keeps sockets in it."""
    with tempfile.TemporaryDirectory(prefix="ray", ignore_cleanup_errors=True) as made:
        yield Path(made)


def refused(action: Callable[[], object]) -> Diagnostic:
    with pytest.raises(PirlcError) as caught:
        action()
    return caught.value.diagnostics[0]


def values(found: list[tuple[int, int]]) -> list[int]:
    return [value for value, _ in found]


def test_one_node(folder: Path) -> None:
    with local_cluster(folder, nodes=0) as cluster:
        cluster.start(cpus=2)
        with RayBackend(cluster.address) as backend:
            assert backend.at_once == 2
            workers = Workers(backend.at_once, backend)
            assert workers.here().backend == "loky"
            assert values(parallel_map(squared, range(6), workers)) == [0, 1, 4, 9, 16, 25]
            # Errors arrive as they are, and the next call works.
            with pytest.raises(ValueError, match="not three"):
                parallel_map(fails_at_3, range(6), workers)
            # The work of a worker that died is done again, a few times.
            assert parallel_map(dies_once(folder), range(6), workers) == [0, -1, -2, -3, -4, -5]
            found = refused(lambda: parallel_map(kills_its_worker, range(6), workers))
            assert found.code == "E0519"
            lock = threading.Lock()
            found = refused(lambda: parallel_map(lambda _: lock.locked(), range(2), workers))
            assert found.code == "E0549"
            assert render(found).splitlines()[1] == "  = note: cannot pickle '_thread.lock' object"


@pytest.fixture(scope="module")
def alone() -> tuple[Run, Candidate]:
    """A small search in this process."""
    run = search_in(Journal(None, Budget()), workers=ALONE)
    return run, imitate(run)


class Watched:
    """Does something once, when a stage of a search begins."""

    def __init__(self, stage: str, action: Callable[[], None]) -> None:
        self.stage = stage
        self.action: Callable[[], None] | None = action

    def __call__(self, progress: Progress) -> None:
        if self.action is not None and progress.stage.startswith(self.stage):
            action, self.action = self.action, None
            # The search goes on meanwhile.
            threading.Thread(target=action).start()


@pytest.mark.slow
def test_a_node_is_killed_during_a_search(alone: tuple[Run, Candidate], folder: Path) -> None:
    expected, found = alone
    with local_cluster(folder) as cluster:
        with RayBackend(cluster.address) as backend:
            on_two = search_in(Journal(None, Budget()), workers=Workers(backend.at_once, backend))
            assert imitate(on_two) == found
            assert on_two.recorded == expected.recorded
            places = parallel_map(squared, range(8), Workers(backend.at_once, backend))
            assert len({place for _, place in places}) == 2
        with RayBackend(cluster.address) as backend:
            on_one = search_in(Journal(None, Budget()), workers=Workers(backend.at_once, backend))
            killing = Watched("tune (iteration 1)", cluster.nodes[1].kill_at_work)
            on_one.search.tell = killing
            assert imitate(on_one) == found
            assert on_one.recorded == expected.recorded
            assert killing.action is None
            assert cluster.nodes[1].process.poll() is not None


@pytest.mark.slow
def test_the_cluster_is_gone(alone: tuple[Run, Candidate], folder: Path, tmp_path: Path) -> None:
    expected, found = alone
    path = tmp_path / "journal"
    with local_cluster(folder) as cluster, RayBackend(cluster.address) as backend:
        journal = Journal(path, Budget())
        run = search_in(journal, workers=Workers(backend.at_once, backend))
        run.search.tell = Watched("tune (iteration 1)", cluster.stop)
        diagnostic = refused(lambda: imitate(run))
        journal.close()
        assert diagnostic.code == "E0548"
        assert diagnostic.notes == ("Failed to connect to GCS within 20 seconds",)
        # Nor is there one for the next call.
        workers = Workers(backend.at_once, backend)
        assert refused(lambda: parallel_map(squared, range(2), workers)).code == "E0546"
    journal = Journal(path, Budget())
    assert path.read_bytes()
    again = search_in(journal)
    assert imitate(again) == found
    assert again.recorded == expected.recorded
    journal.close()
