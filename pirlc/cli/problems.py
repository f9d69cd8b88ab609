"""The mistakes about files and command lines (E0541, E0701 to E0709, E0731 to E0733)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

from pirlc.diagnostics import Diagnostic, Label, PirlcError
from pirlc.source import SourceText, Span


@dataclass(frozen=True)
class Unreadable:
    """A file that cannot be opened or read; `reason` is the system's."""

    place: str
    reason: str
    similar: str | None = None


@dataclass(frozen=True)
class NotText:
    """`offset`: of the first byte that is not UTF-8, counted from 0."""

    place: str
    offset: int


@dataclass(frozen=True)
class TooLarge:
    place: str
    limit: int


@dataclass(frozen=True)
class StillOpen:
    """A sketch where a program is needed; `choices` are the places of what is left to choose."""

    source: SourceText
    choices: tuple[tuple[Span, str], ...]


@dataclass(frozen=True)
class SystemRefused:
    place: str | None
    reason: str


@dataclass(frozen=True)
class OutOfMemory:
    pass


@dataclass(frozen=True)
class UnknownCode:
    code: str
    similar: str | None


@dataclass(frozen=True)
class NoSketch:
    """A policy that does not say where it acts; `kind` is what it is."""

    place: str
    kind: str


@dataclass(frozen=True)
class OtherProgram:
    """A C file that differs from what the program is emitted as."""

    place: str
    program: str


@dataclass(frozen=True)
class NoSuchRobot:
    """A driver that does not come with TORCS."""

    name: str
    known: tuple[str, ...]


@dataclass(frozen=True)
class NothingToBlock:
    """A name that is neither a reading of TORCS nor a sensor of the program."""

    name: str
    similar: str | None


@dataclass(frozen=True)
class RaceBrokeOff:
    """`reason`: what is known of why the simulator did not finish the race."""

    track: str
    reason: str


@dataclass(frozen=True)
class NotAnArgument:
    """An `--argument` that says nothing of an environment; `reason` is what is wrong with it."""

    given: str
    reason: str


Problem = (
    Unreadable
    | NotText
    | TooLarge
    | StillOpen
    | SystemRefused
    | OutOfMemory
    | UnknownCode
    | NoSketch
    | OtherProgram
    | NoSuchRobot
    | NothingToBlock
    | RaceBrokeOff
    | NotAnArgument
)

_SHOWN = 6


def error(problem: Problem) -> PirlcError:
    return PirlcError(describe(problem))


def describe(problem: Problem) -> Diagnostic:
    """The problem in words."""
    match problem:
        case Unreadable(place, reason, similar):
            return Diagnostic(
                "E0701",
                f"cannot read {place}: {reason}",
                help=f"did you mean {similar}?" if similar else None,
            )
        case NotText(place, offset):
            return Diagnostic(
                "E0702",
                f"{place} is not a text in UTF-8",
                notes=(f"byte {offset + 1:,} does not belong in one",),
                help="a .pirl file is plain text; save it again as UTF-8",
            )
        case TooLarge(place, limit):
            return Diagnostic(
                "E0703",
                f"{place} is larger than {limit:,} bytes",
                help="a .pirl file is a few dozen lines; is this the right file?",
            )
        case StillOpen(source, choices):
            (span, words), *others = choices[:_SHOWN]
            left = len(choices) - 1 - len(others)
            return Diagnostic(
                "E0704",
                "this is a sketch: a program is needed, with nothing left to choose",
                source,
                Label(span, words),
                tuple(Label(*other) for other in others),
                notes=(f"{left} more left open",) if left else (),
                help="`pirlc synth` makes a program of a sketch",
            )
        case SystemRefused(place, reason):
            what = f"{place}: {reason}" if place else reason
            return Diagnostic("E0705", f"the system refused: {what}")
        case OutOfMemory():
            return Diagnostic(
                "E0706",
                "there is not enough memory",
                help="ask for less (a smaller --size, fewer --workers), or close other programs",
            )
        case UnknownCode(code, similar):
            return Diagnostic(
                "E0707",
                f"no diagnostic has the code {code!a}",
                help=f"did you mean {similar}?"
                if similar
                else "codes are an E and four digits, such as E0303",
            )
        case NoSketch(place, kind):
            return Diagnostic(
                "E0708",
                f"{place} does not say where it acts",
                notes=(f"it is {kind}",),
                help="name its program or sketch with --sketch FILE",
            )
        case OtherProgram(place, program):
            return Diagnostic(
                "E0709",
                f"{place} is not what this pirlc emits from {program}",
                notes=("compiling it would run code that pirlc has not written",),
                help="emit it again, or give its own program with --sketch; if you trust it as it "
                "is, add --trust",
            )
        case NoSuchRobot(name, known):
            return Diagnostic(
                "E0731",
                f"no robot {name!a} comes with TORCS",
                help="these do: " + ", ".join(f"robot:{robot}" for robot in known),
            )
        case NothingToBlock(name, similar):
            return Diagnostic(
                "E0732",
                f"{name!a} is neither a sensor of the program nor a reading of TORCS",
                help=f"did you mean {similar}?" if similar else "readings are named trackPos, rpm",
            )
        case RaceBrokeOff(track, reason):
            return Diagnostic(
                "E0733",
                f"the race on {track} broke off",
                notes=(reason,),
                help="`pirlc torcs doctor` says what is wrong with TORCS here",
            )
        case NotAnArgument(given, reason):
            return Diagnostic(
                "E0541",
                f"`--argument {given}` is not an argument of an environment: {reason}",
                help="write KEY=VALUE, such as `--argument track=aalborg`, with a number, `true`, "
                "`false` or a text as value",
            )
        case _:
            assert_never(problem)
