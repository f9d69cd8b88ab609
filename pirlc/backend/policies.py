"""Programs as policies that run emitted code, for simulations.

The Python one is the quick one to make: a structure is printed and compiled once, and any number
of parameter values run on it. Factories are picklable, so that worker processes make their own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pirlc.backend.files import Provenance
from pirlc.backend.numbers import RealType
from pirlc.backend.python import gives_int, python_text
from pirlc.backend.toolchain import CController, Compiler, build, find_compiler, load
from pirlc.ir.controller import Controller
from pirlc.ir.policy import FreeParameter, Program, ProgramTemplate
from pirlc.lower import lower

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
    if isinstance(program, ProgramTemplate):
        program = program.close({p.name: _start(p) for p in program.free})
    controller = lower(program)
    return PythonController(
        text=python_text(controller, real, Provenance(program.interface.name)),
        names=tuple(name for name, _ in controller.parameters),
        single=gives_int(controller),
    )


def _start(parameter: FreeParameter) -> float:
    if parameter.guess is not None:
        return parameter.guess
    return min(max(0.0, parameter.lower), parameter.upper)


def python_policy(program: Program, real: RealType = "double") -> PythonPolicy:
    """The program as emitted Python, at its first step."""
    return python_controller(program, real)()


class CPolicy:
    """An instance of an emitted C controller, compiled and loaded."""

    def __init__(self, controller: CController) -> None:
        self.controller = controller
        self.reset = controller.reset

    def act(self, observation: Observation) -> tuple[float, ...]:
        return self.controller.step(observation)[0]

    @property
    def status(self) -> int:
        """The status bits of the last step."""
        return self.controller.status


@dataclass(frozen=True)
class CControllerFactory:
    """Makes policies that run a compiled controller; picklable, each call loads the library."""

    controller: Controller
    library: Path
    real: RealType
    values: tuple[tuple[str, float], ...] = ()

    def __call__(self) -> CPolicy:
        made = CController(load(self.library), self.controller, self.real)
        return CPolicy(made.with_params(dict(self.values)) if self.values else made)


def c_controller(
    program: Program, cache: Path, real: RealType = "double", compiler: Compiler | None = None
) -> CControllerFactory:
    """The program compiled from C, in a library kept under `cache`."""
    controller = lower(program)
    library = build(controller, cache.resolve(), real, compiler or find_compiler())
    return CControllerFactory(controller, library, real)


def c_policy(program: Program, cache: Path, real: RealType = "double") -> CPolicy:
    """The program as emitted C, compiled and loaded, at its first step."""
    return c_controller(program, cache, real)()
