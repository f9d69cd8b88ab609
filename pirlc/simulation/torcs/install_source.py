"""Fetches the headers of TORCS, which only its source package has.

Goals: no root, no line added to the system's lists of packages, the signatures checked by apt as
for any package. So apt is run with a state of its own, on lists derived from the system's.
"""

from __future__ import annotations

import lzma
import os
import re
import shutil
import signal
import subprocess
import tarfile
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath
from urllib.parse import urlsplit

from pirlc.simulation.torcs.installation import HEADER_FOLDERS
from pirlc.simulation.torcs.installation_problems import (
    BadSource,
    CacheUnusable,
    SourceUnavailable,
    failure,
)

Fraction = Callable[[float], None]

NEEDED = 430_000_000
"""Bytes that the download takes for a while."""

SYSTEM_LISTS = Path("/etc/apt")

_MOST = 4_000_000
"""Bytes of a header file, at most."""

_NEEDED_HEADERS = ("interfaces/car.h", "interfaces/robot.h", "libs/tgf/tgf.h", "tmath/v3_t.h")


def fetch(source: str, folder: Path, told: Fraction, lists: Path = SYSTEM_LISTS) -> Path:
    """Downloads the source package's archive of a version into an empty folder.

    `lists`: the folder of apt's own lists. Raises PirlcError E0521, and E0526 where there is no
    room for it.
    """
    free = shutil.disk_usage(folder).free
    if free < NEEDED:
        words = f"{NEEDED // 10**6} MB are needed for a while, and {free // 10**6} MB are free"
        raise failure(CacheUnusable(str(folder.parent), words))
    if shutil.which("apt-get") is None:
        raise failure(SourceUnavailable(source, ("there is no `apt-get` on this machine",)))
    stanzas = source_stanzas(lists)
    if not stanzas:
        words = f"no list in {lists} tells where Debian's packages come from"
        raise failure(SourceUnavailable(source, (words,)))
    environment = _private_apt(folder, stanzas)
    package = f"torcs={source}"
    # One list that cannot be had is no obstacle if the others have the package.
    _, updated = _run(["update", "-q"], folder, environment)
    _, listed = _run(["source", "--print-uris", package], folder, environment)
    sizes = [int(size) for size in re.findall(r"^'\S+' \S+ (\d+) ", listed, re.MULTILINE)]
    if not sizes:
        raise failure(SourceUnavailable(source, _reasons(updated + listed)))
    command = ["source", "--download-only", "-q", package]
    done, said = _run(
        command, folder, environment, lambda: told(min(1.0, _size(folder) / sum(sizes)))
    )
    archives = [path for path in folder.glob("torcs_*.orig.tar.*") if path.suffix != ".asc"]
    if not done or len(archives) != 1:
        raise failure(SourceUnavailable(source, _reasons(said)))
    return archives[0]


def source_stanzas(lists: Path) -> list[str]:
    """The system's lists of Debian packages, as lists of the source packages beside them."""
    files = [lists / "sources.list", *sorted((lists / "sources.list.d").glob("*"))]
    found: list[tuple[str, str]] = []
    for file in files:
        try:
            text = file.read_text(encoding="utf-8", errors="replace")
        except OSError:
            continue
        if file.suffix == ".sources":
            found.extend(_from_deb822(text))
        elif file.suffix == ".list":
            found.extend(_from_lines(text))
    # Whoever else has packages here rarely has their sources, and never those of TORCS.
    distribution = [stanza for uri, stanza in found if _is_distribution(uri)]
    chosen = distribution or [stanza for _, stanza in found]
    return list(dict.fromkeys(chosen))


def _is_distribution(uri: str) -> bool:
    return PurePosixPath(urlsplit(uri).path).name in ("debian", "ubuntu", "ubuntu-ports")


def _from_deb822(text: str) -> Iterator[tuple[str, str]]:
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    for block in re.split(r"\n[ \t]*\n", "\n".join(lines)):
        # A field goes on in the lines that begin with a blank.
        fields = re.findall(r"^([A-Za-z-]+):(.*(?:\n[ \t].*)*)", block, re.MULTILINE)
        named = {name.lower(): value.strip() for name, value in fields}
        if "uris" not in named or named.get("enabled", "yes").lower() in ("no", "false", "0"):
            continue
        if not {"deb", "deb-src"} & set(named.get("types", "").split()):
            continue
        kept = [
            f"{name}:{value}"
            for name, value in fields
            if name.lower() not in ("types", "enabled", "architectures")
        ]
        yield named["uris"].split()[0], "\n".join(["Types: deb-src", *kept])


def _from_lines(text: str) -> Iterator[tuple[str, str]]:
    pattern = r"^\s*deb(?:-src)?\s+(?:\[([^\]]*)\]\s*)?(\S+)\s+(\S+)([^#\n]*)"
    for options, uri, suite, components in re.findall(pattern, text, re.MULTILINE):
        fields = {"Types": "deb-src", "URIs": uri, "Suites": suite}
        if components.strip():
            fields["Components"] = components.strip()
        for name, value in re.findall(r"([\w-]+)=(\S+)", options):
            if name.lower() in ("signed-by", "trusted", "check-valid-until"):
                fields[name.title()] = value
        yield uri, "\n".join(f"{name}: {value}" for name, value in fields.items())


def _private_apt(folder: Path, stanzas: list[str]) -> dict[str, str]:
    """The environment variables under which apt reads and writes in this folder alone."""
    state = folder / "apt"
    for name in ("lists/partial", "cache/archives/partial", "parts", "sources"):
        (state / name).mkdir(parents=True)
    (state / "sources" / "source.sources").write_text("\n\n".join(stanzas) + "\n", encoding="utf-8")
    # How the system fetches (a proxy, say) is kept; its hooks after an update are not run.
    known = subprocess.run(
        ["apt-config", "dump", "Acquire"], capture_output=True, text=True, check=False
    ).stdout
    settings = {
        "Dir::Etc::main": "/dev/null",
        "Dir::Etc::parts": state / "parts",
        "Dir::Etc::sourcelist": "/dev/null",
        "Dir::Etc::sourceparts": state / "sources",
        "Dir::State::lists": state / "lists",
        "Dir::Cache": state / "cache",
        "APT::Sandbox::User": "root",
        "Acquire::Retries": 1,
    }
    text = known + "".join(f'{name} "{value}";\n' for name, value in settings.items())
    (state / "apt.conf").write_text(text, encoding="utf-8")
    return {**os.environ, "APT_CONFIG": str(state / "apt.conf"), "LC_ALL": "C.UTF-8"}


def _run(
    arguments: list[str],
    folder: Path,
    environment: dict[str, str],
    look: Callable[[], None] = lambda: None,
) -> tuple[bool, str]:
    """Whether apt-get did it, and what it said. `look` is called while it runs."""
    with (folder / "apt" / "log").open("w+b") as log:
        with subprocess.Popen(
            ["apt-get", *arguments],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        ) as process:
            try:
                while process.poll() is None:
                    look()
                    time.sleep(0.1)
            except BaseException:
                # With the processes that it has fetching for it.
                os.killpg(process.pid, signal.SIGKILL)
                raise
        log.seek(0)
        return process.returncode == 0, log.read().decode(errors="replace")


def _size(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.glob("torcs_*"))


def _reasons(said: str) -> tuple[str, ...]:
    """What apt could not fetch, then its errors."""
    lines = [line.strip() for line in said.splitlines() if line.startswith(("E: ", "W: "))]
    failed = [line[3:] for line in lines if line[3:].startswith("Failed to fetch")]
    errors = [line[3:] for line in lines if line.startswith("E: ") and line[3:] not in failed]
    found = tuple(dict.fromkeys([*failed[:2], *errors]))
    return tuple(f"apt says: {line}" for line in found[:3]) or ("apt gives no reason",)


def unpack(archive: Path, headers: Path, told: Fraction) -> None:
    """Keeps the headers of a source archive in an empty folder. Raises PirlcError E0522."""
    size = max(1, archive.stat().st_size)
    try:
        with (
            archive.open("rb") as stream,
            tarfile.open(fileobj=stream, mode="r|*", bufsize=1 << 20) as tar,
        ):
            for member in tar:
                told(min(1.0, stream.tell() / size))
                name = wanted_header(PurePosixPath(member.name))
                if name is None or not member.isfile() or member.size > _MOST:
                    continue
                content = tar.extractfile(member)
                assert content is not None
                _keep(headers / name, content.read())
    except (tarfile.TarError, lzma.LZMAError, zlib.error, EOFError, ValueError) as error:
        raise failure(BadSource(str(archive), f"it cannot be unpacked ({error})")) from error
    _complete(headers, archive)


def wanted_header(path: PurePosixPath) -> PurePosixPath | None:
    """Where a file of the source archive belongs in the folder of headers; None: nowhere."""
    parts = path.parts
    if path.suffix != ".h" or "src" not in parts[:2] or ".." in parts:
        return None
    inside = PurePosixPath(*parts[parts.index("src") + 1 :])
    return inside if str(inside.parent) in HEADER_FOLDERS else None


def copy_headers(source: Path, headers: Path) -> None:
    """Keeps the headers of an unpacked source package, or of a folder of headers like ours."""
    inside = next((p for p in (source / "src", *source.glob("*/src")) if p.is_dir()), source)
    for name in HEADER_FOLDERS:
        for file in (inside / name).glob("*.h"):
            _keep(headers / name / file.name, file.read_bytes())
    _complete(headers, source)


def _keep(place: Path, content: bytes) -> None:
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(content)


def _complete(headers: Path, origin: Path) -> None:
    link = headers / "tmath"
    if not link.is_symlink():
        link.symlink_to(Path("libs", "math"))
    if not has_headers(headers):
        raise failure(BadSource(str(origin), "a robot needs more than there is"))


def has_headers(headers: Path) -> bool:
    return all((headers / name).is_file() for name in _NEEDED_HEADERS)
