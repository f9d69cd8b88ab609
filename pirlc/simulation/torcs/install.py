"""Prepares TORCS for races: `pirlc torcs install`.

Goals: nothing of TORCS's source but headers is kept, nothing outside the cache folder is written,
and every part is made beside its place and moved there whole. So an attempt that was cut short
leaves nothing that looks ready, and the next one goes on from the parts that are there.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from pirlc.simulation.torcs.building import (
    Compiler,
    build_robot,
    compiler_notes,
    find_compiler,
)
from pirlc.simulation.torcs.install_source import copy_headers, fetch, has_headers, unpack
from pirlc.simulation.torcs.installation import (
    HOST,
    Places,
    Record,
    Torcs,
    default_folder,
    find_torcs,
    headers_of,
    host_sources,
    installation,
    places,
    ready,
    tree_of,
    write_record,
)
from pirlc.simulation.torcs.installation_problems import (
    BadSource,
    CacheUnusable,
    NotPrepared,
    PackagesMissing,
    failure,
)
from pirlc.simulation.torcs.trial import TRACKS, control_interval, track_lengths


class Stage(Enum):
    """What is being done; the values are for people."""

    WAITING = "waiting for another `pirlc torcs install`"
    FETCHING = "fetching the source package"
    UNPACKING = "unpacking its headers"
    BUILDING = "building the host robot"
    RACING = "racing to verify"


Tell = Callable[[Stage, float], None]
"""Is told the stage and the fraction of it that is done."""


@dataclass(frozen=True)
class Prepared:
    """`changed`: whether anything was left to do."""

    record: Record
    folder: Path
    changed: bool


def install(
    folder: Path | None = None,
    source: Path | None = None,
    tell: Tell = lambda _, __: None,
    where: Places | None = None,
) -> Prepared:
    """Prepare what is missing under `folder` (None: in the user's cache).

    `source`: TORCS's source archive, or a folder that it was unpacked to; None: it is fetched.
    Raises PirlcError E0520 to E0523, E0525 and E0526.
    """
    folder = default_folder() if folder is None else folder
    where = places() if where is None else where
    torcs = find_torcs(where)
    compiler = find_compiler()
    if torcs is not None:
        known = _nothing_to_do(torcs, folder, compiler)
        if known is not None:
            return Prepared(known, folder, changed=False)
    torcs, compiler = _require(torcs, compiler, where)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with _alone(folder, tell):
            known = _nothing_to_do(torcs, folder, compiler)
            if known is not None:
                return Prepared(known, folder, changed=False)
            _sweep(folder)
            record = _prepare(torcs, compiler, folder, source, tell)
            return Prepared(record, folder, changed=True)
    except OSError as error:
        place = os.fsdecode(error.filename) if error.filename is not None else str(folder)
        reason = (error.strerror or str(error)).lower()
        raise failure(CacheUnusable(place, reason)) from error


def package_versions() -> tuple[str, str] | None:
    """The version of Debian's package and that of its source package; None: not known to dpkg."""
    form = "${db:Status-Status}|${Version}|${source:Version}"
    try:
        done = subprocess.run(
            ["dpkg-query", "-W", "-f", form, "torcs"], capture_output=True, text=True, check=False
        )
    except OSError:
        return None
    status, _, versions = done.stdout.partition("|")
    version, _, source = versions.partition("|")
    return (version, source) if status == "installed" and version and source else None


def missing_packages(torcs: Torcs | None, compiler: Compiler | None, where: Places) -> list[str]:
    """The Debian packages without which nothing can be prepared."""
    missing = [] if torcs is not None else ["torcs"]
    if not any((include / "plib" / "sg.h").is_file() for include in where.include):
        missing.append("libplib-dev")
    return missing if compiler is not None else [*missing, "g++"]


def _require(
    torcs: Torcs | None, compiler: Compiler | None, where: Places
) -> tuple[Torcs, Compiler]:
    missing = missing_packages(torcs, compiler, where)
    if missing or torcs is None or compiler is None:
        notes = compiler_notes() if compiler is None else ()
        raise failure(PackagesMissing(tuple(missing), notes))
    return torcs, compiler


def _nothing_to_do(torcs: Torcs, folder: Path, compiler: Compiler | None) -> Record | None:
    found = ready(torcs, folder)
    if isinstance(found, NotPrepared) or not has_headers(headers_of(folder, found.source)):
        return None
    # A compiler that is gone by now does no harm to what it built.
    return found if compiler is None or found.compiler == compiler.version else None


@contextmanager
def _alone(folder: Path, tell: Tell) -> Iterator[None]:
    """The system drops the lock with the process that holds it, however that ends."""
    with (folder / "lock").open("ab") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            tell(Stage.WAITING, 0.0)
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _sweep(folder: Path) -> None:
    """Removes what attempts that were killed have left."""
    for draft in folder.glob("draft-*"):
        shutil.rmtree(draft, ignore_errors=True)


@contextmanager
def _draft(folder: Path) -> Iterator[Path]:
    draft = Path(tempfile.mkdtemp(prefix="draft-", dir=folder))
    try:
        draft.chmod(0o755)
        yield draft
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def _put(made: Path, place: Path) -> None:
    """Moves a finished folder to its place; one that is there already gives way."""
    place.parent.mkdir(exist_ok=True)
    if place.exists():
        place.rename(made.with_name(f"{made.name}-before"))
    made.rename(place)


def _prepare(
    torcs: Torcs, compiler: Compiler, folder: Path, source: Path | None, tell: Tell
) -> Record:
    version, source_version = package_versions() or ("of unknown version", "unknown")
    headers = headers_of(folder, source_version)
    if source is not None or not has_headers(headers):
        _prepare_headers(headers, source_version, folder, source, tell)
    with _draft(folder) as draft:
        tree = draft / "tree"
        tell(Stage.BUILDING, 0.0)
        _link(torcs, tree)
        code = [path for path in host_sources() if path.suffix == ".cpp"]
        build_robot(compiler, code, headers, tree / "drivers" / HOST / f"{HOST}.so")
        tell(Stage.RACING, 0.0)
        tried = installation(torcs, tree, headers)
        interval = control_interval(tried)
        done: list[str] = []

        def raced(track: str) -> None:
            done.append(track)
            tell(Stage.RACING, len(done) / len(TRACKS))

        lengths = track_lengths(tried, raced)
        record = Record(version, source_version, torcs.stamp(), compiler.version, interval, lengths)
        write_record(record, tree)
        _put(tree, tree_of(folder))
    return record


def _prepare_headers(
    headers: Path, version: str, folder: Path, source: Path | None, tell: Tell
) -> None:
    with _draft(folder) as draft:
        made = draft / "headers"
        made.mkdir()
        if source is None:
            tell(Stage.FETCHING, 0.0)
            download = draft / "download"
            download.mkdir()
            source = fetch(version, download, lambda part: tell(Stage.FETCHING, part))
        tell(Stage.UNPACKING, 0.0)
        if source.is_dir():
            copy_headers(source, made)
        elif source.is_file():
            unpack(source, made, lambda part: tell(Stage.UNPACKING, part))
        else:
            raise failure(BadSource(str(source), "there is no such file or folder"))
        _put(made, headers)


def _link(torcs: Torcs, tree: Path) -> None:
    """TORCS looks for modules, libraries and drivers under one folder."""
    drivers = tree / "drivers"
    (drivers / HOST).mkdir(parents=True)
    for name in ("modules", "lib"):
        (tree / name).symlink_to(torcs.folder / name)
    for driver in (torcs.folder / "drivers").iterdir():
        if driver.name != HOST:
            (drivers / driver.name).symlink_to(driver)
