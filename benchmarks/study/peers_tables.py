"""pirlc beside the methods that a user would otherwise pick."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence

from benchmarks.study import paper
from benchmarks.study.records import Record
from benchmarks.study.rows import place
from benchmarks.study.summing import against, methods, of, pool
from benchmarks.study.tables import ENVIRONMENTS, interval, spread
from benchmarks.torcs.telling import table

OURS = ("NDPS-CasADi", "synth")
"""pirlc's rows: Algorithm 1 alone, and `pirlc synth` with its defaults."""

TITLES = {"NDPS-CasADi": "pirlc, no refinement", "synth": "pirlc", paper.DRL: "the oracle (DRL)"}
VIPER = "VIPER"

HEAD = (
    *("method", "return", "± of these programs", "nodes", "core seconds", "ns a step"),
    *("bytes of code", "proved"),
)


def environment_table(classic: Sequence[Record], peers: Sequence[Record], where: str) -> str:
    """All methods on one environment, the best return first."""
    rows = [
        (record_set, TITLES.get(method, method))
        for records, names in (
            (classic, [*OURS, paper.DRL]),
            (peers, methods(peers, where)),
        )
        for method in names
        if (record_set := of(records, method, where))
    ]
    found = [(_row(title, records), _mean(records)) for records, title in rows]
    found.sort(key=lambda each: -each[1])
    return table(HEAD, [row for row, _ in found])


def _mean(records: Sequence[Record]) -> float:
    known = [r.returns.mean for r in records if r.returns is not None]
    return statistics.fmean(known) if known else -float("inf")


def _row(title: str, records: Sequence[Record]) -> list[str]:
    first = records[0]
    found = pool(records, first.method, first.environment)
    endings = sorted({r.ending for r in records if r.returns is None})
    return [
        title,
        spread(found) if found else ", ".join(endings) or "-",
        f"{found.half:.2f}" if found else "-",
        _sizes(records),
        _average(records, lambda r: r.core_seconds, 0),
        _average(records, lambda r: r.step_nanoseconds, 1),
        _average(records, lambda r: None if r.code_bytes is None else float(r.code_bytes), 0),
        "; ".join(sorted({r.provable for r in records if r.provable})) or "-",
    ]


def _sizes(records: Sequence[Record]) -> str:
    return " ".join(str(r.size) for r in records if r.size is not None) or "-"


def _average(
    records: Sequence[Record], of_one: Callable[[Record], float | None], digits: int
) -> str:
    values = [value for r in records if (value := of_one(r)) is not None]
    return f"{statistics.fmean(values):,.{digits}f}" if values else "-"


def against_viper(classic: Sequence[Record], peers: Sequence[Record]) -> str:
    """Each of pirlc's programs beside VIPER's best tree that is at least as large."""
    rows = []
    for where in ENVIRONMENTS:
        for method in OURS:
            for ours in of(classic, method, where):
                theirs = _rival(ours, peers)
                if theirs is None or ours.returns is None or theirs.returns is None:
                    continue
                verdict = against(ours.returns, theirs.returns, place(where).ceiling)
                rows.append(
                    [
                        *(where, str(ours.seed), TITLES[method], interval(ours.returns)),
                        *(str(ours.size), theirs.method, interval(theirs.returns)),
                        *(str(theirs.size), verdict),
                    ]
                )
    head = (
        *("environment", "seed", "pirlc's", "return", "nodes", "VIPER's", "return", "nodes"),
        "pirlc's return is",
    )
    return table(head, rows)


def _rival(ours: Record, peers: Sequence[Record]) -> Record | None:
    """VIPER's best tree for the same seed among those that are not smaller; if all are smaller,
    the largest."""
    trees = [
        r
        for r in peers
        if r.method.startswith(VIPER)
        and (r.environment, r.seed) == (ours.environment, ours.seed)
        and r.returns is not None
        and r.size is not None
    ]
    if not trees or ours.size is None:
        return None
    enough = [r for r in trees if r.size >= ours.size]
    if enough:
        return max(enough, key=lambda r: r.returns.mean)
    return max(trees, key=lambda r: r.size)


def verdict(classic: Sequence[Record], peers: Sequence[Record]) -> str:
    """The statement against VIPER at equal or smaller size, environment by environment."""
    lines = []
    for where in ENVIRONMENTS:
        words = []
        for method in OURS:
            found = [_outcome(ours, peers) for ours in of(classic, method, where)]
            told = [each for each in found if each is not None]
            if told:
                counted = ", ".join(
                    f"{told.count(each)} {each}" for each in dict.fromkeys(sorted(told))
                )
                words.append(f"{TITLES[method]}: {counted}")
        if words:
            lines.append(f"- {where}: {'; '.join(words)}\n")
    return "".join(lines)


def _outcome(ours: Record, peers: Sequence[Record]) -> str | None:
    theirs = _rival(ours, peers)
    if theirs is None or ours.returns is None or theirs.returns is None:
        return None
    told = against(ours.returns, theirs.returns, place(ours.environment).ceiling)
    smaller = theirs.size is not None and ours.size is not None and theirs.size < ours.size
    return f"{told} (all its trees are smaller)" if smaller else told
