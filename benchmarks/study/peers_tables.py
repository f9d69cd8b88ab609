"""pirlc beside the methods that a user would otherwise pick."""

from __future__ import annotations

import re
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
TREES = ("viper", "viper-logits", "dagger-tree")
"""VIPER's trees, and its relatives for oracles without the Q values that its weights want."""
SHOWN = (4, 8, 16, 64)
"""Leaves of the trees that are shown; `python -m benchmarks.peers --table` has all."""

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
            (peers, [name for name in methods(peers, where) if _is_shown(name)]),
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


def stem(method: str) -> str:
    """A peer's name without its size."""
    return re.sub(r"-\d+$", "", method)


def _is_shown(method: str) -> bool:
    return stem(method) not in TREES or int(method.rpartition("-")[2]) in SHOWN


def _trees(ours: Record, peers: Sequence[Record]) -> list[Record]:
    """The trees for the same environment and seed."""
    return [
        r
        for r in peers
        if stem(r.method) in TREES
        and (r.environment, r.seed) == (ours.environment, ours.seed)
        and r.returns is not None
        and r.size is not None
    ]


def at_most(ours: Record, peers: Sequence[Record]) -> Record | None:
    """VIPER's best tree that is not larger than a program of ours."""
    return _best([r for r in _trees(ours, peers) if r.size <= (ours.size or 0)])


def at_least(ours: Record, peers: Sequence[Record]) -> Record | None:
    """VIPER's best tree that is not smaller."""
    return _best([r for r in _trees(ours, peers) if r.size >= (ours.size or 0)])


def _best(trees: list[Record]) -> Record | None:
    return max(trees, key=lambda r: (r.returns.mean, -r.size), default=None)


Rival = Callable[[Record, Sequence[Record]], Record | None]


def against_viper(classic: Sequence[Record], peers: Sequence[Record], rival: Rival) -> str:
    """Each of pirlc's programs beside one of VIPER's trees."""
    rows = []
    for where in ENVIRONMENTS:
        for method in OURS:
            for ours in of(classic, method, where):
                theirs, told = rival(ours, peers), outcome(ours, peers, rival)
                if theirs is not None and told is not None:
                    rows.append(
                        [
                            *(where, str(ours.seed), TITLES[method], interval(ours.returns)),
                            *(str(ours.size), theirs.method, interval(theirs.returns)),
                            *(str(theirs.size), told),
                        ]
                    )
    head = (
        *("environment", "seed", "pirlc's", "return", "nodes", "VIPER's", "return", "nodes"),
        "pirlc's return is",
    )
    return table(head, rows)


def outcome(ours: Record, peers: Sequence[Record], rival: Rival) -> str | None:
    """How a program's return compares; None if there is nothing to compare with."""
    theirs = rival(ours, peers)
    if theirs is None or ours.returns is None or theirs.returns is None:
        return None
    return against(ours.returns, theirs.returns, place(ours.environment).ceiling)


def verdict(classic: Sequence[Record], peers: Sequence[Record]) -> str:
    """The statement against VIPER, environment by environment, in numbers of seeds."""
    rows = []
    for where in ENVIRONMENTS:
        for method in OURS:
            programs = of(classic, method, where)
            cells = [_counted(programs, peers, rival) for rival in (at_least, at_most)]
            if any(cell != "-" for cell in cells):
                rows.append([where, TITLES[method], *cells])
    head = ("environment", "", "VIPER's best of at least as many nodes", "of at most as many")
    return table(head, rows)


def _counted(programs: Sequence[Record], peers: Sequence[Record], rival: Rival) -> str:
    told = [each for ours in programs if (each := outcome(ours, peers, rival)) is not None]
    counts = [f"{each} ({told.count(each)} of {len(told)})" for each in sorted(set(told))]
    return ", ".join(counts) or "-"
