"""Generated files, and how they reach a folder."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path, PurePosixPath

import pirlc
from pirlc.backend.problems import NotAFolder, NotWritable, error
from pirlc.diagnostics import PirlcError


@dataclass(frozen=True)
class GeneratedFile:
    """A text to write under a path relative to the output folder."""

    path: PurePosixPath
    text: str

    @staticmethod
    def of(name: str, text: str) -> GeneratedFile:
        return GeneratedFile(PurePosixPath(name), text)


@dataclass(frozen=True)
class Provenance:
    """What emitted code says that it was made from: the program's text and the compiler."""

    text: str
    version: str = pirlc.__version__

    @property
    def sha256(self) -> str:
        """Of the text in UTF-8, in hexadecimal."""
        return sha256(self.text.encode()).hexdigest()


def write(files: Iterable[GeneratedFile], folder: Path) -> tuple[Path, ...]:
    """Writes the files under `folder`, which is made if it is not there; returns their paths.

    Each file appears whole or not at all: a reader, or an interruption, never meets half of one.
    """
    return tuple(write_text(folder / file.path, file.text) for file in files)


def write_text(place: Path, text: str) -> Path:
    """Writes one file of UTF-8 by renaming a complete one onto it."""
    return write_bytes(place, text.encode())


def write_bytes(place: Path, data: bytes) -> Path:
    """Writes one file by renaming a complete one onto it."""
    folder = place.parent
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise error(NotAFolder(str(folder))) from None
    except OSError as e:
        raise error(NotWritable(str(folder), _reason(e))) from None
    temporary = None
    try:
        handle, temporary = tempfile.mkstemp(prefix=".pirlc-", dir=folder)
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
        mask = os.umask(0)
        os.umask(mask)
        Path(temporary).chmod(0o666 & ~mask)
        Path(temporary).replace(place)
    except OSError as e:
        if temporary is not None:
            with contextlib.suppress(OSError):
                Path(temporary).unlink()
        raise not_writable(place, e) from None
    return place


def not_writable(place: Path, e: OSError) -> PirlcError:
    """What to raise for a file that the system will not write, such as on a full disk."""
    return error(NotWritable(str(place), _reason(e)))


def _reason(e: OSError) -> str:
    return (e.strerror or str(e)).lower()
