"""Runs the rows that have no record yet, some at a time, and keeps what they give."""

from __future__ import annotations

import sys
import threading
import traceback
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass

from benchmarks.study.classic import Job
from benchmarks.study.records import Record, Results
from benchmarks.study.running import Children, Failed
from pirlc.diagnostics import PirlcError

Runner = Callable[[Job, Children], Record]


@dataclass(frozen=True)
class Done:
    """How many rows were run, how many had a record already, and what went wrong with others."""

    run: int
    known: int
    failures: tuple[tuple[str, str], ...]


def missing(jobs: Iterable[Job], records: Iterable[Record]) -> list[Job]:
    """Those without a record that was made as they would be made now."""
    known = {(r.method, r.environment, r.seed): r.figures.get("asked") for r in records}
    return [
        job for job in jobs if known.get((job.row.method, job.place.name, job.seed)) != job.asked
    ]


def perform(
    jobs: list[Job],
    results: Results,
    runner: Runner,
    at_a_time: int,
    lock: int | None,
) -> Done:
    """Runs what is missing. A row that fails is told at once, and the others go on.

    Raises KeyboardInterrupt after all that ran has left, each where it can go on from.
    """
    wanted = missing(jobs, results.read().records)
    children, failures, guard = Children(lock), [], threading.Lock()

    def one(job: Job) -> None:
        try:
            record = runner(job, children)
            results.write(record)
            tell(f"{job.name}: {_in_short(record)}")
        except (Exception, SystemExit) as e:
            # Whatever it is, the other rows have nothing to do with it.
            expected = isinstance(e, Failed | PirlcError | SystemExit | OSError)
            why = str(e) if expected else "".join(traceback.format_exception(e)).rstrip()
            with guard:
                failures.append((job.name, why))
            tell(f"{job.name}: failed\n{why}")

    with ThreadPoolExecutor(max_workers=at_a_time) as pool:
        running: set[Future[None]] = {pool.submit(one, job) for job in wanted}
        try:
            while running:
                done, running = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    future.result()
        except BaseException:
            children.interrupt()
            for future in running:
                future.cancel()
            raise
    return Done(len(wanted) - len(failures), len(jobs) - len(wanted), tuple(failures))


def _in_short(record: Record) -> str:
    found = record.ending if record.returns is None else f"{record.returns.mean:.2f}"
    size = "" if record.size is None else f", {record.size} nodes"
    took = "" if record.core_seconds is None else f", {record.core_seconds:.0f} core s"
    return f"{found}{size}{took}"


def tell(words: str) -> None:
    """To whoever watches; not part of the results."""
    print(words, file=sys.stderr, flush=True)
