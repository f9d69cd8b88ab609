"""Programs for the tests of emitted code, and ways to run them."""

from __future__ import annotations

import os
import shutil
import struct
from functools import lru_cache
from pathlib import Path

from pirlc.backend.numbers import PRECISIONS
from pirlc.backend.policies import python_policy
from pirlc.backend.toolchain import FLAGS, WARNINGS, Compiler, compile_controller
from pirlc.frontend import parse_sketch
from pirlc.ir.expansion import close
from pirlc.ir.policy import Program
from pirlc.lower import lower
from pirlc.semantics.interpreter import initial_state, step
from pirlc.source import SourceText

FOLDER = Path(__file__).parent / "programs"
NAMES = tuple(sorted(path.stem for path in FOLDER.glob("*.pirl")))
COMPILERS = tuple(name for name in ("gcc", "clang") if shutil.which(name))


def program_of(text: str) -> Program:
    program = close(parse_sketch(SourceText("test.pirl", text)))
    assert program is not None
    return program


@lru_cache
def load_program(name: str) -> Program:
    return program_of((FOLDER / f"{name}.pirl").read_text(encoding="utf-8"))


def compiled(program: Program, folder: Path, real="double", compiler=None, level="-O2"):
    """The emitted C, compiled with every warning an error, as an object with reset and step."""
    command = (compiler or COMPILERS[0],)
    flags = (*FLAGS, level, *WARNINGS)
    return compile_controller(lower(program), folder, real, Compiler(command, "test"), flags)


class Run:
    """One form of a program: `step` gives the actions by component, the status, sensors' flags."""

    def __init__(self, program: Program, form: str, real: str, folder: Path, **options) -> None:
        self.program, self.form, self.precision = program, form, PRECISIONS[real]
        actions = program.interface.actions
        self.order = sorted(range(len(actions)), key=lambda i: actions[i].component)
        if form == "c":
            self.c = compiled(program, folder, real, **options)
        elif form == "python":
            self.python = python_policy(program, real)
        self.reset()

    def reset(self) -> None:
        match self.form:
            case "c":
                self.c.reset()
            case "python":
                self.python.reset()
            case "interpreter":
                self.state = initial_state(self.program, self.precision)

    def step(self, observation) -> tuple[tuple[float, ...], int, tuple[int, ...]]:
        match self.form:
            case "c":
                actions, status = self.c.step(observation)
                return actions, status, tuple(self.c.sensor_status().values())
            case "python":
                actions = self.python.act(observation)
                flags = self.python.controller.sensor_status().values()
                return actions, self.python.status, tuple(flags)
            case _:
                result = step(self.program, self.state, observation, self.precision)
                self.state = result.state
                actions = tuple(result.actions[i] for i in self.order)
                return actions, result.status, result.flags


def bits(values) -> list[bytes]:
    """The bytes of numbers; equal for any two NaNs. An int is told from a float."""
    return [
        b"nan" if v != v else (b"i" if isinstance(v, int) else b"f") + struct.pack("<d", v)
        for v in values
    ]


FORMS = ("interpreter", "python", *(("c",) if COMPILERS else ()))

UPDATE = bool(os.environ.get("PIRLC_UPDATE"))
