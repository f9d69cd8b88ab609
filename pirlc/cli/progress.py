"""Progress on the terminal; nothing at all where stderr is none."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from pirlc.cli.session import is_terminal


@contextmanager
def counting(words: str, total: int) -> Iterator[tuple[bool, Callable[[int], None]]]:
    """Whether a bar is shown, and what moves it on."""
    if not is_terminal(sys.stderr):
        yield False, lambda _: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    columns = (words, BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(words, total=total)
        yield True, lambda done: bar.advance(task, done)


@contextmanager
def training() -> Iterator[Callable[[float, str], None] | None]:
    """What shows a fraction (0 to 1) and words beside it; None where nothing is shown."""
    if not is_terminal(sys.stderr):
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = ("training", BarColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda fraction, words: bar.update(task, completed=fraction, description=words)


@contextmanager
def busy(words: str) -> Iterator[Callable[[str], None]]:
    """Shows that something is going on, and in what words; what is yielded changes them."""
    if not is_terminal(sys.stderr):
        yield lambda _: None
        return
    from rich.console import Console

    with Console(stderr=True).status(words) as status:
        yield status.update
