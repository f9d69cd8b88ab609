"""The progress of a synthesis on the terminal: the stage, a bar, the best program so far."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from pirlc.cli.measure import number
from pirlc.cli.oracles import training_words
from pirlc.cli.session import is_terminal
from pirlc.ir.printer import program_text
from pirlc.oracle.training import Progress as Training
from pirlc.search.candidate import Candidate
from pirlc.search.settings import Progress as Searching

if TYPE_CHECKING:
    from rich.live import Live
    from rich.progress import Progress as Bar

_LINES = 14


class Watcher:
    """Is told how a synthesis goes on, and shows nothing."""

    def search(self, progress: Searching) -> None:
        """A step of the search."""

    def training(self, progress: Training) -> None:
        """A step of the oracle's training."""


@contextmanager
def watching() -> Iterator[Watcher]:
    """A watcher that shows what it is told, where stderr is a terminal."""
    if not is_terminal(sys.stderr):
        yield Watcher()
        return
    from rich.console import Console
    from rich.live import Live
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    bar = Progress(
        TextColumn("{task.description}", table_column=None),
        BarColumn(bar_width=30),
        TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("{task.fields[words]}"),
    )
    console = Console(stderr=True)
    with Live(bar, console=console, refresh_per_second=4, transient=True) as live:
        yield _Shown(live, bar)


class _Shown(Watcher):
    def __init__(self, live: Live, bar: Bar) -> None:
        self._live = live
        self._bar = bar
        self._task = bar.add_task("starting", total=1.0, words="")
        self._best: Candidate | None = None

    def search(self, progress: Searching) -> None:
        self._show(progress.stage, progress.done / max(1, progress.total), "")
        if progress.best is not None and progress.best is not self._best:
            from rich.console import Group
            from rich.text import Text

            self._best = progress.best
            self._live.update(Group(self._bar, Text(best_in_words(progress.best))))

    def training(self, progress: Training) -> None:
        self._show("training the oracle", progress.fraction, training_words(progress))

    def _show(self, stage: str, fraction: float, words: str) -> None:
        self._bar.update(self._task, description=stage, completed=fraction, words=words)


def best_in_words(best: Candidate) -> str:
    """The best program so far, without its declarations of sensors, cut to a few lines."""
    reached = f"distance {best.loss:.4g}" if best.returns is None else f"return {number(best.mean)}"
    text = program_text(best.program).splitlines()
    first = next((i for i, line in enumerate(text) if line.startswith(("param ", "action "))), 0)
    shown = text[first : first + _LINES]
    if len(text) - first > _LINES:
        shown.append("...")
    head = f"\nbest so far: {reached}, {best.size} nodes\n"
    return "\n".join([head, *(f"  {line}" for line in shown)])
