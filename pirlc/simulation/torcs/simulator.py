"""A TORCS process with the host robot on the grid of a track."""

from __future__ import annotations

import contextlib
import ctypes
import math
import os
import select
import shutil
import signal
import socket
import struct
import subprocess
import tempfile
import weakref
from dataclasses import dataclass
from pathlib import Path
from typing import IO

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
"""Seconds without a word after which TORCS counts as hanging: it answers in less than one."""

_ENDLESS = 10_000
"""Laps of a race that has no number of laps of its own."""

_LONGEST = 1_000_000
"""Steps after which TORCS cuts off a race that nothing else ends."""

_RUNNING = float(Status.RUNNING)


class TorcsDied(Exception):
    """The simulator's process ended by itself, or was killed. The text says what is known."""


class TorcsHangs(Exception):
    """The simulator did not answer in time, and was killed."""


@dataclass(frozen=True)
class Robot:
    """A robot of TORCS's own: its module and the number of its first driver."""

    name: str
    index: int


ROBOTS = {
    robot.name: robot
    for robot in (Robot("berniw", 1), Robot("bt", 0), Robot("inferno", 1), Robot("olethros", 0))
}
"""The first driver of each kind that comes with TORCS."""


@dataclass(frozen=True)
class Course:
    """What a TORCS process is started for; `laps` 0: no end. `robot` None: whoever asks drives."""

    track: str
    category: str = "road"
    car: str = "car1-trb1"
    laps: int = 0
    robot: Robot | None = None


class TorcsProcess:
    """TORCS waiting on the grid; every race is a fork of it, so all start from the same state.

    Ends with `close`, with this object, with this process however that ends, and with everything
    raised in the middle of a conversation: after an error, make another. `patience`: seconds
    without an answer after which it counts as hanging. Methods raise `TorcsDied`, `TorcsHangs`.
    """

    def __init__(
        self, installation: Installation, course: Course, patience: float = PATIENCE
    ) -> None:
        self.installation = installation
        self.course = course
        self.patience = patience
        folder = Path(tempfile.mkdtemp(prefix="pirlc-torcs-"))
        try:
            self._log = tempfile.TemporaryFile()  # noqa: SIM115
            self._socket, self._process = _start(installation, course, folder, self._log)
            for direction in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):
                self._socket.setsockopt(socket.SOL_SOCKET, direction, _interval(patience))
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        self._folder: Path | None = folder
        # Also at exit, and when nobody has this object any more.
        self._owner = os.getpid()
        self._end = weakref.finalize(
            self, _end, self._owner, self._process, self._socket, self._log, folder
        )
        self._racing = False
        self._buffer = bytearray(FRAME_BYTES)
        self._bytes = memoryview(self._buffer)
        self._frame = np.frombuffer(self._buffer)
        self.values = self._bytes.cast("d")
        """The latest frame of a race in lock-step, as numbers."""
        self._everywhere: frozenset[int] = frozenset()

    @property
    def pid(self) -> int:
        """The number of the process on the grid, which is also that of its process group."""
        return self._process.pid

    def usable(self) -> bool:
        """Whether a race can be begun: it lives, has nothing to tell, and is this process's own."""
        if not self._end.alive or self._owner != os.getpid() or self._process.poll() is not None:
            return False
        waiting = select.poll()
        waiting.register(self._socket, select.POLLIN)
        return not waiting.poll(0)

    def begin(self, conditions: Conditions, beams: bool = True) -> NDArray[np.float64]:
        """Start a race in lock-step; the first frame. A race under way is given up.

        The frame is the same array at each step.
        """
        self.leave()
        self._send(request(Kind.LOCK_STEP, conditions, self.course.laps, beams=beams))
        allowed = os.sched_getaffinity(0)
        self._everywhere = frozenset(allowed) if len(allowed) > 1 else frozenset()
        self._receive_frame()
        self._settled()
        return self._frame

    def step(self, steer: float, accel: float, brake: float) -> NDArray[np.float64]:
        """Apply a command for one control interval; the frame after it."""
        if not self._racing:
            raise ValueError("no race is under way")
        if not self._everywhere:
            self._send(COMMAND.pack(steer, accel, brake, 0, 0))
            self._receive_frame()
            return self._frame
        # To wake another processor takes longer than the race's step: the race follows this thread,
        # which stays where it is until it has the answer.
        here = _processor()
        try:
            os.sched_setaffinity(0, (here,))
            self._send(COMMAND.pack(steer, accel, brake, 0, here + 1))
            self._receive_frame()
        finally:
            os.sched_setaffinity(0, self._everywhere)
        return self._frame

    def leave(self) -> None:
        """Give up the race under way, if there is one."""
        if self._racing:
            self._racing = False
            self._send(COMMAND.pack(0.0, 0.0, 0.0, 1, 0))

    def race(
        self,
        conditions: Conditions,
        library: Path | str,
        params: tuple[float, ...] | None,
        components: int,
        beams: bool = True,
    ) -> Trace:
        """A whole race of a compiled controller; `params` None: its own.

        Where nothing else ends it, it is cut off after a million steps. Raises ValueError for
        more parameters, or a longer path, than fit into a request.
        """
        return self._raced(
            request(
                Kind.NATIVE,
                _bounded(conditions),
                self.course.laps,
                str(library),
                params,
                components,
                beams,
            )
        )

    def race_robot(self, conditions: Conditions) -> Trace:
        """A whole race of the course's robot."""
        if self.course.robot is None:
            raise ValueError("the course has no robot")
        return self._raced(request(Kind.ROBOT, _bounded(conditions), self.course.laps))

    def track(self) -> tuple[NDArray[np.float64], float]:
        """The road: its edges, shape (n, 4), x and y (m) of the left and of the right one; and its
        length in m."""
        self.leave()
        self._send(request(Kind.TRACK, Conditions(), 0))
        (n,) = TRACE_HEADER.unpack(self._receive(TRACE_HEADER.size))
        edges = np.frombuffer(self._receive(n * 32)).reshape(n, 4)
        length = float(np.frombuffer(self._receive(8))[0])
        self._settled()
        return edges, length

    def close(self) -> None:
        """End the process and whatever it raced; again: nothing."""
        self._racing = False
        self._end()

    def _raced(self, asked: bytes) -> Trace:
        self.leave()
        self._send(asked)
        parts: list[NDArray[np.float64]] = []
        while not parts or parts[-1][-1, 0] == _RUNNING:
            (count,) = TRACE_HEADER.unpack(self._receive(TRACE_HEADER.size))
            parts.append(np.frombuffer(self._receive(count * FRAME_BYTES)).reshape(-1, len(FRAME)))
        self._settled()
        return Trace(parts[0] if len(parts) == 1 else np.concatenate(parts))

    def _receive_frame(self) -> None:
        self._receive_into(self._bytes)
        self._racing = self.values[0] == _RUNNING

    def _settled(self) -> None:
        """The first answer has come: TORCS has read its settings."""
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = None

    def _send(self, what: bytes) -> None:
        try:
            self._socket.sendall(what)
        except BlockingIOError:
            raise self._hangs() from None
        except OSError:
            raise self._died() from None
        except BaseException:
            self.close()
            raise

    def _receive(self, size: int) -> bytearray:
        place = bytearray(size)
        self._receive_into(memoryview(place))
        return place

    def _receive_into(self, place: memoryview) -> None:
        try:
            got = self._socket.recv_into(place)
            while 0 < got < len(place):
                place = place[got:]
                got = self._socket.recv_into(place)
        except BlockingIOError:
            raise self._hangs() from None
        except OSError:
            raise self._died() from None
        except BaseException:
            # Ctrl-C: what was asked is still to be answered, so nothing more can be said.
            self.close()
            raise
        if not got and len(place):
            raise self._died()

    def _hangs(self) -> TorcsHangs:
        self.close()
        return TorcsHangs(f"TORCS gave no answer within {self.patience:g} s")

    def _died(self) -> TorcsDied:
        if not self._end.alive:
            return TorcsDied("TORCS was closed")
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=1.0)
        status = self._process.returncode
        last = _last_words(self._log)
        self.close()
        known = "it closed its end" if status is None else _ending(status)
        return TorcsDied(f"TORCS ended by itself: {known}" + (f"; it said: {last}" if last else ""))


def _start(
    installation: Installation, course: Course, folder: Path, log: IO[bytes]
) -> tuple[socket.socket, subprocess.Popen[bytes]]:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
    ours.settimeout(None)  # whatever the default is: the kernel keeps the time
    robot = course.robot
    race = race_files(
        course.track,
        course.category,
        course.car,
        course.laps or _ENDLESS,
        robot.index if robot else 1,
        folder,
    )
    environment = {
        **os.environ,
        "LD_LIBRARY_PATH": str(installation.shared),
        "PIRLC_TORCS_CHANNEL": str(theirs.fileno()),
    }
    if robot is not None:
        module = installation.binary.parent / "drivers" / robot.name / f"{robot.name}.so"
        environment["PIRLC_TORCS_ROBOT"] = str(module)
        environment["PIRLC_TORCS_ROBOT_NAME"] = robot.name
        environment["PIRLC_TORCS_ROBOT_INDEX"] = str(robot.index)
    command: list[Path | str] = [installation.binary, "-l", folder, "-L", installation.tree]
    command += ["-D", installation.data, "-r", race]
    try:
        process = subprocess.Popen(
            command,
            cwd=installation.data,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            pass_fds=(theirs.fileno(),),
            start_new_session=True,  # the terminal's Ctrl-C is not for it
        )
    except BaseException:
        ours.close()
        raise
    finally:
        theirs.close()
    return ours, process


def _end(
    owner: int,
    process: subprocess.Popen[bytes],
    channel: socket.socket,
    log: IO[bytes],
    folder: Path,
) -> None:
    channel.close()
    log.close()
    if os.getpid() != owner:  # a fork of whoever started it
        return
    if process.poll() is None:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    shutil.rmtree(folder, ignore_errors=True)


def _interval(seconds: float) -> bytes:
    """A C struct timeval."""
    whole = math.floor(seconds)
    return struct.pack("ll", whole, round((seconds - whole) * 1e6))


_processor = ctypes.CDLL(None).sched_getcpu


def _bounded(conditions: Conditions) -> Conditions:
    return conditions.limited(min(conditions.most_steps or _LONGEST, _LONGEST))


def _last_words(log: IO[bytes]) -> str:
    log.seek(0)
    told = [line.strip() for line in log.read().decode(errors="replace").split("\n")]
    return next((line for line in reversed(told) if line), "")


def _ending(status: int) -> str:
    if status >= 0:
        return f"exit status {status}"
    return f"signal {-status} ({signal.strsignal(-status) or 'unknown'})"
