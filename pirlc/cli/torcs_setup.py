"""TORCS prepared and examined."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from pirlc.cli.guard import REFUSED
from pirlc.cli.session import Session, is_terminal
from pirlc.simulation.torcs.doctor import Check, examine
from pirlc.simulation.torcs.install import Prepared, Stage, Tell, install


def prepare(session: Session, source: Path | None) -> None:
    """Prepare TORCS in the user's cache and say what there is."""
    with _telling(session) as tell:
        prepared = install(source=source, tell=tell)
    session.say(_in_words(prepared))
    done = "prepared in" if prepared.changed else "nothing to do: prepared before, in"
    session.say(f"{done} {prepared.folder}")
    record = {key: value for key, value in asdict(prepared.record).items() if key != "torcs"}
    session.finish({"changed": prepared.changed, "folder": str(prepared.folder), "torcs": record})


def _in_words(prepared: Prepared) -> str:
    record = prepared.record
    lengths = ", ".join(f"{track} {length:,.0f} m" for track, length in record.tracks.items())
    return f"TORCS {record.version}: a command every {record.control_interval:g} s\n{lengths}"


@contextmanager
def _telling(session: Session) -> Iterator[Tell]:
    """Progress on the terminal. That there is something to wait for is said anywhere."""

    def waiting(stage: Stage) -> None:
        if stage is Stage.WAITING and not session.json:
            print(stage.value, file=sys.stderr, flush=True)

    if not is_terminal(sys.stderr):
        yield lambda stage, _: waiting(stage)
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("looking around", total=1.0)

        def show(stage: Stage, fraction: float) -> None:
            # What tells no fractions moves to and fro.
            known = stage not in (Stage.WAITING, Stage.BUILDING)
            bar.update(
                task,
                description=stage.value,
                completed=fraction,
                total=1.0 if known else None,
            )

        yield show


def show_health(session: Session) -> int:
    """Say of each check whether it is well; the exit code."""
    checks = examine()
    width = max(len(check.name) for check in checks)
    for check in checks:
        session.say(_check_in_words(check, width))
    well = all(check.ok for check in checks)
    session.finish({"ok": well, "checks": [asdict(check) for check in checks]})
    return 0 if well else REFUSED


def _check_in_words(check: Check, width: int) -> str:
    line = f"{'ok   ' if check.ok else 'WRONG'} {check.name:<{width}}  {check.found}"
    return f"{line}\n{'':{width + 6}}  {check.advice}" if check.advice else line
