"""What processes hold, and which there are: from Linux's /proc."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path


def resident(pid: int) -> int:
    """Bytes of memory that a process holds."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def descriptors(pid: int) -> int:
    """How many files and sockets a process has open."""
    return sum(1 for _ in Path(f"/proc/{pid}/fd").iterdir())


def children(pid: int) -> list[int]:
    """The processes that a process has started and that still run."""
    return [of for of, state, parent, _ in _processes() if parent == pid and state != "Z"]


def group(leader: int) -> list[int]:
    """The processes of a group, those that have ended and were not waited for included."""
    return [of for of, _, _, its_group in _processes() if its_group == leader]


def _processes() -> Iterator[tuple[int, str, int, int]]:
    """Of each: its number, its state, its parent's number, its group's."""
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rpartition(") ")[2].split()
            except OSError:
                continue
            yield int(entry.name), fields[0], int(fields[1]), int(fields[2])
