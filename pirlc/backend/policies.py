"""Programs as policies that run emitted code, for simulations.

The Python one is the quick one to make: a structure is printed and compiled once, and any number
of parameter values run on it. Factories are picklable, so that worker processes make their own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from pirlc.backend.files import Provenance
from pirlc.backend.numbers import RealType
from pirlc.backend.problems import UnknownParameter, error
from pirlc.backend.python import gives_int, python_text
from pirlc.backend.toolchain import FLAGS, CController, Compiler, build, find_compiler, load
from pirlc.ir.controller import Controller
from pirlc.ir.policy import FreeParameter, Program, ProgramTemplate
from pirlc.lower import lower
from pirlc.simulation.policy import Compiled

if TYPE_CHECKING:
    from pirlc.ir.observation import Observation


class PythonPolicy:
    """An instance of an emitted Python controller, with the protocol of simulations."""

    def __init__(self, controller: Any, single: bool) -> None:
        self.controller = controller
        self.reset: Callable[[], None] = controller.reset
        step = controller.step
        self.act: Callable[[Observation], tuple[float, ...]] = (
            (lambda observation: (step(observation),)) if single else step
        )

    @property
    def status(self) -> int:
        """The status bits of the last step."""
        return int(self.controller.status)


@dataclass(frozen=True)
class PythonController:
    """The printed structure of a program: makes policies with any parameter values.

    Picklable; each process compiles the text once, at its first policy.
    """

    text: str
    names: tuple[str, ...]
    single: bool

    def with_params(self, values: Mapping[str, float]) -> PythonPolicy:
        """A policy with `values` for some of the parameters; the rest keep the program's."""
        return PythonPolicy(_compiled(self.text)["Controller"](values), self.single)

    def __call__(self) -> PythonPolicy:
        return self.with_params({})


@lru_cache(maxsize=1024)
def _compiled(text: str) -> dict[str, Any]:
    """The module that the text defines. The text is this package's own print, never a user's."""
    module: dict[str, Any] = {"__name__": "controller"}
    exec(compile(text, "<controller>", "exec"), module)
    return module


def python_controller(
    program: Program | ProgramTemplate, real: RealType = "double"
) -> PythonController:
    """The structure printed.

    A template's free parameters start at their guesses, or within their bounds next to zero.
    """
    controller = lower(_closed(program))
    return PythonController(
        text=python_text(controller, real, Provenance(program.interface.name)),
        names=tuple(name for name, _ in controller.parameters),
        single=gives_int(controller),
    )


def _closed(program: Program | ProgramTemplate) -> Program:
    if isinstance(program, Program):
        return program
    return program.close({p.name: _start(p) for p in program.free})


def _start(parameter: FreeParameter) -> float:
    if parameter.guess is not None:
        return parameter.guess
    return min(max(0.0, parameter.lower), parameter.upper)


def python_policy(program: Program, real: RealType = "double") -> PythonPolicy:
    """The program as emitted Python, at its first step."""
    return python_controller(program, real)()


class CPolicy:
    """An instance of an emitted C controller, compiled; loaded only if it is asked to act here.

    A simulator that loads the library itself needs no more than `compiled`.
    """

    def __init__(self, made: CControllerFactory, values: Mapping[str, float]) -> None:
        self._made = made
        self._values = values
        self.compiled = Compiled(str(made.library), made.params(values), made.reads)

    @cached_property
    def controller(self) -> CController:
        loaded = CController(load(self._made.library), self._made.controller, self._made.real)
        return loaded.with_params(self._values) if self._values else loaded

    def reset(self) -> None:
        self.controller.reset()

    def act(self, observation: Observation) -> tuple[float, ...]:
        return self.controller.step(observation)[0]

    @property
    def status(self) -> int:
        """The status bits of the last step."""
        return self.controller.status


@dataclass(frozen=True)
class CControllerFactory:
    """Makes policies that run a compiled controller with any parameter values.

    Picklable, with the library in the pickle: another machine has no file of that name.
    """

    controller: Controller
    library: Path
    real: RealType

    def __reduce__(self) -> tuple[Callable[..., CControllerFactory], tuple[object, ...]]:
        code = self.library.read_bytes()
        return _arrived, (self.controller, self.library, self.real, code)

    def with_params(self, values: Mapping[str, float]) -> CPolicy:
        """A policy with `values` for some of the parameters; the rest keep the program's."""
        return CPolicy(self, values)

    def __call__(self) -> CPolicy:
        return self.with_params({})

    def params(self, values: Mapping[str, float]) -> tuple[float, ...]:
        """The parameters in order, with other `values` for some. Raises PirlcError E0807."""
        own = dict(self.controller.parameters)
        for name in values:
            if name not in own:
                raise error(UnknownParameter(name, tuple(own)))
        return tuple({**own, **values}.values())

    @property
    def reads(self) -> frozenset[int]:
        """The components of the observation that the actions depend on."""
        return frozenset(
            channel.index
            for channel in self.controller.channels
            if channel.depth > 0 or channel.limit is not None
        )


def _arrived(
    controller: Controller, library: Path, real: RealType, code: bytes
) -> CControllerFactory:
    # Its folder's name is a hash of all that it was built from.
    if not library.is_file():
        library = Path(_foreign_libraries().name) / library.parent.name / library.name
        if not library.exists():
            library.parent.mkdir()
            library.write_bytes(code)
    return CControllerFactory(controller, library, real)


@lru_cache(maxsize=1)
def _foreign_libraries() -> TemporaryDirectory[str]:
    """Those that came from another machine, as long as this process lives."""
    return TemporaryDirectory(prefix="pirlc-")


def c_controller(
    program: Program | ProgramTemplate,
    cache: Path,
    real: RealType = "double",
    compiler: Compiler | None = None,
    flags: Sequence[str] = FLAGS,
) -> CControllerFactory:
    """The structure compiled from C, in a library kept under `cache`.

    A template's free parameters start as those of `python_controller`.
    """
    controller = lower(_closed(program))
    library = build(controller, cache.resolve(), real, compiler or find_compiler(), flags)
    return CControllerFactory(controller, library, real)


def c_policy(program: Program, cache: Path, real: RealType = "double") -> CPolicy:
    """The program as emitted C, compiled and loaded, at its first step."""
    return c_controller(program, cache, real)()
