"""Work for other processes, in a module that they can import."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path


def squared(x: int) -> tuple[int, int]:
    time.sleep(0.2)
    return x * x, os.getppid()


def fails_at_3(x: int) -> int:
    if x == 3:
        raise ValueError("not three")
    return x


def kills_its_worker(x: int) -> int:
    if x == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return x


def dies_once(marks: Path) -> Callable[[int], int]:
    """Work whose worker dies where it is done for the first time."""

    def work(x: int) -> int:
        mark = marks / str(x)
        if x == 3 and not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return -x

    return work
