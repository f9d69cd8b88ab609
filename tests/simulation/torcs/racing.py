"""Shared by the tests of TORCS races."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirlc.cli.files import program_in
from pirlc.frontend import parse_sketch
from pirlc.ir.policy import Environment, Program
from pirlc.simulation.environments import make
from pirlc.simulation.torcs.environment import Torcs
from pirlc.source import SourceText

CAREFUL = """policy careful
environment "pirlc/Torcs-v0"
sensor angle : [-1, 1] = 1
sensor trackPos : [-1, 1] = 2
sensor speed : [-1, 1] = 0
sensor ahead : [-1, 1] = 19
window 2
action steer : [-1, 1] = 8 * peek(angle, -1) - 0.4 * peek(trackPos, -1)
action accel : [0, 1] = 0.2 + 5 * (0.14 + 0.15 * peek(ahead, -1) - peek(speed, -1))
"""
"""Gets round the tracks without brakes, slowly where the road bends."""


def program(text: str = CAREFUL) -> Program:
    source = SourceText("program.pirl", text)
    return program_in(source, parse_sketch(source))


def torcs(**arguments: Any) -> Torcs:
    made = make(Environment("pirlc/Torcs-v0", tuple(arguments.items()))).unwrapped
    assert isinstance(made, Torcs)
    return made


def drive(env: Torcs, seed: int, steps: int) -> NDArray[np.float64]:
    """What a simple driver saw, shape (at most steps + 1, 29 + 2): readings, reward, distance."""
    readings, info = env.reset(seed=seed)
    rows = [[*readings, 0.0, info["distance"]]]
    for _ in range(steps):
        angle, place = np.nan_to_num(readings[1:3])
        action = np.clip([4 * angle - 0.3 * place, 0.5], -1, 1)
        readings, reward, terminated, truncated, info = env.step(action)
        rows.append([*readings, reward, info["distance"]])
        if terminated or truncated:
            break
    return np.array(rows)


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2][0] != "Z"
    except OSError:
        return False


def folders() -> set[str]:
    """Temporary folders of simulators."""
    import tempfile

    return {entry.name for entry in Path(tempfile.gettempdir()).glob("pirlc-torcs-*")}
