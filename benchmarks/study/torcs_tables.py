"""The paper's Table performance, remade."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchmarks.study.races import FINAL, IMITATED
from benchmarks.study.records import TIMEOUT, Record
from benchmarks.study.rows import TORCS_ROWS
from benchmarks.study.summing import of
from benchmarks.torcs import paper
from benchmarks.torcs.telling import table

HEAD = (
    *("agent", "seed", "lap, s", "reward", "nodes", "Algorithm 1 alone: lap, s", "reward"),
    *("nodes", "core seconds", "paper: lap, s", "reward"),
)
NO_RACE = "Timeout"


def performance(records: Sequence[Record], track: str) -> str:
    """One track's half of the table: a row for each agent and seed."""
    rows = []
    for agent in (row.method for row in TORCS_ROWS):
        for record in of(records, agent, track):
            races = record.figures.get("races", {})
            alone = races.get(IMITATED)
            rows.append(
                [
                    *(agent, "-" if agent == paper.DRL else str(record.seed)),
                    *race(races.get(FINAL)),
                    _text(record.size),
                    *(("-", "-") if agent == paper.DRL else race(alone)),
                    _text(record.figures.get("imitated_size")),
                    "-" if record.core_seconds is None else f"{record.core_seconds:.0f}",
                    *of_paper(agent, track),
                ]
            )
    return table(HEAD, rows)


def race(figures: dict[str, Any] | None) -> tuple[str, str]:
    """Mean lap and reward; where it was not finished, how far it came."""
    if figures is None:
        return NO_RACE, "-"
    if not figures["finished"]:
        return f"{NO_RACE} ({figures['outcome']})", "-"
    return f"{figures['mean_lap']:.2f}", f"{figures['mean_reward']:.2f}"


def of_paper(agent: str, track: str) -> tuple[str, str]:
    known = paper.PERFORMANCE.get((agent, track))
    return (NO_RACE, "-") if known is None else (f"{known.time:.2f}", f"{known.reward:.2f}")


def ahead(records: Sequence[Record], track: str, which: str) -> str:
    """Whether NDPS is ahead of the others: by mean lap, over seeds both have."""
    rows = []
    for agent in (row.method for row in TORCS_ROWS):
        if agent in (paper.DRL, paper.NDPS):
            continue
        pairs = [
            (_lap(ours, which), _lap(theirs, which))
            for ours in of(records, paper.NDPS, track)
            for theirs in of(records, agent, track)
            if ours.seed == theirs.seed
        ]
        if pairs:
            won = sum(_faster(*pair) for pair in pairs)
            shown = "; ".join(f"{_shown(one)} against {_shown(other)}" for one, other in pairs)
            rows.append([agent, shown, f"{won} of {len(pairs)}"])
    return table(("NDPS against", "mean lap of each seed, s", "NDPS ahead"), rows)


def _lap(record: Record, which: str) -> float | None:
    """The mean lap of a race that was completed."""
    figures = record.figures.get("races", {}).get(which)
    return figures["mean_lap"] if figures and figures["finished"] else None


def _faster(one: float | None, other: float | None) -> bool:
    return one is not None and (other is None or one < other)


def _shown(lap: float | None) -> str:
    return NO_RACE if lap is None else f"{lap:.2f}"


def timeouts(records: Sequence[Record]) -> int:
    """How many rows have no program that completes the race."""
    return sum(record.ending == TIMEOUT for record in records)


def _text(value: object) -> str:
    return "-" if value is None else str(value)
