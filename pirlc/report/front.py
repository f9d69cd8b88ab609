"""The front of a run: programs to choose from, and their files.

::

    DIR/front.json       the programs with their returns on the same episodes, and what each loses
    DIR/front/<k>.pirl   the k-th, counted from the one with the best return
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from pirlc.backend.files import not_writable, write_text
from pirlc.ir.printer import program_text
from pirlc.report.front_table import table
from pirlc.report.manifest import sha256_of
from pirlc.report.problems import NotOnTheFront, error
from pirlc.report.run import FRONT
from pirlc.search.candidate import Candidate, as_entry
from pirlc.search.front import Front
from pirlc.search.synthesis import Found
from pirlc.simulation.rollout import ReturnEstimate, estimate


def front_data(
    front: Front | None, picked: int | None, *, deterministic: bool
) -> dict[str, Any] | None:
    """The front as plain values for JSON, `program_sha256` being that of the program taken: the
    `picked` one, where there is one of this number, else the search's own. None without a front."""
    if front is None:
        return None
    found = None if picked is None else front.member(picked)
    best, own = front.members[0], front.chosen_number
    return {
        "program_sha256": sha256_of((found or front.chosen).program),
        "episodes": len(best.returns or ()),
        "chosen": own,
        "picked": found and picked,
        "outside": None if own else _row(None, front.chosen, best, deterministic),
        "members": [_row(k, c, best, deterministic) for k, c in enumerate(front.members, start=1)],
    }


def _row(
    place: int | None, member: Candidate, best: Candidate, deterministic: bool
) -> dict[str, Any]:
    returns, highest = np.array(member.returns), np.array(best.returns)
    entry = as_entry(member, "front")
    return {
        "number": place,
        "size": member.size,
        "return": _finite(estimate(returns, deterministic=deterministic)),
        "loss": _finite(estimate(highest - returns, deterministic=deterministic)),
        "sha256": sha256_of(member.program),
        "values": entry["values"],
        "derivations": entry["derivations"],
        "program": program_text(member.program),
    }


def _finite(found: ReturnEstimate) -> dict[str, Any]:
    """Infinite ends of an interval, of which JSON knows nothing, as None."""
    return {k: v if np.isfinite(v) else None for k, v in asdict(found).items()}


def pick(found: Found, front: Front | None, wanted: int | None) -> tuple[Found, int | None]:
    """What was found, with the program that is wanted, and its number. Raises PirlcError E0745.

    Without a front (an interrupted search has none) nothing is picked.
    """
    if wanted is None or front is None:
        return found, None
    member = front.member(wanted)
    if member is None:
        rows = [_row(k, c, front.members[0], False) for k, c in enumerate(front.members, start=1)]
        raise error(NotOnTheFront(wanted, tuple(table(rows))))
    return replace(found, program=member), wanted


def write_front(
    folder: Path,
    data: Mapping[str, Any] | None,
    front: Front | None,
    head: Callable[[Candidate], tuple[str, ...]],
) -> tuple[Path, ...]:
    """Write the front's files, `head` being the comment on a program, and remove an earlier one's.

    Without a front nothing remains. Raises PirlcError E0711, E0712.
    """
    place = folder / "front"
    members = () if front is None else front.members
    names = {f"{k}.pirl": program_text(c.program, head(c)) for k, c in enumerate(members, start=1)}
    stale = [old for old in place.glob("*.pirl") if old.name not in names]
    for old in (folder / FRONT, *stale):
        try:
            old.unlink(missing_ok=True)
        except OSError as e:
            raise not_writable(old, e) from None
    if data is None:
        with suppress(OSError):
            place.rmdir()
        return ()
    table_file = write_text(folder / FRONT, json.dumps(data, indent=1, allow_nan=False) + "\n")
    return (table_file, *(write_text(place / name, text) for name, text in names.items()))
