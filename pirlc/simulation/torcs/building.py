"""Builds robots for TORCS from C++."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pirlc.simulation.torcs.installation import BUILD_FLAGS, include_flags
from pirlc.simulation.torcs.installation_problems import HostNotBuilt, failure

_CANDIDATES = ("g++", "clang++", "c++")
_LINES_SHOWN = 12


@dataclass(frozen=True)
class Compiler:
    """The command that starts it, and the first line of what it says about itself."""

    command: tuple[str, ...]
    version: str


def find_compiler() -> Compiler | None:
    """The C++ compiler that CXX names; else g++, clang++ or c++. None where there is none."""
    named = os.environ.get("CXX", "").strip()
    commands = [tuple(shlex.split(named))] if named else [(name,) for name in _CANDIDATES]
    for command in commands:
        if shutil.which(command[0]) is not None:
            version = _version(command)
            if version is not None:
                return Compiler(command, version)
    return None


def compiler_notes() -> tuple[str, ...]:
    """What explains that no compiler was found."""
    named = os.environ.get("CXX", "").strip()
    return (f"CXX names `{named}`, which cannot be run",) if named else ()


def _version(command: tuple[str, ...]) -> str | None:
    try:
        answer = subprocess.run(
            [*command, "--version"], capture_output=True, text=True, check=False, timeout=60
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return answer.stdout.partition("\n")[0] if answer.returncode == 0 else None


def build_robot(
    compiler: Compiler, sources: Sequence[Path], headers: Path, module: Path, *flags: str
) -> None:
    """Builds a robot's module from C and C++ sources against TORCS's headers.

    Raises PirlcError E0523 with what the compiler says.
    """
    command = [*compiler.command, *BUILD_FLAGS, *flags, *include_flags(headers)]
    command += ["-o", str(module), *map(str, sources)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, errors="replace")
    if done.returncode != 0:
        said = tuple(line for line in done.stderr.splitlines() if line.strip())
        raise failure(HostNotBuilt(shlex.join(compiler.command), said[:_LINES_SHOWN]))
