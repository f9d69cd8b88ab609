"""The programs whose C is checked: every closed program of examples/, and random ones."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pirlc.backend.c import CPrinter
from pirlc.backend.emit import emit, write
from pirlc.backend.names import file_stem
from pirlc.backend.numbers import RealType
from pirlc.frontend import parse_sketch
from pirlc.ir.controller import Controller, Operation, expressions
from pirlc.ir.expansion import close
from pirlc.ir.operators import Operator
from pirlc.ir.policy import Program
from pirlc.lower import lower
from pirlc.source import SourceText
from tests.support.programs import Kinds, random_program, renamed

REPOSITORY = Path(__file__).parents[2]
EXAMPLES = REPOSITORY / "examples"
REALS: tuple[RealType, ...] = ("double", "float")
LIBM_EVERY = 4
"""One random program in so many may use `exp` and `tanh`."""


@dataclass(frozen=True)
class Subject:
    """A program's C in one precision, in a folder of its own."""

    label: str
    program: Program
    controller: Controller
    real: RealType
    folder: Path
    is_example: bool
    seed: int

    @property
    def stem(self) -> str:
        return file_stem(self.controller.name)

    @property
    def source(self) -> Path:
        return self.folder / f"{self.stem}.c"

    @property
    def name(self) -> str:
        return f"{self.label} ({self.real})"

    @property
    def printer(self) -> CPrinter:
        return CPrinter(self.controller, self.real)

    @property
    def uses_libm(self) -> bool:
        """Whether it computes what differs between implementations of the C library."""
        return any(
            isinstance(part, Operation) and part.operator in (Operator.EXP, Operator.TANH)
            for part in expressions(self.controller.statements)
        )


def example_programs() -> Iterator[tuple[str, Program]]:
    """Every program under examples/ in which nothing is left open, by its path without suffix."""
    for path in sorted(EXAMPLES.rglob("*.pirl")):
        source = SourceText(path.name, path.read_text(encoding="utf-8"))
        program = close(parse_sketch(source))
        if program is not None:
            yield path.relative_to(EXAMPLES).with_suffix("").as_posix(), program


def random_programs(count: int) -> Iterator[tuple[str, Program]]:
    for seed in range(count):
        kinds = Kinds(libm=seed % LIBM_EVERY == 0)
        name = f"random{seed:03}"
        yield name, renamed(random_program(random.Random(seed), kinds), name)


def emitted(
    programs: Iterator[tuple[str, Program]], folder: Path, is_example: bool
) -> list[Subject]:
    """Emits each program in both precisions, each under a folder of its own."""
    subjects = []
    for seed, (label, program) in enumerate(programs):
        for real in REALS:
            place = folder / real / label
            write(emit(program, ["c"], real), place)
            controller = lower(program)
            subjects.append(Subject(label, program, controller, real, place, is_example, seed))
    return subjects
