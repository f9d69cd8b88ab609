"""A TORCS process with the host robot on the grid of a track."""

from __future__ import annotations

import contextlib
import os
import select
import shutil
import signal
import socket
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pirlc.simulation.torcs.configuration import race_files
from pirlc.simulation.torcs.installation import Installation
from pirlc.simulation.torcs.protocol import (
    COMMAND,
    FRAME,
    FRAME_BYTES,
    TRACE_HEADER,
    Conditions,
    Kind,
    Status,
    Trace,
    request,
)

PATIENCE = 20.0
"""Seconds without an answer after which TORCS counts as hanging: it answers in less than one."""

_ENDLESS = 10_000
"""Laps of a race that has no number of laps of its own."""


class TorcsDied(Exception):
    """The simulator's process ended by itself, or was killed. The text says what is known."""


class TorcsHangs(Exception):
    """The simulator did not answer in time, and was killed."""


@dataclass(frozen=True)
class Robot:
    """A robot of TORCS's own: its module and the number of its first driver."""

    name: str
    index: int


@dataclass(frozen=True)
class Course:
    """What a TORCS process is started for; `laps` 0: no end. `robot` None: whoever asks drives."""

    track: str
    category: str = "road"
    car: str = "car1-trb1"
    laps: int = 0
    robot: Robot | None = None


class TorcsProcess:
    """TORCS waiting on the grid; every race is a fork of it, so all start from the same state."""

    def __init__(self, installation: Installation, course: Course) -> None:
        self.installation = installation
        self.course = course
        self._folder = Path(tempfile.mkdtemp(prefix="pirlc-torcs-"))
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
        ours.settimeout(PATIENCE)
        self._socket = ours
        race = race_files(course.track, course.category, course.car, course.laps or _ENDLESS,
                          course.robot.index if course.robot else 1, self._folder, installation)
        environment = {
            **os.environ,
            "LD_LIBRARY_PATH": str(installation.shared),
            "PIRLC_TORCS_CHANNEL": str(theirs.fileno()),
        }
        if course.robot is not None:
            module = installation.tree / "drivers" / course.robot.name / f"{course.robot.name}.so"
            environment["PIRLC_TORCS_ROBOT"] = str(module)
            environment["PIRLC_TORCS_ROBOT_NAME"] = course.robot.name
            environment["PIRLC_TORCS_ROBOT_INDEX"] = str(course.robot.index)
        command = [installation.binary, "-l", self._folder, "-L", installation.tree]
        command += ["-D", installation.data, "-r", race]
        try:
            with (self._folder / "log").open("wb") as log:
                self._process = subprocess.Popen(
                    command,
                    cwd=installation.data,
                    env=environment,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    pass_fds=(theirs.fileno(),),
                    start_new_session=True,
                )
        except BaseException:
            ours.close()
            shutil.rmtree(self._folder, ignore_errors=True)
            raise
        finally:
            theirs.close()
        self._racing = False

    def begin(self, conditions: Conditions, beams: bool = True) -> NDArray[np.float64]:
        """Start a race in lock-step; the first frame. A race under way is given up."""
        self.leave()
        self._send(request(Kind.LOCK_STEP, conditions, self.course.laps, beams=beams))
        self._racing = True
        return self._frame()

    def step(self, steer: float, accel: float, brake: float) -> NDArray[np.float64]:
        """Apply a command for one control interval; the frame after it."""
        self._send(COMMAND.pack(steer, accel, brake, 0))
        return self._frame()

    def leave(self) -> None:
        """Give up the race under way, if there is one."""
        if self._racing:
            self._send(COMMAND.pack(0.0, 0.0, 0.0, 1))
            self._racing = False

    def race(
        self,
        conditions: Conditions,
        library: Path,
        params: tuple[float, ...] | None,
        components: int,
        beams: bool = True,
    ) -> Trace:
        """A whole race of a compiled controller."""
        self.leave()
        asked = request(
            Kind.NATIVE, conditions, self.course.laps, str(library), params, components, beams
        )
        self._send(asked)
        return self._trace()

    def race_robot(self, conditions: Conditions) -> Trace:
        """A whole race of the course's robot."""
        self.leave()
        self._send(request(Kind.ROBOT, conditions, self.course.laps))
        return self._trace()

    def track(self) -> tuple[NDArray[np.float64], float]:
        """The road: its edges, shape (n, 4), x and y (m) of the left and of the right one; and its
        length in m."""
        self.leave()
        self._send(request(Kind.TRACK, Conditions(), 0))
        (n,) = TRACE_HEADER.unpack(self._receive(TRACE_HEADER.size))
        edges = np.frombuffer(self._receive(n * 32)).reshape(n, 4)
        return edges, float(np.frombuffer(self._receive(8))[0])

    def close(self) -> None:
        """End the process and whatever it raced; again: nothing."""
        self._socket.close()
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _trace(self) -> Trace:
        (count,) = TRACE_HEADER.unpack(self._receive(TRACE_HEADER.size))
        frames = np.frombuffer(self._receive(count * FRAME_BYTES)).reshape(count, len(FRAME))
        self._check(frames[-1])
        return Trace(frames)

    def _frame(self) -> NDArray[np.float64]:
        frame = np.frombuffer(self._receive(FRAME_BYTES))
        if frame[0] != Status.RUNNING:
            self._racing = False
            self._check(frame)
        return frame

    def _check(self, last: NDArray[np.float64]) -> None:
        if last[0] == Status.DIED:
            status = int(last[2])
            raise TorcsDied(_words(status))

    def _send(self, what: bytes) -> None:
        try:
            self._socket.sendall(what)
        except TimeoutError:
            raise self._hangs() from None
        except OSError:
            raise self._died() from None

    def _receive(self, size: int) -> bytes:
        parts = bytearray()
        try:
            while len(parts) < size:
                part = self._socket.recv(size - len(parts))
                if not part:
                    raise self._died()
                parts += part
        except TimeoutError:
            raise self._hangs() from None
        except OSError:
            raise self._died() from None
        return bytes(parts)

    def _hangs(self) -> TorcsHangs:
        self.close()
        return TorcsHangs(f"no answer within {PATIENCE:g} s")

    def _died(self) -> TorcsDied:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=1.0)
        status = self._process.returncode
        last = self._last_words()
        self.close()
        said = f"exit status {status}" if status is None or status >= 0 else f"signal {-status}"
        return TorcsDied(said + (f"; it said: {last}" if last else ""))

    def _last_words(self) -> str:
        try:
            lines = (self._folder / "log").read_text(errors="replace").split("\n")
        except OSError:
            return ""
        told = [line.strip() for line in lines if line.strip()]
        return told[-1] if told else ""


def _words(status: int) -> str:
    if status < 0:
        return "the race could not be started"
    if os.WIFSIGNALED(status):
        return f"signal {os.WTERMSIG(status)}"
    return f"exit status {os.waitstatus_to_exitcode(status)}"
