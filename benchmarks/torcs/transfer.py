"""Races on tracks that were not trained on: the paper's two transfer tables.

    python -m benchmarks.torcs.transfer

Three laps from standstill. Trained on CG-Speedway-1: CG track 2 and E-Road. Trained on Aalborg:
Alpine 2 and Ruudskogen. Programs of racer.pirl that were trained on Aalborg also race on all six
tracks. A race ends at a crash, which is told by its distance: the car is beyond 2.7 of the half
width of the road from its middle, is slower than 5 km/h along the road after 500 steps, or faces
backwards. Damage without one of these is told, and does not end a race.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.torcs import paper
from benchmarks.torcs.drivers import Driver, oracles, printed, synthesised
from benchmarks.torcs.racing import UNTIL_CRASH, race
from benchmarks.torcs.telling import as_data, number, of_paper, racing_parser, table, tell
from pirlc.simulation.torcs.protocol import Status
from pirlc.simulation.torcs.summary import RaceSummary, outcome, summary

HEAD = (
    *("driver", "track", "mean lap, s", "reward", "damage", "largest abs(trackPos)"),
    *("paper's row", "its lap, s", "its reward"),
)
HEAD_OF_ALL = ("driver", *paper.TITLES.values())


def finished(figures: RaceSummary) -> bool:
    return figures.status is Status.FINISHED


def result(figures: RaceSummary) -> str:
    """The mean lap, or how the race ended and how far the car came."""
    return number(figures.mean_lap, 2) if finished(figures) else outcome(figures)


def row(driver: Driver, track: str, figures: RaceSummary) -> tuple[str, ...]:
    rival = driver.rival
    return (
        driver.name,
        paper.TITLES[track],
        result(figures),
        number(figures.mean_reward, 2) if finished(figures) else "-",
        number(figures.damage, 0),
        number(figures.largest_position, 3),
        rival or "-",
        *of_paper(paper.TRANSFERRED.get((rival, track)) if rival else None),
    )


def short(figures: RaceSummary) -> str:
    """Result and damage in one cell."""
    hurt = f", damage {figures.damage:,.0f}" if figures.damage > 0 else ""
    return result(figures) + hurt


def main(words: list[str] | None = None) -> None:
    chosen = racing_parser("benchmarks.torcs.transfer", __doc__).parse_args(words)
    texts, data = [], []
    with TemporaryDirectory(prefix="pirlc-") as place:
        libraries = Path(place)
        racers = list(synthesised(chosen.programs, libraries, ("racer",)))
        drivers = [
            *oracles(chosen.oracles),
            *synthesised(chosen.programs, libraries, ("paper",)),
            *printed(libraries),
            *racers,
        ]
        races: dict[tuple[str, str], RaceSummary] = {}

        def raced(driver: Driver, track: str) -> RaceSummary:
            key = driver.name, track
            if key not in races:
                races[key] = summary(race(driver, track, UNTIL_CRASH, chosen.laps))
                told = {"driver": driver.name, "trained_on": driver.trained_on, "track": track}
                data.append({**told, "finished": finished(races[key]), **as_data(races[key])})
            return races[key]

        for trained_on, tracks in paper.TRANSFER.items():
            rows = [
                row(driver, track, raced(driver, track))
                for driver in drivers
                if driver.trained_on == trained_on
                for track in tracks
            ]
            texts.append(f"## Trained on {paper.TITLES[trained_on]}\n\n{table(HEAD, rows)}")
        everywhere = [
            (driver.name, *(short(raced(driver, track)) for track in paper.TITLES))
            for driver in racers
            if driver.trained_on == paper.AALBORG
        ]
    if everywhere:
        title = "## racer.pirl trained on Aalborg alone, on every track: mean lap, s"
        texts.append(f"{title}\n\n{table(HEAD_OF_ALL, everywhere)}")
    tell("transfer", "\n".join(texts), data, chosen.output)


if __name__ == "__main__":
    main()
