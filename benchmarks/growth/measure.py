"""Measures each job in a process of its own.

A *server*, which has loaded the libraries and holds no data, forks for each job. The kernel's own
account of the finished child gives its peak memory; the child itself reads its processor time
before and after the work.
"""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import IO

SECONDS, REPEATS = 0.2, 7
"""A job repeats its work until one of them is reached."""

_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


@dataclass(frozen=True)
class Figure:
    """`seconds`: of processor time, the median of `repeats`. `peak`: bytes resident at most, from
    the start of the process to its end, preparation and libraries included."""

    seconds: float
    repeats: int
    peak: int


class Server:
    """The process that forks for each job. Use as a context manager."""

    def __init__(self) -> None:
        command = [sys.executable, "-m", "benchmarks.growth.measure"]
        environment = {**os.environ, **_ONE_THREAD}
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        )

    def __enter__(self) -> Server:
        return self

    def __exit__(self, *exception: object) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()

    def measure(self, stage: int, size: int) -> Figure:
        """A stage by its number in `STAGES`; -1 is an empty job. RuntimeError where it fails."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps([stage, size]), file=self._process.stdin, flush=True)
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError("the measuring process ended")
        answer = json.loads(line)
        if "error" in answer:
            raise RuntimeError(f"stage {stage} at {size}: {answer['error']}")
        return Figure(**answer)


def timed(work: Callable[[], object], long: bool) -> tuple[float, int]:
    """The median processor time of one call, and of how many calls.

    What is done in less than a few milliseconds is done several times between two looks at the
    clock. Work that is `long` is done once, without a first call that does not count.
    """
    spent: list[float] = []
    calls = 1
    if not long:
        before = time.process_time()
        work()
        first = time.process_time() - before
        calls = max(1, int(0.005 / max(first, 1e-6)))
        if first > 3 * SECONDS:
            return first, 1
    while sum(spent) * calls < SECONDS and len(spent) < REPEATS:
        before = time.process_time()
        for _ in range(calls):
            work()
        spent.append((time.process_time() - before) / calls)
        if long:
            break
    return statistics.median(spent), len(spent)


def _child(stage: int, size: int, answer: IO[str]) -> None:
    from benchmarks.growth.suite import STAGES

    if stage < 0:
        json.dump([0.0, 1], answer)
        return
    chosen = STAGES[stage]
    json.dump(timed(chosen.prepare(size), chosen.long), answer)


def _forked(stage: int, size: int) -> dict[str, object]:
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        status = 1
        try:
            os.close(read)
            with os.fdopen(write, "w") as answer:
                _child(stage, size, answer)
            status = 0
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(status)
    os.close(write)
    with os.fdopen(read) as pipe:
        text = pipe.read()
    _, status, usage = os.wait4(child, 0)
    if status or not text:
        return {"error": f"ended with status {os.waitstatus_to_exitcode(status)}"}
    seconds, repeats = json.loads(text)
    return asdict(Figure(seconds, repeats, usage.ru_maxrss * _UNIT))


_UNIT = 1 if sys.platform == "darwin" else 1024
"""Of `ru_maxrss`."""


def serve() -> None:
    """Answers jobs, a line of JSON each, until there are no more."""
    import benchmarks.growth.suite  # noqa: F401 -- loaded before the first fork

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for line in sys.stdin:
        stage, size = json.loads(line)
        try:
            answer = _forked(stage, size)
        except OSError:
            answer = {"error": traceback.format_exc()}
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    serve()
