"""The record of a search: every expensive result, once, as lines of JSON.

A search is a deterministic computation over expensive calls (tune a template, simulate a program).
Each call goes through the journal, which answers what it already knows. So a search that was cut
off resumes by running again: it reads what it had done and goes on where it stopped. A line that
was cut off in the middle is dropped.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

from pirlc.backend.files import not_writable

Item = TypeVar("Item")


class BudgetExhausted(Exception):
    """The search has used up its calls or its time; what it found so far stands."""


@dataclass
class Budget:
    """How much a search may do: a number of journal entries, or seconds, or both.

    Seconds count from `started` on `clock`. A search stopped by time made `Journal.used` calls;
    the same search with that number as `calls` stops at the same place.
    """

    calls: int | None = None
    seconds: float | None = None
    clock: Callable[[], float] = time.monotonic
    started: float = field(init=False)
    paused: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        self.started = self.clock()

    @property
    def elapsed(self) -> float:
        return self.clock() - self.started

    def allows(self, used: int) -> bool:
        return (self.calls is None or used < self.calls) and (
            self.seconds is None or self.elapsed - self.paused < self.seconds
        )


class Journal:
    """The results of expensive calls, kept in memory and appended to a file.

    `used` counts the calls answered since the journal was opened, known and new alike;
    `stopped_at` is that count when the budget was found to be used up.
    """

    def __init__(self, path: Path | None, budget: Budget) -> None:
        self.budget = budget
        self.used = 0
        self._lifted = False
        self.stopped_at: int | None = None
        self._path = path
        self._known: dict[str, Any] = {}
        self._file = None
        if path is not None:
            self._known = dict(_read(path))
            try:
                self._file = path.open("a", encoding="utf-8")
            except OSError as e:
                raise not_writable(path, e) from None

    def lift_budget(self) -> None:
        """Lets every further call through: those that evaluate what was found."""
        self._lifted = True

    @contextmanager
    def apart_from_budget(self) -> Iterator[None]:
        """Calls within are not counted, and their time is not taken from the budget's."""
        used, lifted, began = self.used, self._lifted, self.budget.clock()
        self._lifted = True
        try:
            yield
        finally:
            self.used, self._lifted = used, lifted
            self.budget.paused += self.budget.clock() - began

    def close(self) -> None:
        if self._file is not None:
            # Whatever could not be written was told when it was flushed.
            with suppress(OSError):
                self._file.close()

    def each(
        self,
        kind: str,
        items: Sequence[Item],
        keys: Sequence[str],
        run: Callable[[Sequence[Item]], Iterable[Any]],
    ) -> list[Any]:
        """The results for the items; `run` computes those that are not known, in their order.

        `keys` must tell everything that a result depends on; results must survive JSON. A batch
        counts as one call for each item, and is not begun if the budget is used up: then this
        raises `BudgetExhausted`.
        """
        if not self._lifted and not self.budget.allows(self.used):
            self.stopped_at = self.used
            raise BudgetExhausted
        names = [f"{kind}:{digest(key)}" for key in keys]
        missing = {n: i for n, i in zip(names, items, strict=True) if n not in self._known}
        if missing:
            for name, result in zip(missing, run(list(missing.values())), strict=True):
                self._known[name] = result
                self._append({"key": name, "result": result})
        self.used += len(names)
        return [self._known[name] for name in names]

    def _append(self, entry: dict[str, Any]) -> None:
        if self._file is not None and self._path is not None:
            try:
                self._file.write(json.dumps(entry) + "\n")
                self._file.flush()
            except OSError as e:
                raise not_writable(self._path, e) from None


def digest(text: str) -> str:
    """A short name for a long key."""
    return sha256(text.encode()).hexdigest()[:24]


def _read(path: Path) -> Iterator[tuple[str, Any]]:
    if not path.exists():
        return
    kept = 0
    with path.open("rb") as file:
        for line in file:
            if not line.endswith(b"\n"):
                break
            try:
                entry = json.loads(line)
                yield entry["key"], entry["result"]
            except (ValueError, KeyError, TypeError):
                break
            kept += len(line)
    if kept < path.stat().st_size:
        with path.open("r+b") as file:
            file.truncate(kept)
