"""Lap times and rewards on the tracks trained on: the paper's Table performance.

    python -m benchmarks.torcs.performance

Three laps from standstill, all in the same car: oracles, programs (synthesised, and printed in the
paper), and the robots that come with TORCS, which know the whole track. The reward is the paper's,
the mean of a step. Nothing but TORCS itself ends a race early. "nodes" are those of each action.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.torcs import paper
from benchmarks.torcs.drivers import Driver, oracles, printed, robots, synthesised
from benchmarks.torcs.racing import WHOLE, race
from benchmarks.torcs.telling import (
    as_data,
    ending,
    laps,
    nodes,
    number,
    of_paper,
    racing_parser,
    table,
    tell,
)
from pirlc.simulation.torcs.summary import RaceSummary, summary

HEAD = (
    *("driver", "laps, s", "mean lap, s", "reward", "damage", "largest abs(trackPos)"),
    *("nodes", "ended early", "paper's row", "its lap, s", "its reward"),
)


def field(programs: Path, trained: Path, libraries: Path) -> Iterator[Driver]:
    """All who race."""
    yield from oracles(trained)
    yield from synthesised(programs, libraries, ("noif", "paper"))
    yield from printed(libraries)
    yield from synthesised(programs, libraries, ("racer",))
    yield from robots()


def row(driver: Driver, track: str, figures: RaceSummary) -> tuple[str, ...]:
    rival = driver.rival
    return (
        driver.name,
        laps(figures),
        number(figures.mean_lap, 2),
        number(figures.mean_reward, 2),
        number(figures.damage, 0),
        number(figures.largest_position, 3),
        nodes(driver.nodes),
        ending(figures),
        rival or "-",
        *of_paper(paper.PERFORMANCE.get((rival, track)) if rival else None),
    )


def main(words: list[str] | None = None) -> None:
    chosen = racing_parser("benchmarks.torcs.performance", __doc__).parse_args(words)
    texts, data = [], []
    with TemporaryDirectory(prefix="pirlc-") as libraries:
        drivers = list(field(chosen.programs, chosen.oracles, Path(libraries)))
        for track in paper.TRAINING:
            rows = []
            for driver in drivers:
                if driver.fits(track):
                    figures = summary(race(driver, track, WHOLE, chosen.laps))
                    rows.append(row(driver, track, figures))
                    told = {"track": track, "driver": driver.name, "nodes": driver.nodes}
                    data.append({**told, **as_data(figures)})
            texts.append(f"## {paper.TITLES[track]}\n\n{table(HEAD, rows)}")
    tell("performance", "\n".join(texts), data, chosen.output)


if __name__ == "__main__":
    main()
