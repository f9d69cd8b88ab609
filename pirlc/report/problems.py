"""The mistakes about run folders and what a search is asked for (codes E0721 to E0726), and
about run folders that a page is to be made of (E0740, E0741); and about the front (E0745)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

from pirlc.diagnostics import Diagnostic, PirlcError


@dataclass(frozen=True)
class NoSimulator:
    """A sketch that names no environment cannot be searched for by simulation."""

    sketch: str


@dataclass(frozen=True)
class ForeignFolder:
    """The output folder holds files, but no run of pirlc."""

    folder: str
    found: str


@dataclass(frozen=True)
class OtherRun:
    """The output folder belongs to a run that was asked for something else; `differs` names it."""

    folder: str
    differs: tuple[str, ...]


@dataclass(frozen=True)
class DamagedRun:
    """The manifest of the output folder cannot be read."""

    folder: str
    reason: str


@dataclass(frozen=True)
class NothingFound:
    """A search was interrupted, or else used up its budget, before it had met any program."""

    interrupted: bool


@dataclass(frozen=True)
class NothingSoSmall:
    """The sketch allows no program of the size that was asked for."""

    largest: int


@dataclass(frozen=True)
class NoRun:
    """A page is wanted of a folder that holds no run."""

    folder: str
    reason: str


@dataclass(frozen=True)
class DamagedFile:
    """A file of a run that cannot be read as what it should be."""

    file: str
    reason: str


@dataclass(frozen=True)
class NotOnTheFront:
    """A program is picked by a number that the front does not have; `table` shows the front."""

    wanted: int
    table: tuple[str, ...]

    @property
    def members(self) -> int:
        return len(self.table) - 1


Problem = (
    NoSimulator
    | ForeignFolder
    | OtherRun
    | DamagedRun
    | NothingFound
    | NothingSoSmall
    | NoRun
    | DamagedFile
    | NotOnTheFront
)


def error(problem: Problem) -> PirlcError:
    return PirlcError(describe(problem))


def describe(problem: Problem) -> Diagnostic:
    match problem:
        case NoSimulator(sketch):
            return Diagnostic(
                "E0721",
                f"`{sketch}` names no environment to simulate in",
                help='add a line such as `environment "CartPole-v1"` to the sketch',
            )
        case ForeignFolder(folder, found):
            return Diagnostic(
                "E0722",
                f"the output folder `{folder}` is not empty and holds no run of pirlc",
                notes=(f"it contains `{found}`",),
                help="name another folder with `-o`; nothing was changed",
            )
        case OtherRun(folder, differs):
            return Diagnostic(
                "E0723",
                f"the output folder `{folder}` belongs to another run",
                notes=tuple(f"differs in: {name}" for name in differs),
                help="repeat that run's command to resume it, or name another folder with `-o`",
            )
        case DamagedRun(folder, reason):
            return Diagnostic(
                "E0724",
                f"the manifest of the run in `{folder}` cannot be read: {reason}",
                help="name another folder with `-o`; the journal in this one was left as it is",
            )
        case NothingFound(interrupted):
            return Diagnostic(
                "E0725",
                "interrupted before the search had any program"
                if interrupted
                else "timeout: the search used up its budget before it had any program",
                help="the same command goes on from here"
                if interrupted
                else "the same command with a larger `--time` or `--budget` goes on from here",
            )
        case NothingSoSmall(largest):
            return Diagnostic(
                "E0726",
                f"the sketch allows no program of at most {largest} nodes",
                help="`pirlc check --size N` lists how many there are of each size; "
                "raise `--max-size`",
            )
        case NoRun(folder, reason):
            return Diagnostic(
                "E0740",
                f"`{folder}` holds no run of `pirlc synth`: {reason}",
                help="name the folder that was given to `pirlc synth` with `-o`",
            )
        case DamagedFile(file, reason):
            return Diagnostic(
                "E0741",
                f"the run's file `{file}` cannot be used: {reason}",
                help="repeat the run's command, which makes the file again; or move the file away, "
                "and the page says that it is missing",
            )
        case NotOnTheFront(wanted, table):
            count = problem.members
            have = "one program" if count == 1 else f"{count} programs, numbered from 1"
            return Diagnostic(
                "E0745",
                f"there is no program {wanted} to pick: the front has {have}",
                notes=table,
                help="the same command with another `--pick` takes another one; the search is not "
                "done again",
            )
        case _:
            assert_never(problem)
