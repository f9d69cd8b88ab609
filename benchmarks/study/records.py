"""Records: what each row of the study's tables rests on, one small JSON file for each.

    <folder>/<suite>/<method>-<environment>-<seed>.json

Whoever writes records holds the suite's folder while it does:

    with writing(RESULTS, "peers") as results:
        results.write(record)

The lock is the operating system's and goes with the process that holds it, however that ends.
Records of another schema or another pirlc, and files that are no records, are never mixed with
the others: `read` names them.
"""

from __future__ import annotations

import fcntl
import json
import math
import os
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import pirlc
from pirlc.backend.files import write_text

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "benchmarks" / "results" / "study"

SCHEMA = 1
"""Raised whenever a field changes its meaning."""

EPISODES, FIRST_SEED = 1000, 1_000_000
"""The evaluation that all methods of classic control are compared by."""

COMPLETE, TIMEOUT, NONE = "finished", "timeout", "none"
"""Endings: with a result; with nothing found within the limit; where there is nothing to find. Any
other text says what went wrong."""

LOCK = ".lock"


@dataclass(frozen=True)
class Return:
    """The mean return of episodes (undiscounted) and its 95 % interval."""

    mean: float
    low: float
    high: float
    episodes: int
    first_seed: int


@dataclass(frozen=True)
class Record:
    """One row: a method on an environment with a seed.

    Attributes:
        command: the words that repeat it, from the repository's root.
        returns: None where nothing was found (`"return"` in the file).
        size: nodes as pirlc counts them; None where that makes no sense.
        core_seconds: CPU time of the process and its children, to find it.
        step_nanoseconds: of one decision of the compiled controller.
        code_bytes: of its machine code and constants.
        provable: what can be proved about it, in words.
        distance: to the oracle.
        ending: COMPLETE, TIMEOUT, NONE, or what went wrong.
        program: its text, if it is one that pirlc reads.
        oracle: SHA-256 of the weights that it was made from.
        figures: what a suite has besides: numbers, texts, lists of them.
    """

    suite: str
    method: str
    environment: str
    seed: int
    command: tuple[str, ...]
    returns: Return | None = None
    size: int | None = None
    core_seconds: float | None = None
    wall_seconds: float | None = None
    step_nanoseconds: float | None = None
    code_bytes: int | None = None
    provable: str | None = None
    distance: float | None = None
    ending: str = COMPLETE
    program: str | None = None
    oracle: str | None = None
    figures: Mapping[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Of its file."""
        words = f"{self.method}-{self.environment}-{self.seed}"
        return re.sub(r"[^A-Za-z0-9._+-]+", "_", words) + ".json"


@dataclass(frozen=True)
class LeftOut:
    """A file in a suite's folder that does not count, and why."""

    path: Path
    reason: str


@dataclass(frozen=True)
class Kept:
    """A suite's records, in the order of their file names, and what else is in its folder."""

    records: tuple[Record, ...]
    left_out: tuple[LeftOut, ...]


class Unusable(ValueError):
    """Why a file is no record."""


def as_json(record: Record) -> str:
    """Raises ValueError for a number that is not finite: leave such a field None."""
    data: dict[str, Any] = {"schema": SCHEMA, "pirlc": pirlc.__version__}
    for key, value in asdict(record).items():
        data["return" if key == "returns" else key] = value
    return json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


_TYPES: dict[str, tuple[type, ...]] = {
    "suite": (str,),
    "method": (str,),
    "environment": (str,),
    "seed": (int,),
    "command": (list,),
    "returns": (dict, type(None)),
    "size": (int, type(None)),
    "core_seconds": (float, int, type(None)),
    "wall_seconds": (float, int, type(None)),
    "step_nanoseconds": (float, int, type(None)),
    "code_bytes": (int, type(None)),
    "provable": (str, type(None)),
    "distance": (float, int, type(None)),
    "ending": (str,),
    "program": (str, type(None)),
    "oracle": (str, type(None)),
    "figures": (dict,),
}


def parse(text: str) -> Record:
    """The record in a file's text. Raises Unusable."""
    try:
        data = json.loads(text, parse_constant=_refuse)
    except ValueError as e:
        raise Unusable(f"not JSON ({e})") from None
    if not isinstance(data, dict) or "schema" not in data or "pirlc" not in data:
        raise Unusable("not a record of the study")
    if data["schema"] != SCHEMA:
        raise Unusable(f"written in schema {data['schema']}; this is schema {SCHEMA}")
    if data["pirlc"] != pirlc.__version__:
        raise Unusable(f"made by pirlc {data['pirlc']}; this is pirlc {pirlc.__version__}")
    given = {key: value for key, value in data.items() if key not in ("schema", "pirlc")}
    if "return" in given:
        given["returns"] = given.pop("return")
    for key, types in _TYPES.items():
        if key not in given:
            raise Unusable(f"it has no `{_shown(key)}`")
        if not isinstance(given[key], types) or isinstance(given[key], bool):
            raise Unusable(f"its `{_shown(key)}` is {json.dumps(given[key])}")
    for key in given:
        if key not in _TYPES:
            raise Unusable(f"it has an unknown `{_shown(key)}`")
    found = given["returns"]
    returns = None if found is None else _return(found)
    return Record(**{**given, "returns": returns, "command": tuple(map(str, given["command"]))})


def _return(data: dict[str, Any]) -> Return:
    names = [f.name for f in fields(Return)]
    numbers = all(isinstance(data.get(name), int | float) for name in names)
    if sorted(data) != sorted(names) or not numbers:
        raise Unusable("its `return` has not the five numbers of one")
    return Return(**data)


def _refuse(name: str) -> None:
    raise ValueError(f"{name} is no number in JSON")


def _shown(key: str) -> str:
    return "return" if key == "returns" else key


def read(folder: Path, suite: str) -> Kept:
    """All records of a suite; of a folder that is not there, none."""
    records, left_out = [], []
    place = folder / suite
    for path in sorted(place.glob("*")) if place.is_dir() else ():
        if path.name.startswith("."):
            continue
        if path.suffix != ".json" or not path.is_file():
            left_out.append(LeftOut(path, "not a record of the study"))
            continue
        try:
            record = parse(path.read_text(encoding="utf-8"))
            if record.suite != suite or record.name != path.name:
                raise Unusable(
                    f"it is of {record.suite}/{record.name}, which its place does not say"
                )
        except (OSError, UnicodeDecodeError, Unusable) as e:
            left_out.append(LeftOut(path, str(e)))
            continue
        records.append(record)
    return Kept(tuple(records), tuple(left_out))


def message(left_out: tuple[LeftOut, ...]) -> str:
    """What a user is told about files that do not count; empty if there are none."""
    if not left_out:
        return ""
    lines = [f"{_near(each.path)}: {each.reason}" for each in left_out]
    return "\n".join(
        [
            "left out of all tables:",
            *(f"  {line}" for line in lines),
            "remove these files, or run their rows again, which replaces them",
        ]
    )


def _near(path: Path) -> Path:
    """The path as seen from the repository's root, if it is in it."""
    return path.relative_to(ROOT) if path.is_relative_to(ROOT) else path


class Results:
    """A suite's folder, held for writing."""

    def __init__(self, folder: Path, suite: str) -> None:
        self.folder, self.suite = folder, suite

    def write(self, record: Record) -> Path:
        """Puts a record in the place of the one of its method, environment and seed, at once."""
        if record.suite != self.suite:
            raise ValueError(f"a record of {record.suite} in the folder of {self.suite}")
        return write_text(self.folder / self.suite / record.name, as_json(record))

    def read(self) -> Kept:
        return read(self.folder, self.suite)


@contextmanager
def writing(folder: Path, suite: str) -> Iterator[Results]:
    """Holds a suite's folder. Raises SystemExit if another process does."""
    place = folder / suite
    with held(place):
        yield Results(folder, suite)


@contextmanager
def held(place: Path) -> Iterator[int]:
    """A folder, made if need be, that one process at a time may hold. Raises SystemExit.

    Yields the lock's file descriptor: a process that inherits it goes on holding the folder.
    """
    try:
        place.mkdir(parents=True, exist_ok=True)
        handle = os.open(place / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as e:
        raise SystemExit(f"{place}: cannot be written ({(e.strerror or str(e)).lower()})") from None
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(handle, 1000).decode(errors="replace").strip() or "another process"
            raise SystemExit(
                f"{_near(place)}: {holder} is writing into this folder; "
                "wait for it to end, or write into another folder"
            ) from None
        os.ftruncate(handle, 0)
        words = " ".join([Path(sys.argv[0]).name, *sys.argv[1:]])[:200]
        os.write(handle, f"process {os.getpid()} ({words})".encode())
        yield handle
    finally:
        # Closing gives the lock up. The file stays: were it removed, a process that has it open
        # and one that makes a new one could both hold "the" lock.
        os.close(handle)


def finite(value: float | None, digits: int = 6) -> float | None:
    """A number fit for a record: rounded to significant digits, and None if it is not finite."""
    return None if value is None or not math.isfinite(value) else float(f"{value:.{digits}g}")
