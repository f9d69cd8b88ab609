"""The tools that the checks run, and the Debian packages that have them."""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path


@dataclass(frozen=True)
class Tool:
    """A command; `parts` are files of its own that it needs, and that may be packaged apart."""

    command: str
    package: str
    parts: tuple[str, ...] = ()

    @property
    def installed(self) -> bool:
        if shutil.which(self.command) is None:
            return False
        return all(
            Path(run([self.command, f"-print-file-name={part}"]).stdout.strip()).is_file()
            for part in self.parts
        )


GCC = Tool("gcc", "gcc")
CLANG = Tool("clang", "clang")
CLANG_SANITIZERS = Tool(
    "clang", "clang libclang-rt-dev", (f"libclang_rt.msan-{platform.machine()}.a",)
)
CLANG_TIDY = Tool("clang-tidy", "clang-tidy")
CPPCHECK = Tool("cppcheck", "cppcheck")
ARM_GCC = Tool("arm-none-eabi-gcc", "gcc-arm-none-eabi libnewlib-arm-none-eabi")
QEMU_ARM = Tool("qemu-system-arm", "qemu-system-arm")
S390X_GCC = Tool("s390x-linux-gnu-gcc", "gcc-s390x-linux-gnu libc6-dev-s390x-cross")
QEMU_S390X = Tool("qemu-s390x", "qemu-user")
PPC64_GCC = Tool("powerpc64-linux-gnu-gcc", "gcc-powerpc64-linux-gnu libc6-dev-ppc64-cross")
QEMU_PPC64 = Tool("qemu-ppc64", "qemu-user")


class ToolFailed(Exception):
    """A tool ended as it should not have: its command and the end of what it said."""


def run(
    command: Sequence[str | Path], folder: Path | None = None, seconds: float = 600.0
) -> subprocess.CompletedProcess[str]:
    """Runs a command to its end, in English."""
    environment = {**os.environ, "LC_ALL": "C"}
    try:
        return subprocess.run(
            [str(part) for part in command],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
            timeout=seconds,
            stdin=subprocess.DEVNULL,
        )
    except subprocess.TimeoutExpired:
        raise ToolFailed(f"{_shown(command)}: no end after {seconds:g} s") from None


def succeed(command: Sequence[str | Path], folder: Path | None = None) -> str:
    """Runs a command that must not fail; its standard output."""
    answer = run(command, folder)
    if answer.returncode != 0:
        said = (answer.stderr + answer.stdout).strip()[-2000:]
        raise ToolFailed(f"{_shown(command)} ended with {answer.returncode}:\n{said}")
    return answer.stdout


def _shown(command: Sequence[str | Path]) -> str:
    return " ".join(Path(part).name if "/" in str(part) else str(part) for part in command)


@lru_cache
def version(tool: Tool) -> str:
    """The number in the first line of what the tool says about itself that has one."""
    for line in run([tool.command, "--version"]).stdout.splitlines():
        if found := re.search(r"\d+\.\d+(\.\d+)?", re.sub(r"\([^)]*\)", "", line)):
            return found[0]
    return "?"
