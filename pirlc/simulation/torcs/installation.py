"""Where a usable TORCS is on this machine.

`pirlc torcs install` prepares a folder in the user's cache::

    headers/VERSION/          the headers of TORCS's source package
    hosts/DIGEST/             a tree of links as TORCS wants it, with the host robot that was built
                              from the sources of this digest; so versions of pirlc share a cache
    hosts/DIGEST/ready.json   written when everything was found to work
"""

from __future__ import annotations

import hashlib
import json
import sysconfig
from dataclasses import asdict, dataclass
from pathlib import Path

from pirlc import resources
from pirlc.simulation.torcs.installation_problems import NotPrepared, PackagesMissing, failure

HOST = "pirlc"
"""The name of the host robot's module."""

CONTROL_INTERVAL = 0.02
"""Seconds between two commands."""

RECORD = "ready.json"

BUILD_FLAGS = ("-std=c++17", "-O2", "-Wall", "-Wextra", "-ffp-contract=off", "-fPIC", "-shared")
"""How robots are built."""

HEADER_FOLDERS = (
    *("interfaces", "linux", "libs/tgf", "libs/robottools", "libs/txml", "libs/math"),
    "libs/portability",
)
"""What is kept of TORCS's `src/`: the headers in these."""

_HOST_SOURCES = ("host.cpp", "readings.cpp")

_FORMAT = 1


@dataclass(frozen=True)
class Installation:
    """`binary`: torcs-bin. `shared`: the folder of its shared libraries. `tree`: a folder of links
    with the modules and the drivers, the host robot among them. `data`: tracks, cars and drivers'
    settings, as the package has them. `headers`: what robots are built against.
    """

    binary: Path
    shared: Path
    tree: Path
    data: Path
    headers: Path

    @property
    def tracks(self) -> dict[str, str]:
        """The category of each track."""
        found = self.data.glob("tracks/*/*/*.xml")
        return {p.parent.name: p.parent.parent.name for p in found if p.stem == p.parent.name}

    @property
    def cars(self) -> tuple[str, ...]:
        found = self.data.glob("cars/*/*.xml")
        return tuple(sorted(p.stem for p in found if p.stem == p.parent.name))


@dataclass(frozen=True)
class Places:
    """Where to look for what packages install: folders that may hold `torcs/torcs-bin`, folders
    that may hold `tracks/`, and folders that may hold `plib/`.
    """

    libraries: tuple[Path, ...]
    data: tuple[Path, ...]
    include: tuple[Path, ...]


@dataclass(frozen=True)
class Torcs:
    """TORCS as its package installs it: `folder` has torcs-bin, `drivers/`, `modules/`, `lib/`."""

    folder: Path
    data: Path

    @property
    def binary(self) -> Path:
        return self.folder / "torcs-bin"

    def stamp(self) -> tuple[str, int, int]:
        """Changes when another version is installed."""
        status = self.binary.stat()
        return str(self.binary), status.st_size, status.st_mtime_ns


@dataclass(frozen=True)
class Record:
    """What was prepared, and found to work. `version`: the package's; `source`: its source
    package's. `torcs`: the stamp. `control_interval` in s, `tracks`: their lengths in m.
    """

    version: str
    source: str
    torcs: tuple[str, int, int]
    compiler: str
    control_interval: float
    tracks: dict[str, float]


def places() -> Places:
    """Where Debian puts things, and where an installation from source does."""
    triplet = sysconfig.get_config_var("MULTIARCH")
    usr = Path("/usr/lib")
    first = (usr / triplet,) if triplet else ()
    others = tuple(binary.parents[1] for binary in sorted(usr.glob("*/torcs/torcs-bin")))
    return Places(
        (*first, *others, usr, Path("/usr/local/lib")),
        (Path("/usr/share/games/torcs"), Path("/usr/local/share/games/torcs")),
        (Path("/usr/include"), Path("/usr/local/include")),
    )


def find_torcs(where: Places) -> Torcs | None:
    """TORCS as its package installs it; None where program or data are missing."""
    for library in where.libraries:
        if (library / "torcs" / "torcs-bin").is_file():
            for data in where.data:
                if (data / "tracks").is_dir():
                    return Torcs(library / "torcs", data)
    return None


def default_folder() -> Path:
    """The folder that `pirlc torcs install` prepares."""
    return resources.user_cache() / "torcs"


def host_sources() -> tuple[Path, ...]:
    """The C++ files of the host robot, and the headers."""
    folder = resources.runtime("torcs")
    headers = (path for path in folder.iterdir() if path.suffix == ".h")
    return (*(folder / name for name in _HOST_SOURCES), *sorted(headers))


def host_digest() -> str:
    """Names the host robot that this pirlc needs, by all that it is made of."""
    digest = hashlib.sha256(repr((_FORMAT, BUILD_FLAGS)).encode())
    for source in host_sources():
        digest.update(f"{source.name}\0".encode() + source.read_bytes())
    return digest.hexdigest()[:16]


def tree_of(folder: Path) -> Path:
    return folder / "hosts" / host_digest()


def headers_of(folder: Path, source: str) -> Path:
    return folder / "headers" / source


def include_flags(headers: Path) -> tuple[str, ...]:
    """The compiler's arguments for including TORCS's headers, as its own build installs them."""
    # robottools.h asks for <tmath/...>, a link to libs/math.
    folders = (headers, *(headers / name for name in HEADER_FOLDERS if name != "libs/math"))
    return tuple(argument for folder in folders for argument in ("-isystem", str(folder)))


def write_record(record: Record, tree: Path) -> None:
    text = json.dumps({"format": _FORMAT, **asdict(record)}, indent=2) + "\n"
    (tree / RECORD).write_text(text, encoding="utf-8")


def read_record(tree: Path) -> Record | None:
    """None where the tree is missing, half-built or damaged."""
    if not (tree / "drivers" / HOST / f"{HOST}.so").is_file():
        return None
    try:
        found = json.loads((tree / RECORD).read_bytes())
        if found.pop("format") != _FORMAT:
            return None
        path, size, time = found.pop("torcs")
        return Record(torcs=(path, size, time), **found)
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return None


def ready(torcs: Torcs, folder: Path) -> Record | NotPrepared:
    """What was prepared in a folder for this TORCS and this pirlc, or why nothing fits."""
    tree = tree_of(folder)
    record = read_record(tree)
    if record is None:
        if tree.exists():
            return NotPrepared(f"what is in {tree} is not complete")
        if any(folder.glob(f"hosts/*/{RECORD}")):
            return NotPrepared("it was prepared by another version of pirlc")
        return NotPrepared(f"there is nothing in {folder}")
    if record.torcs != torcs.stamp():
        return NotPrepared(
            f"it was prepared for TORCS {record.version}; another is installed by now"
        )
    return record


def installed(folder: Path | None = None, where: Places | None = None) -> Installation:
    """The installation that `pirlc torcs install` prepared (without `folder`: in the cache).

    Raises PirlcError E0520 where TORCS is missing, and E0524 where nothing fitting was prepared.
    """
    folder = default_folder() if folder is None else folder
    torcs = find_torcs(places() if where is None else where)
    if torcs is None:
        raise failure(PackagesMissing(("torcs",)))
    record = ready(torcs, folder)
    if isinstance(record, NotPrepared):
        raise failure(record)
    return installation(torcs, tree_of(folder), headers_of(folder, record.source))


def installation(torcs: Torcs, tree: Path, headers: Path) -> Installation:
    return Installation(torcs.binary, torcs.folder / "lib", tree, torcs.data, headers)
