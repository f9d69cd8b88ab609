"""What can be wrong with TORCS on this machine (codes E0520 to E0526)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

from pirlc.diagnostics import Diagnostic, PirlcError

INSTALL = "pirlc torcs install"


@dataclass(frozen=True)
class PackagesMissing:
    """Debian packages that are not here; `notes` say what was looked for."""

    packages: tuple[str, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class SourceUnavailable:
    """TORCS's source package could not be fetched."""

    version: str
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class BadSource:
    """What the user named as TORCS's source is something else."""

    place: str
    reason: str


@dataclass(frozen=True)
class HostNotBuilt:
    compiler: str
    output: tuple[str, ...]


@dataclass(frozen=True)
class NotPrepared:
    reason: str


@dataclass(frozen=True)
class Unfit:
    """TORCS is here and runs, but not as races for pirlc need it."""

    reason: str


@dataclass(frozen=True)
class CacheUnusable:
    """The folder cannot be written; `reason` is the system's."""

    place: str
    reason: str


Problem = (
    PackagesMissing
    | SourceUnavailable
    | BadSource
    | HostNotBuilt
    | NotPrepared
    | Unfit
    | CacheUnusable
)


def apt_line(packages: tuple[str, ...]) -> str:
    """What installs Debian packages."""
    return f"sudo apt-get install {' '.join(packages)}"


def describe(problem: Problem) -> Diagnostic:
    """The problem in words."""
    match problem:
        case PackagesMissing(packages, notes):
            listed = ", ".join(f"`{package}`" for package in packages)
            return Diagnostic(
                "E0520",
                f"TORCS needs packages that are not installed: {listed}",
                notes=notes,
                help=f"on Debian and Ubuntu: `{apt_line(packages)}`, then `{INSTALL}`",
            )
        case SourceUnavailable(version, reasons):
            return Diagnostic(
                "E0521",
                f"the source package of TORCS {version}, which has its headers, cannot be fetched",
                notes=reasons,
                help="fetch it where that works (`apt-get source --download-only torcs`), and name "
                f"the `.orig.tar` file here: `{INSTALL} --source FILE`",
            )
        case BadSource(place, reason):
            return Diagnostic(
                "E0522",
                f"{place} does not hold TORCS's headers: {reason}",
                help="the file is called like `torcs_1.3.7+dfsg.orig.tar.xz`; "
                "the folder that it unpacks to will do as well",
            )
        case HostNotBuilt(compiler, output):
            return Diagnostic(
                "E0523",
                f"`{compiler}` cannot build the robot that races for pirlc",
                notes=output,
                help="name another C++ compiler in the environment variable CXX",
            )
        case NotPrepared(reason):
            return Diagnostic(
                "E0524",
                "TORCS is not ready for races",
                notes=(reason,),
                help=f"run `{INSTALL}`",
            )
        case Unfit(reason):
            return Diagnostic(
                "E0525",
                "this TORCS does not race as it should",
                notes=(reason,),
                help="`pirlc torcs doctor` tells what else is wrong; pirlc is made for Debian's "
                "packages `torcs` and `torcs-data`",
            )
        case CacheUnusable(place, reason):
            return Diagnostic(
                "E0526",
                f"TORCS cannot be prepared in {place}: {reason}",
                help="make room or give the permission, or name another folder for caches in the "
                "environment variable XDG_CACHE_HOME",
            )
        case _:
            assert_never(problem)


def failure(problem: Problem) -> PirlcError:
    return PirlcError(describe(problem))
