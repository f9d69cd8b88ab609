"""The headers of TORCS: where its source package is had from, and what is kept of it."""

from __future__ import annotations

import hashlib
import io
import shutil
import tarfile
from pathlib import Path, PurePosixPath

import pytest

from pirlc.simulation.torcs.install_source import (
    copy_headers,
    fetch,
    has_headers,
    source_stanzas,
    unpack,
    wanted_header,
)
from tests.support.refusals import refused


def test_lists_of_packages_become_lists_of_sources(tmp_path) -> None:
    folder = tmp_path / "sources.list.d"
    folder.mkdir()
    (folder / "a.sources").write_text(
        "# a comment\nTypes: deb\n# another\nURIs: http://deb.debian.org/debian\n"
        "Suites: bookworm bookworm-updates\nComponents: main\n"
        "Signed-By:\n -----BEGIN PGP PUBLIC KEY BLOCK-----\n .\n abc\n\n"
        "Types: deb\nURIs: http://deb.debian.org/debian\nSuites: sid\nComponents: main\n"
        "Enabled: no\n"
    )
    (folder / "b.list").write_text(
        "deb [arch=amd64 signed-by=/k.gpg] http://mirror.example/ubuntu/ noble universe # all\n"
        "# deb http://deb.debian.org/debian bullseye main\n"
        "deb https://other.example/apt stable main\n"
    )
    (folder / "c.list.save").write_text("deb http://deb.debian.org/debian old main\n")
    assert source_stanzas(tmp_path) == [
        "Types: deb-src\nURIs: http://deb.debian.org/debian\nSuites: bookworm bookworm-updates\n"
        "Components: main\nSigned-By:\n -----BEGIN PGP PUBLIC KEY BLOCK-----\n .\n abc",
        "Types: deb-src\nURIs: http://mirror.example/ubuntu/\nSuites: noble\n"
        "Components: universe\nSigned-By: /k.gpg",
    ]
    assert source_stanzas(tmp_path / "none") == []


HEADERS = (
    *("interfaces/car.h", "interfaces/robot.h", "libs/tgf/tgf.h", "libs/math/v3_t.h"),
    "linux/osspec.h",
)


def _archive(place: Path, *others: tarfile.TarInfo) -> Path:
    names = [f"torcs-1/src/{name}" for name in HEADERS]
    unwanted = ["torcs-1/src/drivers/bt/driver.h", "torcs-1/src/libs/tgf/tgf.cpp", "torcs-1/a.h"]
    with tarfile.open(place, "w:xz") as tar:
        for name in (*names, *unwanted):
            entry = tarfile.TarInfo(name)
            content = f"/* {name} */\n".encode()
            entry.size = len(content)
            tar.addfile(entry, io.BytesIO(content))
        for other in others:
            tar.addfile(other, io.BytesIO(b"x" * other.size))
    return place


def _files(folder: Path) -> set[str]:
    return {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}


def test_only_headers_are_unpacked(tmp_path) -> None:
    outside, link = tarfile.TarInfo("torcs-1/src/interfaces/../../../../evil.h"), tarfile.TarInfo()
    outside.size = 1
    link.name, link.type, link.linkname = "t/src/linux/l.h", tarfile.SYMTYPE, "/etc/passwd"
    archive = _archive(tmp_path / "t.tar.xz", outside, link)
    fractions: list[float] = []
    unpack(archive, tmp_path / "a" / "headers", fractions.append)
    assert _files(tmp_path / "a" / "headers") == set(HEADERS)
    assert not list(tmp_path.rglob("evil.h"))
    assert has_headers(tmp_path / "a" / "headers")
    assert fractions[-1] == 1.0
    copy_headers(tmp_path / "a" / "headers", tmp_path / "b")
    assert _files(tmp_path / "b") == set(HEADERS)
    assert wanted_header(PurePosixPath("/src/linux/a.h")) == PurePosixPath("linux/a.h")
    assert wanted_header(PurePosixPath("a/b/src/linux/a.h")) is None


@pytest.mark.parametrize("size", [0, 1, 100, 200])
def test_a_damaged_archive_is_told(tmp_path, size) -> None:
    archive = _archive(tmp_path / "t.tar.xz")
    assert archive.stat().st_size > 300
    archive.write_bytes(archive.read_bytes()[:size])
    (tmp_path / "h").mkdir()
    message = refused(lambda: unpack(archive, tmp_path / "h", lambda _: None))
    assert message.startswith(f"error[E0522]: {archive} does not hold TORCS's headers: ")


def test_something_else_is_not_torcs(tmp_path) -> None:
    archive = tmp_path / "t.tar"
    tarfile.open(archive, "w").close()
    (tmp_path / "h").mkdir()
    message = refused(lambda: unpack(archive, tmp_path / "h", lambda _: None))
    assert "a robot needs more than there is" in message


needs_apt = pytest.mark.skipif(not shutil.which("apt-get"), reason="needs apt")


@needs_apt
def test_the_source_is_fetched_with_a_state_of_apt_of_its_own(tmp_path) -> None:
    """From a repository like Debian's, with one package in it."""
    repository = tmp_path / "repository"
    repository.mkdir()
    files = {"torcs_1.orig.tar.xz": _archive(repository / "torcs_1.orig.tar.xz").read_bytes()}
    files["torcs_1-2.debian.tar.xz"] = b"changes"
    files["torcs_1-2.dsc"] = b"Format: 3.0 (quilt)\nSource: torcs\nVersion: 1-2\n"
    lines = []
    for name, content in files.items():
        (repository / name).write_bytes(content)
        lines.append(f"\n {hashlib.sha256(content).hexdigest()} {len(content)} {name}")
    (repository / "Sources").write_text(
        "Package: torcs\nBinary: torcs\nVersion: 1-2\nArchitecture: any\nFormat: 3.0 (quilt)\n"
        f"Directory: .\nChecksums-Sha256:{''.join(lines)}\n"
    )
    (tmp_path / "sources.list").write_text(
        f"deb [trusted=yes] copy:{repository} ./\ndeb [trusted=yes] copy:{tmp_path}/missing ./\n"
    )
    system = [Path("/var/lib/apt/lists"), Path("/var/cache/apt"), Path("/etc/apt")]
    before = [sorted(_files(folder)) for folder in system]
    folder = tmp_path / "download"
    folder.mkdir()
    fractions: list[float] = []
    archive = fetch("1-2", folder, fractions.append, tmp_path)
    assert archive.read_bytes() == files["torcs_1.orig.tar.xz"]
    assert [sorted(_files(folder)) for folder in system] == before
    other = tmp_path / "other"
    other.mkdir()
    message = refused(lambda: fetch("3-4", other, fractions.append, tmp_path))
    assert message.startswith("error[E0521]: the source package of TORCS 3-4, ")
    assert "apt says: " in message


@needs_apt
def test_without_the_network_there_is_a_way_out(tmp_path) -> None:
    (tmp_path / "sources.list").write_text("deb http://127.0.0.1:9/debian bookworm main\n")
    (tmp_path / "d").mkdir()
    message = refused(lambda: fetch("1-2", tmp_path / "d", lambda _: None, tmp_path))
    assert "error[E0521]" in message
    assert "127.0.0.1" in message
    assert "--source FILE" in message


def test_without_lists_there_is_a_way_out(tmp_path) -> None:
    if shutil.which("apt-get"):
        message = refused(lambda: fetch("1-2", tmp_path, lambda _: None, tmp_path))
        assert "tells where Debian's packages come from" in message
