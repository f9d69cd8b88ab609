"""How far drivers come with blocked sensors: the paper's Table partial and its figure.

    python -m benchmarks.torcs.robustness [--races 100] [--blocked rpm,trackPos] [--holding]

In each step each of the sensors is missing with the given probability. A race of three laps counts
until the car crashes: it hits something (its damage grows), is beyond 2.7 of the half width of the
road from its middle, is slower than 5 km/h along the road after 500 steps, or faces backwards. The
paper says no more than "before crashing". That its car's middle leaves the road cannot be meant: on
Aalborg the program that it prints does so in every lap, with nothing blocked. The distance until
then is given as well.

What is missing is NaN. A program holds the last good reading unless its file says otherwise, as
these do not; a network sees 0. --holding adds rows of networks with the programs' rule.

The outcomes of races are kept in a journal, runs/torcs/robustness.jsonl: an interrupted command
goes on from there, and another driver costs its own races alone.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.torcs import paper
from benchmarks.torcs.drivers import (
    ROOT,
    CompiledProgram,
    Driver,
    Network,
    oracles,
    printed,
    synthesised,
)
from benchmarks.torcs.racing import (
    UNTIL_CRASH,
    crashed,
    distance_on_road,
    distance_to_crash,
    race,
)
from benchmarks.torcs.telling import racing_parser, save, table, tell
from pirlc.simulation.rollout import ReturnEstimate, estimate
from pirlc.simulation.workers import Workers, parallel_map

PROBABILITIES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)

JOURNAL = ROOT / "runs" / "torcs" / "robustness.jsonl"

OWN = "own"
"""Instead of names of readings: those that the program has sensors for."""

_PIECE = 10
"""Races that a worker does at a time."""

_ROUND = 20
"""Pieces after which the journal is written: what an interruption may lose."""


@dataclass(frozen=True)
class Work:
    """Races with these seeds."""

    driver: Driver
    track: str
    blocked: tuple[str, ...]
    probability: float
    laps: int
    seeds: tuple[int, ...]

    @property
    def key(self) -> str:
        """What the outcomes depend on."""
        held = isinstance(self.driver.wheel, Network) and self.driver.wheel.held
        who = self.driver.digest + (" holding" if held else "")
        what = f"{self.track} {self.laps} {','.join(self.blocked)} {self.probability}"
        return f"{who} {what} {self.seeds[0]}-{self.seeds[-1]}"


@dataclass(frozen=True)
class Outcome:
    """Of one race, in m."""

    to_crash: float
    on_road: float
    crashed: bool


@dataclass(frozen=True)
class Point:
    """All races of a driver at a probability."""

    to_crash: ReturnEstimate
    on_road: ReturnEstimate
    finished: float


def run(work: Work) -> list[Outcome]:
    outcomes = []
    for seed in work.seeds:
        blocking = replace(
            UNTIL_CRASH, blocked=work.blocked, block_probability=work.probability, seed=seed
        )
        trace = race(work.driver, work.track, blocking, work.laps)
        outcomes.append(Outcome(distance_to_crash(trace), distance_on_road(trace), crashed(trace)))
    return outcomes


def blocked_for(driver: Driver, wish: str) -> tuple[str, ...]:
    if wish == OWN and isinstance(driver.wheel, CompiledProgram):
        return driver.wheel.reads
    return ("rpm", "trackPos") if wish == OWN else tuple(wish.split(","))


def plan(
    driver: Driver, track: str, wish: str, probabilities: Sequence[float], races: int, laps: int
) -> list[Work]:
    """Without blocking all races are the same race."""
    work = partial(Work, driver, track, blocked_for(driver, wish))
    return [
        work(probability, laps, tuple(range(first, min(first + _PIECE, count))))
        for probability in probabilities
        for count in [races if probability > 0.0 else 1]
        for first in range(0, count, _PIECE)
    ]


def run_all(works: Sequence[Work], workers: int, journal: Path) -> list[list[Outcome]]:
    """The outcomes of each; those that are in the journal are taken from it, others added to it."""
    known: dict[str, list[Outcome]] = {}
    if journal.exists():
        for line in journal.read_text(encoding="utf-8").splitlines():
            entry = json.loads(line)
            known[entry["key"]] = [Outcome(*outcome) for outcome in entry["outcomes"]]
    journal.parent.mkdir(parents=True, exist_ok=True)
    ahead = [work for work in works if work.key not in known]
    with journal.open("a", encoding="utf-8") as file:
        for first in range(0, len(ahead), _ROUND):
            some = ahead[first : first + _ROUND]
            for work, outcomes in zip(some, parallel_map(run, some, Workers(workers)), strict=True):
                known[work.key] = outcomes
                entry = {"key": work.key, "outcomes": [astuple(o) for o in outcomes]}
                file.write(json.dumps(entry) + "\n")
            file.flush()
            print(f"{first + len(some):,} of {len(ahead):,}", file=sys.stderr, flush=True)
    return [known[work.key] for work in works]


def points(
    works: Sequence[Work], workers: int, journal: Path
) -> dict[tuple[str, str], dict[float, Point]]:
    """By driver and track, and by probability."""
    races: dict[tuple[str, str], dict[float, list[Outcome]]] = {}
    for work, outcomes in zip(works, run_all(works, workers, journal), strict=True):
        of_driver = races.setdefault((work.driver.name, work.track), {})
        of_driver.setdefault(work.probability, []).extend(outcomes)
    return {
        key: {probability: _point(probability, found) for probability, found in each.items()}
        for key, each in races.items()
    }


def _point(probability: float, outcomes: Sequence[Outcome]) -> Point:
    same = probability == 0.0
    return Point(
        estimate(np.array([o.to_crash for o in outcomes]), deterministic=same),
        estimate(np.array([o.on_road for o in outcomes]), deterministic=same),
        sum(not o.crashed for o in outcomes) / len(outcomes),
    )


def cell(point: Point) -> str:
    if point.finished == 1.0:
        return "finished"
    return _distance(point.to_crash)


def _distance(found: ReturnEstimate) -> str:
    if found.exact:
        return f"{found.mean:,.0f}"
    return f"{found.mean:,.0f} ± {(found.high - found.low) / 2:,.0f}"


def rows_of_distances(
    track: str, found: dict[str, dict[float, Point]]
) -> tuple[Sequence[str], list[list[str]]]:
    """Distance to the crash by driver and probability, and the paper's."""
    probabilities = sorted({p for each in found.values() for p in each})
    head = ["distance to the crash, m", *(f"{p:.0%}" for p in probabilities)]
    rows = [[name, *(cell(each[p]) for p in probabilities)] for name, each in found.items()]
    for (rival, where), known in paper.BLOCKED.items():
        if where == track:
            cells = (f"{known[p]:,.0f}" if p in known else "" for p in probabilities)
            rows.append([f"the paper's {rival}", *cells])
    return head, rows


def rows_on_road(found: dict[str, dict[float, Point]]) -> tuple[Sequence[str], list[list[str]]]:
    probabilities = sorted({p for each in found.values() for p in each})
    head = ["distance on the road, m", *(f"{p:.0%}" for p in probabilities)]
    rows = [
        [name, *(_distance(each[p].on_road) for p in probabilities)] for name, each in found.items()
    ]
    return head, rows


def plot(by_track: dict[str, dict[str, dict[float, Point]]], to: Path) -> Path:
    """The distance to the crash by probability, a panel a track; bands are 95 % intervals."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 4.2 * len(by_track)), layout="constrained")
    panels = figure.subplots(len(by_track), 1, squeeze=False)[:, 0]
    for axes, (track, found) in zip(panels, by_track.items(), strict=True):
        for name, each in found.items():
            at = sorted(each)
            means = [each[p].to_crash.mean for p in at]
            style = "--" if name.startswith("oracle") else "-"
            (line,) = axes.plot(at, means, style, marker="o", markersize=3, label=name)
            low = [each[p].to_crash.low for p in at]
            high = [each[p].to_crash.high for p in at]
            axes.fill_between(at, low, high, color=line.get_color(), alpha=0.2)
        for (rival, where), known in paper.BLOCKED.items():
            if where == track:
                marker = "x" if rival == paper.DRL else "*"
                label = f"the paper's {rival}"
                at, metres = list(known), list(known.values())
                axes.scatter(at, metres, marker=marker, s=60, color="black", zorder=3, label=label)
        axes.set_title(paper.TITLES[track])
        axes.set_xlabel("probability that a reading is blocked")
        axes.set_ylabel("distance to the crash (m)")
        axes.grid(alpha=0.3)
        axes.legend(fontsize="x-small")
    return save(figure, to)


def main(words: list[str] | None = None) -> None:
    parser = racing_parser("benchmarks.torcs.robustness", __doc__)
    parser.add_argument("--races", type=int, default=100, help="seeds for each probability")
    parser.add_argument("--blocked", default="rpm,trackPos", help="readings, or `own`")
    parser.add_argument("--probabilities", type=float, nargs="+", default=list(PROBABILITIES))
    parser.add_argument("--tracks", nargs="+", default=list(paper.TRAINING), choices=paper.TRAINING)
    parser.add_argument("--holding", action="store_true", help="oracles that hold readings as well")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--journal", type=Path, default=JOURNAL, help="races that were done")
    chosen = parser.parse_args(words)
    with TemporaryDirectory(prefix="pirlc-") as place:
        libraries = Path(place)
        drivers = [
            *oracles(chosen.oracles),
            *(oracles(chosen.oracles, held=True) if chosen.holding else ()),
            *synthesised(chosen.programs, libraries, ("paper",)),
            *printed(libraries),
            *synthesised(chosen.programs, libraries, ("racer",)),
        ]
        wish = chosen.blocked, chosen.probabilities, chosen.races, chosen.laps
        works = [
            work
            for track in chosen.tracks
            for driver in drivers
            if driver.fits(track)
            for work in plan(driver, track, *wish)
        ]
        found = points(works, chosen.workers, chosen.journal)
    by_track = {
        track: {name: each for (name, where), each in found.items() if where == track}
        for track in chosen.tracks
    }
    texts = [
        f"## {paper.TITLES[track]}\n\n{table(*rows_of_distances(track, each))}\n"
        f"{table(*rows_on_road(each))}"
        for track, each in by_track.items()
    ]
    head = f"Mean of {chosen.races} races with its 95 % interval; blocked: {chosen.blocked}.\n"
    data = [
        {
            "track": track,
            "driver": name,
            "blocked": chosen.blocked,
            "probability": probability,
            "races": point.to_crash.episodes,
            "finished": point.finished,
            "to_crash": [point.to_crash.mean, point.to_crash.low, point.to_crash.high],
            "on_road": [point.on_road.mean, point.on_road.low, point.on_road.high],
        }
        for (name, track), each in found.items()
        for probability, point in sorted(each.items())
    ]
    stem = "robustness-own" if chosen.blocked == OWN else "robustness"
    tell(stem, "\n".join([head, *texts]), data, chosen.output)
    plot(by_track, chosen.output / f"{stem}.png")


if __name__ == "__main__":
    main()
