"""Programs to the files of the targets that are asked for."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from pirlc.backend.c import c_files
from pirlc.backend.files import GeneratedFile, Provenance, write
from pirlc.backend.names import check_names
from pirlc.backend.numbers import RealType
from pirlc.backend.problems import UnknownTarget, error
from pirlc.backend.python import python_files
from pirlc.backend.torcs import torcs_files
from pirlc.ir.controller import Controller
from pirlc.ir.policy import Program
from pirlc.ir.printer import program_text
from pirlc.lower import lower

__all__ = ["TARGETS", "GeneratedFile", "emit", "write"]


class Target(Protocol):
    def __call__(
        self, controller: Controller, real: RealType, provenance: Provenance, /
    ) -> tuple[GeneratedFile, ...]: ...


TARGETS: dict[str, Target] = {"c": c_files, "python": python_files, "torcs": torcs_files}


def emit(
    program: Program, targets: Sequence[str] = ("c", "python"), real: RealType = "double"
) -> tuple[GeneratedFile, ...]:
    """The files of each target, byte for byte the same for the same program.

    `real` is the type to compute in: binary64 or binary32. Raises `PirlcError` for a target that
    there is not, and for names that no target can write.
    """
    for target in targets:
        if target not in TARGETS:
            raise error(UnknownTarget(target, tuple(TARGETS)))
    check_names(program.interface, program.values)
    controller = lower(program)
    provenance = Provenance(program_text(program))
    files = [
        file
        for target in dict.fromkeys(targets)
        for file in TARGETS[target](controller, real, provenance)
    ]
    # Two targets may write the same file: c's are part of torcs's.
    return tuple(dict.fromkeys(files))


def emit_to(
    program: Program, folder: Path, targets: Sequence[str], real: RealType = "double"
) -> tuple[Path, ...]:
    """Writes the files of `emit` under the folder and returns their paths."""
    return write(emit(program, targets, real), folder)
