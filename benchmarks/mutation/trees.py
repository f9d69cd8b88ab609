"""Private copies of the tree, and what the tests say of one."""

from __future__ import annotations

import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

MEMORY = 10 << 30
"""Bytes of address space that a run of the tests may take; torch alone maps several."""

_IGNORED = shutil.ignore_patterns(
    "__pycache__", ".git", ".venv", "runs", "build", "dist", "*.egg-info", ".*_cache", ".hypothesis"
)
_FOLDERS = re.compile(r"(?<![\w.])/[^\s'\"]+/")
_FAILED = re.compile(r"^(?:FAILED|ERROR) (.+?)(?: - (.*))?$", re.MULTILINE)


@dataclass(frozen=True)
class Verdict:
    """What a run of the tests came to: the first that failed, or none, and why it failed.

    Paths are without their folders, which differ from run to run.
    """

    failed: str | None
    why: str
    seconds: float


_ALONE = """\
import sys

sys.meta_path[:] = [f for f in sys.meta_path if "__editable__" not in getattr(f, "__module__", "")]
"""
"""Run at the start of every Python in a copy: an editable install would lend it the modules of the
tree that it was made from."""


class Tree:
    """A copy of a source tree in which one file at a time is replaced."""

    def __init__(self, source: Path, folder: Path) -> None:
        self.folder = folder
        shutil.copytree(source, folder, ignore=_IGNORED)
        (folder / "sitecustomize.py").write_text(_ALONE, encoding="utf-8")
        # Pythons go by a file's time and size, which two mutants may share; by its hash they do
        # not take one for the other.
        command = [sys.executable, "-m", "compileall", "-q", "--invalidation-mode", "checked-hash"]
        subprocess.run([*command, "."], cwd=folder, check=False, capture_output=True)

    @contextmanager
    def holding(self, path: PurePosixPath, text: str) -> Iterator[None]:
        """The tree with one file's text replaced, and as it was afterwards."""
        place = self.folder / path
        before = place.read_bytes()
        place.write_text(text, encoding="utf-8")
        try:
            yield
        finally:
            place.write_bytes(before)

    def environment(self) -> dict[str, str]:
        """Everything started in it uses the copy's package, not an installed one."""
        return {
            **os.environ,
            "PYTHONPATH": str(self.folder),
            "HYPOTHESIS_STORAGE_DIRECTORY": str(self.folder / ".hypothesis"),
        }

    def test(self, tests: Sequence[str], seconds: float) -> Verdict:
        """Runs the tests up to the first that fails, or until the time is up.

        `tests` are arguments for pytest: paths in the order in which they are run.
        """
        # What an earlier run's failures left would be tried first in this one.
        shutil.rmtree(self.folder / ".hypothesis", ignore_errors=True)
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider"]
        command += ["--tb=line", "--hypothesis-seed=0", *tests]
        start = time.monotonic()
        process = subprocess.Popen(
            command,
            cwd=self.folder,
            env={**self.environment(), "COLUMNS": "400"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
            preexec_fn=_limit_memory,
        )
        try:
            output, _ = process.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            return Verdict("the time limit", f"more than {seconds:.0f} s", time.monotonic() - start)
        took = time.monotonic() - start
        if process.returncode == 0:
            return Verdict(None, "", took)
        match = _FAILED.search(output)
        if match:
            return Verdict(match[1], _FOLDERS.sub("", match[2] or "")[:200], took)
        last = (output.strip().splitlines() or ["no output"])[-1]
        return Verdict(f"exit code {process.returncode}", _FOLDERS.sub("", last)[:200], took)


def _limit_memory() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))


class Emitter:
    """Asks a tree, as it is at that moment, to emit many programs; see `emitting`."""

    def __init__(self, tree: Tree) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.mutation.emitting"],
            cwd=tree.folder,
            env=tree.environment(),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        ready = self._read()
        assert ready == "ready", ready

    def _read(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().rstrip("\n")

    def answer(self) -> str:
        """ "ok" and a hash of what was emitted, or "refused" and why."""
        assert self._process.stdin is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        return self._read()

    def close(self) -> None:
        self._process.communicate()
