"""What can go wrong between a controller and its compiled code, and how users are told."""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

from pirlc.diagnostics import Diagnostic, PirlcError


@dataclass(frozen=True)
class BadIdentifier:
    """A name that no target can write."""

    name: str


@dataclass(frozen=True)
class UnknownTarget:
    target: str
    known: tuple[str, ...]


@dataclass(frozen=True)
class NoCompiler:
    tried: tuple[str, ...]


@dataclass(frozen=True)
class CompilerNotFound:
    """The environment variable CC names what cannot be run."""

    command: str


@dataclass(frozen=True)
class CompilationFailed:
    compiler: str
    first_lines: tuple[str, ...]


@dataclass(frozen=True)
class NotLoadable:
    """The compiled library does not load into this process."""

    reason: str


@dataclass(frozen=True)
class UnknownParameter:
    name: str
    known: tuple[str, ...]


@dataclass(frozen=True)
class NotWritable:
    """A folder or file of the output that cannot be made; `reason` is the system's."""

    place: str
    reason: str


@dataclass(frozen=True)
class NotAFolder:
    place: str


@dataclass(frozen=True)
class NoSuchReading:
    """A sensor beyond TORCS's readings, of which there are `count`."""

    sensor: str
    index: int
    count: int


@dataclass(frozen=True)
class NoSuchCommand:
    """An action beyond the components of TORCS's commands."""

    action: str
    component: int


@dataclass(frozen=True)
class NotSteered:
    """A program without some of the commands that every car needs."""

    missing: tuple[str, ...]


@dataclass(frozen=True)
class DiscreteCommand:
    """An action of few values where TORCS takes real numbers."""

    action: str
    command: str


Problem = (
    BadIdentifier
    | UnknownTarget
    | NoCompiler
    | CompilerNotFound
    | CompilationFailed
    | NotLoadable
    | UnknownParameter
    | NotWritable
    | NotAFolder
    | NoSuchReading
    | NoSuchCommand
    | NotSteered
    | DiscreteCommand
)

_COMMANDS = "a car in TORCS takes steer (0), accel (1) and perhaps brake (2)"


def error(problem: Problem) -> PirlcError:
    return PirlcError(describe(problem))


def describe(problem: Problem) -> Diagnostic:
    match problem:
        case BadIdentifier(name):
            return Diagnostic(
                "E0801",
                f"the name {name!a} cannot be written in emitted code",
                help="names are ASCII letters, digits and underscores, and begin with no digit",
            )
        case UnknownTarget(target, known):
            return Diagnostic(
                "E0802",
                f"there is no target {target!a}",
                help="the targets are " + ", ".join(known),
            )
        case NoCompiler(tried):
            return Diagnostic(
                "E0803",
                "no C compiler was found",
                notes=("looked for " + ", ".join(tried),),
                help="install one, name it in the environment variable CC, or install the "
                "ziglang wheel: pip install 'pirlc[cc]'",
            )
        case CompilerNotFound(command):
            return Diagnostic(
                "E0804",
                f"the C compiler that CC names cannot be run: {command}",
                help="set CC to a compiler's command, or unset it",
            )
        case CompilationFailed(compiler, first_lines):
            return Diagnostic(
                "E0805",
                f"the C compiler {compiler} refused the emitted code",
                notes=first_lines,
                help="if CC or CFLAGS name nothing unusual, this is a fault of pirlc: please "
                "report it with the program",
            )
        case NotLoadable(reason):
            return Diagnostic(
                "E0806",
                "the compiled controller cannot be loaded",
                notes=(reason,),
                help="the compiler must build for the machine and the Python that run pirlc",
            )
        case UnknownParameter(name, known):
            return Diagnostic(
                "E0807",
                f"the program has no parameter {name!a}",
                notes=("its parameters are " + ", ".join(known) if known else "it has none",),
            )
        case NotWritable(place, reason):
            return Diagnostic(
                "E0711",
                f"cannot write {place}: {reason}",
                help="choose another folder with -o, or make room in this one",
            )
        case NotAFolder(place):
            return Diagnostic(
                "E0712",
                f"the output folder {place} is a file",
                help="choose another folder with -o",
            )
        case NoSuchReading(sensor, index, count):
            return Diagnostic(
                "E0535",
                f"sensor {sensor} reads component {index}, which TORCS does not have",
                notes=(f"a car in TORCS has {count} readings, 0 to {count - 1}",),
                help=f"`pirlc explain E0535` lists them; write {sensor} : [...] = 2 for the third",
            )
        case NoSuchCommand(action, component):
            return Diagnostic(
                "E0536",
                f"action {action} is component {component}, which TORCS does not have",
                notes=(_COMMANDS,),
            )
        case NotSteered(missing):
            return Diagnostic(
                "E0537",
                f"no action of this program is the car's {' or '.join(missing)}",
                notes=(_COMMANDS,),
            )
        case DiscreteCommand(action, command):
            return Diagnostic(
                "E0538",
                f"action {action} has listed values, but is the car's {command}, a real number",
                help=f"declare it as {action} : [{'-1' if command == 'steer' else '0'}, 1]",
            )
        case _:
            assert_never(problem)
