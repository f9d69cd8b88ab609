"""The mistakes about loops and the plants that users give (codes E0920 to E0926)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

from pirlc.analyze.findings import Check
from pirlc.diagnostics import Diagnostic, PirlcError


@dataclass(frozen=True)
class BadPlantFile:
    """`reason` is the first thing that is wrong with it."""

    place: str
    reason: str


@dataclass(frozen=True)
class Disagreement:
    """Two ways to a figure of the loop with this leaf in it led to different values."""

    leaf: str
    checks: tuple[Check, ...]


@dataclass(frozen=True)
class UnknownName:
    """A plant's input that is no action of the program, or an output that is no sensor."""

    place: str
    kind: str
    name: str
    known: tuple[str, ...]
    similar: str | None


@dataclass(frozen=True)
class DirectPath:
    """A plant whose output answers an input in the same step."""

    place: str
    output: str
    input: str


@dataclass(frozen=True)
class BadPoint:
    """An `--at` that names no sensor or action, or no number."""

    given: str
    reason: str
    similar: str | None = None


@dataclass(frozen=True)
class NowhereToLook:
    """A plant is to be found in an environment that the program does not name."""

    program: str


@dataclass(frozen=True)
class OtherSampleTime:
    """The plant's sample time is not the program's; both in seconds."""

    place: str
    plant: float
    program: float


Problem = (
    BadPlantFile
    | Disagreement
    | UnknownName
    | DirectPath
    | BadPoint
    | NowhereToLook
    | OtherSampleTime
)


def error(problem: Problem) -> PirlcError:
    return PirlcError(describe(problem))


def describe(problem: Problem) -> Diagnostic:
    match problem:
        case BadPlantFile(place, reason):
            return Diagnostic(
                "E0920",
                f"{place} describes no plant: {reason}",
                help="`pirlc explain E0920` shows what such a file holds",
            )
        case Disagreement(leaf, checks):
            return Diagnostic(
                "E0921",
                f"two ways to a margin of the loop with {leaf} disagree",
                notes=tuple(
                    f"{c.figure}: {c.value:.9g}, but {c.again:.9g} by {c.by}" for c in checks
                ),
                help="none of the two can be relied on; a plant in better scaled units may help",
            )
        case UnknownName(place, kind, name, known, similar):
            return Diagnostic(
                "E0922",
                f"{place}: the program has no {kind} {name!a}",
                notes=(f"it has {', '.join(known)}",),
                help=f"did you mean {similar}?" if similar else None,
            )
        case DirectPath(place, output, input_):
            return Diagnostic(
                "E0923",
                f"{place}: {output} answers {input_} in the same step",
                notes=("a program takes its readings before it acts: D must be zero",),
                help="where the reading is of the step before, add that delay to the plant",
            )
        case BadPoint(given, reason, similar):
            return Diagnostic(
                "E0924",
                f"`--at {given}` is no operating point: {reason}",
                help=f"did you mean {similar}?"
                if similar
                else "write SENSOR=NUMBER, such as `--at Speed=0.3`",
            )
        case NowhereToLook(program):
            return Diagnostic(
                "E0925",
                f"`{program}` names no environment to find a plant in",
                help="give the plant in a file: `--plant plant.toml`",
            )
        case OtherSampleTime(place, plant, program):
            return Diagnostic(
                "E0926",
                f"{place} is sampled every {plant:g} s, the program every {program:g} s",
                help="give the plant at the program's sample time, or as a continuous one "
                "(`continuous = true`)",
            )
        case _:
            assert_never(problem)
