"""Commands of pirlc as a user gives them, and what they took."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import pirlc
from benchmarks.study.records import COMPLETE, NONE, ROOT, TIMEOUT
from pirlc.backend.files import write_text
from pirlc.search.synthesis import Ending

FINISHED = (Ending.FINISHED.value, Ending.BUDGET.value, Ending.TIMEOUT.value)
"""Endings of a search that leave nothing to go on with."""

DONE = (0, 3)
"""Exit codes of a run that came to its end, with a program or with a timeout."""

NOTHING_THERE = ("E0430", "E0435")
"""What `pirlc synth` says where the optimiser can take no template, and where a sketch has no
program without `if`."""

REFUSED = ("E0722", "E0723", "E0724")
"""What it says where the folder is not that of this run; then it changes nothing there."""

TOLD = 25
"""Lines of a failed command that are shown."""


class Failed(Exception):
    """A command that did not do what it was to do, in words for the user."""


@dataclass(frozen=True)
class Took:
    """CPU time of a process and of all that it has waited for, and time on the clock, in s."""

    core: float
    wall: float

    def __add__(self, other: Took) -> Took:
        return Took(self.core + other.core, self.wall + other.wall)


class Children:
    """The processes that this study has started and that still run.

    Each leads a session of its own, so that an interruption reaches it once, from `interrupt`. It
    keeps the lock of the run folders open: should this process die without them, no other study
    may write where they still do.
    """

    def __init__(self, lock: int | None = None) -> None:
        self._lock = () if lock is None else (lock,)
        self._running: set[int] = set()
        self._guard = threading.Lock()
        self.interrupted = False

    def run(self, command: list[str], log: Path, answer: Path | None = None) -> tuple[int, Took]:
        """Runs a command from the repository's root; what it says goes to the log, but what it
        answers (its standard output) to a file of its own, if one is named. Returns its exit code,
        or minus the signal that ended it, and what it took."""
        started = time.monotonic()
        log.parent.mkdir(parents=True, exist_ok=True)
        with log.open("wb") as said, ExitStack() as also:
            output = said if answer is None else also.enter_context(answer.open("wb"))
            with self._guard:
                if self.interrupted:
                    raise KeyboardInterrupt
                child = subprocess.Popen(
                    command,
                    cwd=ROOT,
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=said,
                    start_new_session=True,
                    pass_fds=self._lock,
                )
                self._running.add(child.pid)
            # Of this child alone: others may end at the same time.
            _, status, usage = os.wait4(child.pid, 0)
            with self._guard:
                self._running.discard(child.pid)
            child.returncode = os.waitstatus_to_exitcode(status)
        wall = time.monotonic() - started
        return child.returncode, Took(usage.ru_utime + usage.ru_stime, wall)

    def interrupt(self) -> None:
        """Tells all to leave, as Ctrl-C would; none is started any more."""
        with self._guard:
            self.interrupted = True
            for pid in self._running:
                with suppress(ProcessLookupError):  # It has just ended.
                    os.kill(pid, signal.SIGINT)


@dataclass(frozen=True)
class Run:
    """A run of `pirlc synth`: `words` follow `pirlc synth SKETCH -o FOLDER`."""

    sketch: Path
    folder: Path
    words: tuple[str, ...]

    @property
    def command(self) -> tuple[str, ...]:
        """As a user would type it at the repository's root."""
        return ("pirlc", "synth", short(self.sketch), "-o", short(self.folder), *self.words)

    @property
    def log(self) -> Path:
        return self.folder.with_name(self.folder.name + ".log")

    @property
    def asked(self) -> dict[str, Any]:
        """What tells whether a record or a folder is of this run."""
        return {"words": list(self.words), "sketch": digest(self.sketch)}


@dataclass(frozen=True)
class Outcome:
    """What came of a run.

    `manifest` is None where no program came of it; `ending` and `why` say the reason. `took` is
    None where it is not known.
    """

    manifest: dict[str, Any] | None
    took: Took | None
    resumed: bool
    ending: str = COMPLETE
    why: str | None = None


def digest(path: Path) -> str:
    return sha256(path.read_bytes()).hexdigest()


def short(path: Path) -> str:
    """The path from the repository's root, if it is in it: a record names no machine's places."""
    resolved = path.resolve()
    return str(resolved.relative_to(ROOT) if resolved.is_relative_to(ROOT) else resolved)


def synthesise(run: Run, children: Children) -> Outcome:
    """Runs it unless it has been, and goes on with it if it was interrupted. Raises Failed."""
    notes = run.folder.with_name(run.folder.name + ".took.json")
    sessions = _sessions(notes, run)
    done = bool(sessions) and sessions[-1]["code"] in DONE
    manifest = finished_manifest(run.folder) if done else None
    if manifest is None:
        code, took = children.run([sys.executable, "-m", *run.command], run.log)
        said = run.log.read_text("utf-8", errors="replace")
        if not any(f"error[{refusal}]" in said for refusal in REFUSED):
            core, wall = round(took.core, 2), round(took.wall, 2)
            sessions.append({"core": core, "wall": wall, "code": code})
            write_text(notes, json.dumps({"asked": run.asked, "sessions": sessions}) + "\n")
        if children.interrupted:
            raise KeyboardInterrupt
        if code != 0 and any(f"error[{refusal}]" in said for refusal in NOTHING_THERE):
            why = said[said.index("error[") :].splitlines()[0]
            return Outcome(None, _sum(sessions), len(sessions) > 1, NONE, why)
        manifest = finished_manifest(run.folder) if code in DONE else None
        if manifest is None:
            raise Failed(_told(run.command, code, run.log))
    made_by = manifest["versions"]["pirlc"]
    if made_by != pirlc.__version__:
        raise Failed(
            f"{short(run.folder)} was made by pirlc {made_by}; this is pirlc "
            f"{pirlc.__version__}. Remove that folder, or choose another with --folder"
        )
    resumed, took = len(sessions) > 1, _sum(sessions)
    if manifest["state"] == Ending.TIMEOUT.value:
        return Outcome(None, took, resumed, TIMEOUT)
    return Outcome(manifest, took, resumed)


def finished_manifest(folder: Path) -> dict[str, Any] | None:
    """What is known of a run; None if it is not finished."""
    try:
        manifest: dict[str, Any] = json.loads((folder / "manifest.json").read_text("utf-8"))
    except (FileNotFoundError, NotADirectoryError, ValueError):
        return None
    return manifest if manifest.get("state") in FINISHED else None


def _sessions(notes: Path, run: Run) -> list[dict[str, float]]:
    """What the run has taken so far; nothing if the notes are of another run, or damaged."""
    try:
        told = json.loads(notes.read_text("utf-8"))
        if told["asked"] != run.asked:
            return []
        names = ("core", "wall", "code")
        return [{name: float(session[name]) for name in names} for session in told["sessions"]]
    except (OSError, ValueError, KeyError, TypeError):
        return []


def _sum(sessions: list[dict[str, float]]) -> Took | None:
    if not sessions:
        return None
    return sum((Took(s["core"], s["wall"]) for s in sessions), Took(0.0, 0.0))


def answer(words: tuple[str, ...], to: Path, children: Children) -> tuple[dict[str, Any], Took]:
    """The JSON that a command of pirlc answers, which is kept in a file. Raises Failed."""
    log = to.with_suffix(".log")
    code, took = children.run([sys.executable, "-m", *words], log, to)
    if children.interrupted:
        raise KeyboardInterrupt
    if code == 0:
        try:
            found: dict[str, Any] = json.loads(to.read_text("utf-8"))
        except ValueError:
            pass
        else:
            return found, took
    raise Failed(_told(words, code, log))


def _told(command: tuple[str, ...], code: int, log: Path) -> str:
    """What a command that failed had to say."""
    how = f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended with {code}"
    lines = log.read_text("utf-8", errors="replace").rstrip().splitlines()
    shown = lines if len(lines) <= TOLD else ["...", *lines[-TOLD:]]
    said = "\n".join(f"  {line}" for line in shown) or "  (it said nothing)"
    return f"{' '.join(command)}\n{how}:\n{said}\n(in full: {short(log)})"
