"""Looks at everything that races need: `pirlc torcs doctor`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pirlc.diagnostics import PirlcError
from pirlc.simulation.torcs.building import compiler_notes, find_compiler
from pirlc.simulation.torcs.install import missing_packages, package_versions
from pirlc.simulation.torcs.install_source import has_headers
from pirlc.simulation.torcs.installation import (
    Installation,
    Places,
    Torcs,
    default_folder,
    find_torcs,
    headers_of,
    installation,
    places,
    ready,
    tree_of,
)
from pirlc.simulation.torcs.installation_problems import INSTALL, NotPrepared, apt_line
from pirlc.simulation.torcs.trial import control_interval, track_lengths


@dataclass(frozen=True)
class Check:
    """`found`: what there is, or what is wrong; `advice`: what to do where it is not `ok`."""

    name: str
    ok: bool
    found: str
    advice: str | None = None


def examine(folder: Path | None = None, where: Places | None = None) -> tuple[Check, ...]:
    """All checks in the order in which things depend on each other; none raises."""
    folder = default_folder() if folder is None else folder
    where = places() if where is None else where
    torcs = find_torcs(where)
    checks = [_package(torcs), *_tools(where)]
    if torcs is None:
        return (*checks, _untried("headers"), _untried("host robot"), *_RACES_UNTRIED)
    source = (package_versions() or ("", "unknown"))[1]
    headers = headers_of(folder, source)
    found = ready(torcs, folder)
    checks += [_headers(headers), _host(found, folder)]
    if isinstance(found, NotPrepared):
        return (*checks, *_RACES_UNTRIED)
    prepared = installation(torcs, tree_of(folder), headers)
    return (*checks, _interval(prepared), _tracks(prepared))


def _untried(name: str) -> Check:
    return Check(name, ok=False, found="not tried: something above is wrong")


_RACES_UNTRIED = (_untried("control interval"), _untried("tracks"))


def _package(torcs: Torcs | None) -> Check:
    if torcs is None:
        advice = f"`{apt_line(('torcs',))}`"
        return Check("TORCS", ok=False, found="not installed", advice=advice)
    versions = package_versions()
    known = f"Debian's {versions[0]}" if versions else "of a version that dpkg does not know"
    return Check("TORCS", ok=True, found=f"{known}, {torcs.binary}")


def _tools(where: Places) -> tuple[Check, Check]:
    compiler = find_compiler()
    missing = missing_packages(None, compiler, where)
    plib = Check("plib", ok=True, found="its headers are there")
    if "libplib-dev" in missing:
        advice = f"`{apt_line(('libplib-dev',))}`"
        plib = Check("plib", ok=False, found="its headers are not installed", advice=advice)
    if compiler is not None:
        return plib, Check("compiler", ok=True, found=compiler.version)
    found = "; ".join(("there is no C++ compiler", *compiler_notes()))
    return plib, Check("compiler", ok=False, found=found, advice=f"`{apt_line(('g++',))}`")


def _headers(headers: Path) -> Check:
    if has_headers(headers):
        return Check("headers", ok=True, found=str(headers))
    return Check("headers", ok=False, found=f"not complete in {headers}", advice=f"run `{INSTALL}`")


def _host(found: object, folder: Path) -> Check:
    if isinstance(found, NotPrepared):
        return Check("host robot", ok=False, found=found.reason, advice=f"run `{INSTALL}`")
    return Check("host robot", ok=True, found=str(tree_of(folder)))


def _interval(prepared: Installation) -> Check:
    try:
        interval = control_interval(prepared)
    except (PirlcError, OSError) as error:
        return _failed("control interval", error)
    return Check("control interval", ok=True, found=f"{interval:g} s")


def _tracks(prepared: Installation) -> Check:
    try:
        lengths = track_lengths(prepared)
    except (PirlcError, OSError) as error:
        return _failed("tracks", error)
    found = ", ".join(f"{track} {length:,.0f} m" for track, length in lengths.items())
    return Check("tracks", ok=True, found=found)


def _failed(name: str, error: PirlcError | OSError) -> Check:
    if isinstance(error, OSError):
        return Check(name, ok=False, found=str(error), advice="make room, or give the permission")
    (diagnostic, *_) = error.diagnostics
    found = "; ".join(diagnostic.notes) or diagnostic.message
    return Check(name, ok=False, found=found, advice=diagnostic.help)
