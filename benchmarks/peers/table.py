"""The records as Markdown: a table an environment, and the best tree at pirlc's own sizes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import groupby
from statistics import fmean

from benchmarks.peers.tasks import EXAMPLES
from benchmarks.study.records import Record

_COLUMNS = (
    "method",
    "return, seeds 0, 1, 2",
    "nodes",
    "core s",
    "ns a step",
    "bytes",
    "provable",
)


def tables(records: Sequence[Record]) -> str:
    parts = []
    for environment in EXAMPLES:
        mine = sorted((r for r in records if r.environment == environment), key=_order)
        if not mine:
            continue
        rows = [_row(list(group)) for _, group in groupby(mine, key=lambda r: r.method)]
        head = [f"| {' | '.join(_COLUMNS)} |", "|---" * len(_COLUMNS) + "|"]
        parts.append("\n".join([f"### {environment}", "", *head, *rows]))
    return "\n\n".join(parts)


def _order(record: Record) -> tuple[str, int, str, int]:
    """Methods by name, their sizes by number."""
    number = re.search(r"-(\d+)$", record.method)
    stem = record.method[: number.start()] if number else record.method
    return stem, int(number[1]) if number else 0, record.method, record.seed


def _row(group: Sequence[Record]) -> str:
    cells = [
        group[0].method,
        " ".join(_return(r) for r in group),
        " ".join("-" if r.size is None else str(r.size) for r in group),
        _mean([r.core_seconds for r in group], ".1f"),
        _mean([r.step_nanoseconds for r in group], ".1f"),
        _mean([r.code_bytes for r in group], ".0f"),
        _provable(group),
    ]
    return f"| {' | '.join(cells)} |"


def _return(record: Record) -> str:
    found = record.returns
    if found is None:
        return record.ending
    return f"{found.mean:.2f}±{found.high - found.mean:.2f}"


def _mean(values: Sequence[float | None], form: str) -> str:
    known = [value for value in values if value is not None]
    return format(fmean(known), form) if known else "-"


def _provable(group: Sequence[Record]) -> str:
    """The words of each seed, once where they agree."""
    return " / ".join(dict.fromkeys(r.provable or "-" for r in group))


def best_within(records: Sequence[Record], environment: str, most: int) -> Record | None:
    """The record with the highest mean return among those of at most so many nodes."""
    fitting = [
        r
        for r in records
        if r.environment == environment
        and r.size is not None
        and r.size <= most
        and r.returns is not None
    ]
    return max(fitting, key=lambda r: r.returns.mean if r.returns else 0.0, default=None)
