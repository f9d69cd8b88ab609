"""What a run left in its folder, read back for the page; files that are not there are None."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pirlc.report.problems import DamagedFile, NoRun, error
from pirlc.report.run import (
    ANALYSIS,
    FRONT,
    GIVEN,
    MANIFEST,
    READING,
    SKETCH,
    TRACES,
    VERIFICATION,
)

_CANDIDATES = "candidates.jsonl"


@dataclass(frozen=True)
class Stored:
    """A run's files. `candidates` has a line an entry; `emitted` are (path in the folder, bytes)
    of the files made for use, and `header` is the text of the emitted C header. `others` are files
    of findings that are not about this program: left by a run that has since gone on."""

    folder: Path
    manifest: Mapping[str, Any]
    sketch: str | None
    program_file: str | None
    candidates: tuple[Mapping[str, Any], ...] | None
    traces: Mapping[str, Any] | None
    verification: Mapping[str, Any] | None
    analysis: Mapping[str, Any] | None
    reading: Mapping[str, Any] | None
    front: Mapping[str, Any] | None
    emitted: tuple[tuple[str, int], ...]
    header: str | None
    others: tuple[str, ...]


def read_stored(folder: Path) -> Stored:
    """Everything of a run that the page shows.

    Raises PirlcError E0740 for a folder without a run, E0741 for a file that cannot be read as
    what it should be.
    """
    if not folder.is_dir():
        reason = "it is a file" if folder.exists() else "there is no such folder"
        raise error(NoRun(str(folder), reason))
    if not (folder / MANIFEST).is_file():
        raise error(NoRun(str(folder), f"it has no `{MANIFEST}`"))
    manifest = _json(folder, MANIFEST)
    assert manifest is not None
    findings, others = _findings(folder, manifest)
    headers = sorted((folder / "c").glob("*.h"))
    programs = sorted(p for p in folder.glob("*.pirl") if p.name not in (SKETCH, GIVEN))
    return Stored(
        folder,
        manifest,
        _text(folder / SKETCH),
        _text(programs[0]) if programs else None,
        _lines(folder, _CANDIDATES),
        findings[TRACES],
        findings[VERIFICATION],
        findings[ANALYSIS],
        findings[READING],
        findings[FRONT],
        tuple(_emitted(folder)),
        _text(headers[0]) if headers else None,
        others,
    )


def _findings(
    folder: Path, manifest: Mapping[str, Any]
) -> tuple[dict[str, Mapping[str, Any] | None], tuple[str, ...]]:
    """The findings about the program in the manifest, and the names of those about another."""
    with understanding(MANIFEST):
        program = manifest.get("program")
        digest = None if program is None else program["sha256"]
    findings: dict[str, Mapping[str, Any] | None] = {}
    others = []
    for name in (TRACES, VERIFICATION, ANALYSIS, READING, FRONT):
        found = _json(folder, name)
        with understanding(name):
            if found is not None and found["program_sha256"] != digest:
                others.append(name)
                found = None
        findings[name] = found
    return findings, tuple(others)


@contextmanager
def understanding(file: str) -> Iterator[None]:
    """Whatever turns out to be missing or of another type in a stored file is E0741."""
    try:
        yield
    except KeyError as e:
        raise error(DamagedFile(file, f"it lacks {e}")) from None
    except (TypeError, AttributeError, IndexError, ValueError) as e:
        raise error(DamagedFile(file, f"it is not as pirlc writes it ({e})")) from None


def _emitted(folder: Path) -> Iterator[tuple[str, int]]:
    for target in ("c", "python"):
        for path in sorted((folder / target).glob("*")):
            if path.is_file():
                yield path.relative_to(folder).as_posix(), path.stat().st_size


def _text(place: Path) -> str | None:
    if not place.is_file():
        return None
    try:
        return place.read_bytes().decode("utf-8")
    except OSError as e:
        raise error(DamagedFile(place.name, (e.strerror or str(e)).lower())) from None
    except UnicodeDecodeError:
        raise error(DamagedFile(place.name, "it is not UTF-8 text")) from None


def _json(folder: Path, name: str) -> Mapping[str, Any] | None:
    text = _text(folder / name)
    if text is None:
        return None
    found = _parsed(name, text)
    if not isinstance(found, dict):
        raise error(DamagedFile(name, "it does not hold a JSON object"))
    return found


def _lines(folder: Path, name: str) -> tuple[Mapping[str, Any], ...] | None:
    text = _text(folder / name)
    if text is None:
        return None
    # What comes after the last newline was being written when the run was stopped.
    whole, _, _ = text.rpartition("\n")
    entries = [_parsed(name, line) for line in whole.splitlines() if line]
    if not all(isinstance(entry, dict) for entry in entries):
        raise error(DamagedFile(name, "not every line of it holds a JSON object"))
    return tuple(entries)


_NO_NUMBERS = {"Infinity": "inf", "-Infinity": "-inf", "NaN": "nan"}
"""As findings have them: text, where JSON has no word."""


def _parsed(name: str, text: str) -> Any:
    try:
        return json.loads(text, parse_constant=_NO_NUMBERS.__getitem__)
    except ValueError as e:
        raise error(DamagedFile(name, f"it is not JSON ({e})")) from None
    except RecursionError:
        raise error(DamagedFile(name, "it is nested too deeply")) from None
