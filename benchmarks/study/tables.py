"""The tables of classic control, in Markdown, from records alone."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from benchmarks.study import paper
from benchmarks.study.records import COMPLETE, TIMEOUT, Record, Return
from benchmarks.study.rows import CLASSIC_PLACES, CLASSIC_ROWS, REFINED
from benchmarks.study.summing import Pooled, of, pool
from benchmarks.torcs.telling import table

Records = Sequence[Record]

ENVIRONMENTS = tuple(place.name for place in CLASSIC_PLACES)
OPENAI = (paper.DRL, "NDPS-CasADi", paper.SMT, paper.BOPT, paper.MINIMUM)
ABLATIONS = ("NDPS-CasADi", "Naive", "NoAug", "NoSketch", "NoIF")
ORDER = ((paper.DRL, paper.SMT), (paper.SMT, paper.BOPT), (paper.BOPT, paper.MINIMUM))
"""Who is ahead of whom in all columns of the paper's table."""


def interval(found: Return | None) -> str:
    if found is None:
        return "-"
    return f"{found.mean:.2f} ± {(found.high - found.low) / 2:.2f}"


def spread(found: Pooled | None) -> str:
    """The mean over seeds, and the seeds' own."""
    if found is None:
        return "-"
    if found.seeds == 1:
        return f"{found.mean:.2f}"
    return f"{found.mean:.2f} ({found.least:.2f} to {found.most:.2f})"


def cell(records: Records, method: str, environment: str) -> str:
    """A row's return on an environment; how it ended where it has none."""
    found = pool(records, method, environment)
    endings = sorted({r.ending for r in of(records, method, environment) if r.returns is None})
    return ", ".join([*([spread(found)] if found else []), *endings]) or "-"


def openai(records: Records) -> str:
    """Table openai before refinement, the paper's figures beside it."""
    head = ["", *(title for name in ENVIRONMENTS for title in _titles(name))]
    rows = []
    for method in OPENAI:
        row = [method]
        for name in ENVIRONMENTS:
            row.append(cell(records, method, name))
            if name in paper.ENVIRONMENTS:
                row.append(_number(paper.RETURNS.get((method, name))))
        rows.append(row)
    return table(head, rows)


def _titles(environment: str) -> list[str]:
    return [environment, "paper"] if environment in paper.ENVIRONMENTS else [environment]


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def bars(records: Records) -> str:
    """Whether each row reaches what it has to, before refinement."""
    rows = []
    for method in OPENAI:
        for name in paper.ENVIRONMENTS:
            wanted, found = paper.bar(method, name), pool(records, method, name)
            if wanted is None:
                continue
            seeds = [interval(r.returns) for r in of(records, method, name)]
            rows.append(
                [
                    *(method, name, f"{wanted:.2f}", spread(found), "; ".join(seeds) or "-"),
                    "-" if found is None else ("yes" if found.mean >= wanted else "no"),
                ]
            )
    return table(("row", "environment", "bar", "mean over seeds", "each seed", "reached"), rows)


def ordering(records: Records) -> str:
    """The paper's ordering, pair by pair, on the paper's environments."""
    rows = []
    for ahead, behind in ORDER:
        for name in paper.ENVIRONMENTS:
            one, other = pool(records, ahead, name), pool(records, behind, name)
            theirs = f"{paper.RETURNS[ahead, name]:.2f} > {paper.RETURNS[behind, name]:.2f}"
            rows.append([f"{ahead} ahead of {behind}", name, theirs, *_compared(one, other)])
    return table(("ordering", "environment", "paper", "here", "holds"), rows)


def _compared(one: Pooled | None, other: Pooled | None) -> tuple[str, str]:
    if one is None or other is None:
        return "-", "-"
    shown = f"{one.mean:.2f} ± {one.half:.2f}, {other.mean:.2f} ± {other.half:.2f}"
    if one.low > other.high:
        return shown, "yes"
    if one.high < other.low:
        return shown, "no, reversed"
    return shown, "no difference"


def ablations(records: Records, refined: bool) -> str:
    """What each part of the algorithm is worth, without or with refinement on return."""
    rows = []
    for method in ABLATIONS:
        whole = method == ABLATIONS[0]
        name = ("synth" if whole else method + REFINED) if refined else method
        title = ("pirlc synth" if refined else "NDPS (CasADi)") if whole else method
        if whole or of_any(records, name):
            rows.append([title, *(cell(records, name, where) for where in ENVIRONMENTS)])
    return table(("", *ENVIRONMENTS), rows)


def of_any(records: Records, method: str) -> bool:
    return any(record.method == method for record in records)


def costs(records: Records) -> str:
    """Core seconds and sizes, mean over seeds."""
    known = [row.method for row in CLASSIC_ROWS if of_any(records, row.method)]
    rows = []
    for method in known:
        cells = []
        for where in ENVIRONMENTS:
            found = of(records, method, where)
            times = [r.core_seconds for r in found if r.core_seconds is not None]
            sizes = [r.size for r in found if r.size is not None]
            time = f"{statistics.fmean(times):.0f}" if times else "-"
            size = " ".join(map(str, sizes)) or "-"
            cells.append(f"{time} / {size}")
        if any(each != "- / -" for each in cells):
            rows.append([method, *cells])
    return table(("core seconds / nodes of each seed", *ENVIRONMENTS), rows)


def defaults(records: Records) -> str:
    """`pirlc synth` with nothing but its defaults: the result, and Algorithm 1's alone."""
    head = (
        *("environment", "seed", "program", "nodes", "without refinement", "nodes", "oracle"),
        *("core seconds",),
    )
    rows = []
    for where in ENVIRONMENTS:
        for record in of(records, "synth", where):
            oracle = [r for r in of(records, paper.DRL, where) if r.oracle == record.oracle]
            alone = record.figures.get("without_refinement")
            before = Return(*alone, 0, 0) if alone else None
            rows.append(
                [
                    *(where, str(record.seed), interval(record.returns), str(record.size)),
                    interval(before),
                    str(record.figures.get("without_refinement_size", "-")),
                    interval(oracle[0].returns) if oracle else "-",
                    seconds(record.core_seconds),
                ]
            )
    return table(head, rows)


def choices(records: Records) -> str:
    """Which optimiser `pirlc synth` chose by its own measurements."""
    rows = []
    for where in ENVIRONMENTS:
        for record in of(records, "synth", where):
            found = record.figures.get("optimizer")
            if found is not None:
                means = found["mean_distances"].items()
                measured = ", ".join(f"{name} {mean:.4f}" for name, mean in means)
                chosen = (found["chosen"], found["why"], measured or "-")
                rows.append([where, str(record.seed), *chosen])
    head = ("environment", "seed", "optimiser", "why", "mean distances measured")
    return table(head, rows) if rows else ""


def seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.0f}"


def each(records: Records) -> str:
    """Every row, with its interval."""
    head = ("environment", "row", "seed", "return", "nodes", "distance", "core seconds", "ending")
    order = {row.method: number for number, row in enumerate(CLASSIC_ROWS)}
    rows = [
        [
            *(r.environment, r.method, str(r.seed), interval(r.returns), _text(r.size)),
            "-" if r.distance is None else f"{r.distance:.4f}",
            seconds(r.core_seconds),
            "-" if r.ending == COMPLETE else r.ending,
        ]
        for r in sorted(
            records,
            key=lambda r: (
                ENVIRONMENTS.index(r.environment) if r.environment in ENVIRONMENTS else 99,
                order.get(r.method, 99),
                r.seed,
            ),
        )
    ]
    return table(head, rows)


def _text(value: object) -> str:
    return "-" if value is None else str(value)


def imitation(records: Records) -> str:
    """Does imitation predict return? Spearman's rank correlation of distance and return."""
    rows = []
    for where in ENVIRONMENTS:
        found = [
            (r.figures["rank_correlation"], len(r.figures["pairs"]))
            for r in records
            if r.environment == where
            and r.method in OPENAI
            and r.figures.get("rank_correlation") is not None
        ]
        if found:
            values = [value for value, _ in found]
            programs = sum(count for _, count in found)
            rows.append(
                [
                    *(where, str(len(found)), str(programs), f"{statistics.median(values):.2f}"),
                    f"{min(values):.2f} to {max(values):.2f}",
                ]
            )
    head = ("environment", "runs", "programs", "median rank correlation", "least to most")
    return table(head, rows)


def timeouts(records: Records) -> str:
    """Rows that found nothing."""
    found = [r for r in records if r.ending == TIMEOUT]
    return "".join(f"- {r.method}, {r.environment}, seed {r.seed}\n" for r in found)
