"""The records as Markdown: a table an environment, and the best tree at pirlc's own sizes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import groupby
from statistics import fmean

from benchmarks.peers.tasks import EXAMPLES
from benchmarks.study.records import Record, Return

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


TREES = ("viper", "dagger-tree")
"""The methods that VIPER's name stands for in the comparison."""


def best_within(records: Sequence[Record], environment: str, seed: int, most: int) -> Record | None:
    """The tree with the highest mean return among those of at most so many nodes."""
    fitting = [
        (r.returns.mean, r)
        for r in records
        if (r.environment, r.seed) == (environment, seed)
        and r.method.startswith(TREES)
        and r.size is not None
        and r.size <= most
        and r.returns is not None
    ]
    return max(fitting, key=lambda pair: pair[0], default=(0.0, None))[1]


def verdict(ours: Return, theirs: Return) -> str:
    """Whose interval lies above the other's."""
    if ours.mean == theirs.mean == ours.high == theirs.high:
        return "both at the ceiling"
    if ours.low > theirs.high:
        return "pirlc higher, intervals apart"
    if theirs.low > ours.high:
        return "tree higher, intervals apart"
    return "intervals overlap"


def comparison(peers: Sequence[Record], pirlc: Sequence[Record]) -> str:
    """pirlc's programs beside the best tree of at most their size, environment by environment."""
    rows = []
    for ours in sorted(pirlc, key=lambda r: (list(EXAMPLES).index(r.environment), r.seed)):
        if ours.returns is None or ours.size is None:
            continue
        words = [ours.environment, str(ours.seed), _return(ours), str(ours.size)]
        tree = best_within(peers, ours.environment, ours.seed, ours.size)
        if tree is None or tree.returns is None:
            words += ["none so small", "-", "-", "-"]
        else:
            words += [tree.method, _return(tree), str(tree.size)]
            words.append(verdict(ours.returns, tree.returns))
        rows.append(f"| {' | '.join(words)} |")
    if not rows:
        return ""
    columns = ("environment", "seed", "pirlc", "nodes", "best tree", "return", "nodes", "intervals")
    return "\n".join([f"| {' | '.join(columns)} |", "|---" * len(columns) + "|", *rows])
