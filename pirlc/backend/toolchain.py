"""Finds a C compiler, builds emitted C into a shared library, and runs it in this process.

Libraries are kept in a folder by the hash of everything that made them, so that a controller is
compiled once however many workers and runs use it.
"""

from __future__ import annotations

import ctypes
import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

from pirlc.backend.c import CPrinter, c_files
from pirlc.backend.files import GeneratedFile, Provenance, write_text
from pirlc.backend.names import file_stem
from pirlc.backend.numbers import RealType
from pirlc.backend.problems import (
    CompilationFailed,
    CompilerNotFound,
    NoCompiler,
    NotLoadable,
    NotWritable,
    UnknownParameter,
    error,
)
from pirlc.backend.rendering import render
from pirlc.ir.controller import Controller, Kind

if TYPE_CHECKING:
    from pirlc.ir.observation import Observation

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")
"""How pirlc itself builds emitted C; the header tells users the same."""

QUICK_FLAGS = ("-std=c99", "-O1", "-ffp-contract=off")
"""The same for libraries that are used for a few episodes: built sooner, and no other results."""

WARNINGS = (
    "-pedantic",
    "-Wall",
    "-Wextra",
    "-Wconversion",
    "-Wdouble-promotion",
    "-Wshadow",
    "-Werror",
)
"""Emitted C compiles under these without a word."""

_CANDIDATES = ("cc", "gcc", "clang")
_LINES_SHOWN = 12
_SUFFIX = ".dll" if sys.platform == "win32" else ".so"


@dataclass(frozen=True)
class Compiler:
    """The command that starts it, and what it says about itself."""

    command: tuple[str, ...]
    version: str


def find_compiler() -> Compiler:
    """The compiler that CC names; else cc, gcc or clang; else the ziglang wheel's."""
    named = os.environ.get("CC", "").strip()
    return _find(named, os.environ.get("PATH", ""))


@lru_cache(maxsize=16)
def _find(named: str, _path: str) -> Compiler:
    if named:
        command = tuple(shlex.split(named))
        version = _version(command)
        if version is None:
            raise error(CompilerNotFound(named))
        return Compiler(command, version)
    for candidate in _CANDIDATES:
        found = shutil.which(candidate)
        version = _version((found,)) if found else None
        if found and version is not None:
            return Compiler((found,), version)
    if importlib.util.find_spec("ziglang") is not None:
        command = (sys.executable, "-m", "ziglang", "cc")
        version = _version(command)
        if version is not None:
            return Compiler(command, version)
    raise error(NoCompiler((*_CANDIDATES, "the ziglang wheel")))


def _version(command: tuple[str, ...]) -> str | None:
    try:
        answer = subprocess.run(
            [*command, "--version"], capture_output=True, text=True, check=False, timeout=60
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return answer.stdout if answer.returncode == 0 else None


def compile_controller(
    controller: Controller,
    folder: Path,
    real: RealType = "double",
    compiler: Compiler | None = None,
    flags: Sequence[str] = FLAGS,
) -> CController:
    """Builds the controller's C as a library under `folder` and loads it.

    Raises `PirlcError` where there is no compiler, where it refuses the code, and where the folder
    cannot be written.
    """
    library = build(controller, folder, real, compiler or find_compiler(), flags)
    return CController(load(library), controller, real)


def build(
    controller: Controller,
    folder: Path,
    real: RealType,
    compiler: Compiler,
    flags: Sequence[str] = FLAGS,
) -> Path:
    """The path of the library, compiled if it is not there yet."""
    files = c_files(controller, real, Provenance(controller.name))
    return build_files(controller, files, folder, compiler, flags)


def build_files(
    controller: Controller,
    files: Sequence[GeneratedFile],
    folder: Path,
    compiler: Compiler,
    flags: Sequence[str] = FLAGS,
) -> Path:
    """The same of given files: the controller's header and source, named as `c_files` does."""
    stem = file_stem(controller.name)
    bridge = bridge_text(controller, stem)
    made_of = [*(file.text for file in files), bridge, *compiler.command, compiler.version, *flags]
    digest = sha256("\0".join(made_of).encode()).hexdigest()[:32]
    library = folder / digest / f"{stem}{_SUFFIX}"
    if library.is_file():
        return library
    for file in files:
        write_text(library.parent / file.path, file.text)
    source = write_text(library.parent / "bridge.c", bridge)
    with tempfile.TemporaryDirectory(prefix=".build-", dir=library.parent) as place:
        made = Path(place) / library.name
        position = () if sys.platform == "win32" else ("-fPIC",)
        command = [*compiler.command, *flags, *position, "-shared", "-o", str(made)]
        command += [str(source), "-lm"]
        try:
            answer = subprocess.run(
                command, capture_output=True, text=True, errors="replace", check=False
            )
        except OSError:
            raise error(CompilerNotFound(" ".join(compiler.command))) from None
        if answer.returncode != 0:
            raise error(_refused(compiler, answer.stderr or answer.stdout, library.parent))
        try:
            made.replace(library)
        except OSError as e:
            raise error(NotWritable(str(library), (e.strerror or str(e)).lower())) from None
    return library


def _refused(compiler: Compiler, words: str, folder: Path) -> CompilationFailed | NotWritable:
    if "No space left on device" in words:
        return NotWritable(str(folder), "no space left on device")
    lines = tuple(words.replace(f"{folder}{os.sep}", "").splitlines()[:_LINES_SHOWN])
    return CompilationFailed(" ".join(compiler.command), lines)


def bridge_text(controller: Controller, stem: str) -> str:
    """C that ctypes calls: it picks readings out of an observation vector."""
    ordered = sorted(controller.outputs, key=lambda o: o.component)
    printer = CPrinter(controller, "double")
    return render(
        "c",
        "bridge.c.j2",
        {
            "name": stem,
            "inputs": [(printer.inputs[c.name], c.index) for c in controller.channels],
            "outputs": [printer.actions[o.name] for o in ordered],
            "params": [printer.parameters[name] for name, _ in controller.parameters],
            "flags": [printer.flags[c.name] for c in controller.channels],
            "width": controller.observation_size,
        },
    )


def load(library: Path) -> ctypes.CDLL:
    try:
        return ctypes.CDLL(str(library))
    except OSError as e:
        raise error(NotLoadable(str(e).replace(f"{library.parent}{os.sep}", ""))) from None


class CController:
    """An instance of a compiled controller; instances share the library and nothing else.

    Observations are whole observation vectors, as binary64; actions come in the order of the
    environment's components.
    """

    def __init__(self, library: ctypes.CDLL, controller: Controller, real: RealType) -> None:
        self.controller = controller
        self.real = real
        self.library = library
        library.bridge_state_size.restype = ctypes.c_ulong
        library.bridge_step.restype = ctypes.c_uint
        self.state_size = int(library.bridge_state_size())
        # In units of 16 bytes: aligned for whatever the state holds.
        self._state = (ctypes.c_longdouble * (self.state_size // 16 + 1))()
        self._names = tuple(name for name, _ in controller.parameters)
        self._params = (ctypes.c_double * max(1, len(self._names)))()
        library.bridge_default_params(self._params)
        self._width = controller.observation_size
        self._kinds = tuple(o.kind for o in sorted(controller.outputs, key=lambda o: o.component))
        self._observation = (ctypes.c_double * max(1, self._width))()
        self._actions = (ctypes.c_double * max(1, len(self._kinds)))()
        self.status = 0
        self.reset()

    def with_params(self, values: Mapping[str, float]) -> CController:
        """Another instance, with other values for some parameters."""
        other = CController(self.library, self.controller, self.real)
        for name, value in values.items():
            if name not in self._names:
                raise error(UnknownParameter(name, self._names))
            other._params[self._names.index(name)] = value
        return other

    @property
    def params(self) -> dict[str, float]:
        return dict(zip(self._names, self._params, strict=False))

    def reset(self) -> None:
        """The state of a controller that has seen nothing."""
        self.library.bridge_reset(self._state)
        self.status = 0

    def step(self, observation: Observation) -> tuple[tuple[float, ...], int]:
        """The applied actions, discrete ones as ints, and the status bits."""
        self._observation[: self._width] = list(map(float, observation[: self._width]))
        self.status = self.library.bridge_step(
            self._params, self._state, self._observation, self._actions
        )
        actions = tuple(
            value if kind is Kind.REAL else int(value)
            for value, kind in zip(self._actions, self._kinds, strict=True)
        )
        return actions, self.status

    def sensor_status(self) -> dict[str, int]:
        """The status bits of each sensor at the last step."""
        flags = (ctypes.c_ubyte * max(1, len(self.controller.channels)))()
        self.library.bridge_flags(self._state, flags)
        return {c.name: flags[k] for k, c in enumerate(self.controller.channels)}
