"""Remakes the paper's tables, and puts pirlc beside what people use today.

    python -m benchmarks.study [--suite classic torcs] [--row ROW ...] [--environment NAME ...]
                               [--seed N ...] [--jobs 2] [--folder runs/study] [--table-only]

classic: the paper's Table openai, and its ablations, in classic control. torcs: its Table
performance. Each row is a run of `pirlc synth` with its options (benchmarks/study/rows.py lists
them), one process each. Rows that have a record in benchmarks/results/study are only read,
interrupted runs go on where they were. In the end the tables and plots there are made from all
records, those of the suite `peers` included (python -m benchmarks.peers). A row that fails is told,
the others go on; then the exit code is 1.
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.study import classic, races
from benchmarks.study.classic import Job
from benchmarks.study.driver import Done, Runner, perform, tell
from benchmarks.study.pages import write_pages
from benchmarks.study.records import EPISODES, RESULTS, ROOT, held, message, read, writing
from benchmarks.study.rows import CLASSIC, PLACES, ROWS, SEEDS, TORCS, Lowest, Synthesis

RUNS = ROOT / "runs" / "study"
RUNNERS: dict[str, Runner] = {CLASSIC: classic.run, TORCS: races.run}


def parser() -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(
        prog="python -m benchmarks.study",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    made.add_argument("--suite", nargs="+", choices=tuple(ROWS), default=[CLASSIC])
    made.add_argument("--row", nargs="+", help="rows to run (default: those of the suite)")
    made.add_argument("--environment", nargs="+", help="or tracks (default: those of each row)")
    made.add_argument("--seed", nargs="+", type=int, help="(default: 0 1 2; torcs: 0)")
    made.add_argument("--jobs", type=int, default=2, help="rows run at a time (default: 2)")
    made.add_argument("--folder", type=Path, default=RUNS, help="folder of the runs")
    made.add_argument("--results", type=Path, default=RESULTS, help="folder of the records")
    made.add_argument("--episodes", type=int, help="of the evaluation (default: 1000; torcs: 10)")
    made.add_argument("--table-only", action="store_true", help="only tables and plots")
    made.add_argument("--list", action="store_true", help="only list what would be run")
    made.add_argument("options", nargs="*", help="after --: given to every pirlc synth as well")
    return made


def jobs_of(suite: str, chosen: argparse.Namespace) -> list[Job]:
    """What is asked for. Raises SystemExit for names that the suite does not know."""
    rows = {row.method: row for row in ROWS[suite]}
    places = {place.name: place for place in PLACES[suite]}
    _known("row", chosen.row, suite, rows)
    _known("environment", chosen.environment, suite, places)
    if chosen.episodes is not None and chosen.episodes < 2:
        raise SystemExit("--episodes: at least 2, of which an interval can be told")
    wanted = chosen.row or [row.method for row in ROWS[suite] if row.usual]
    return [
        Job(
            row=rows[method],
            place=places[environment],
            seed=seed,
            folder=chosen.folder.resolve() / suite,
            episodes=chosen.episodes or (EPISODES if suite == CLASSIC else TORCS_EPISODES),
            more=tuple(chosen.options),
        )
        for method in wanted
        for seed in (chosen.seed or SEEDS[suite])
        for environment in (chosen.environment or rows[method].places or places)
        # What does not depend on the seed is run once.
        if isinstance(rows[method], Synthesis) or not _seedless(suite, method, seed, chosen)
    ]


TORCS_EPISODES = 10
"""Fewer than the 50 of `pirlc synth`: what counts here is the race of three laps, and the oracle
and the reference interpreter take as long for fifty episodes as the search does."""


def _seedless(suite: str, method: str, seed: int, chosen: argparse.Namespace) -> bool:
    """Whether the row is the same for every seed and this is not the first one."""
    row = next(row for row in ROWS[suite] if row.method == method)
    first = (chosen.seed or SEEDS[suite])[0]
    return (isinstance(row, Lowest) or suite == TORCS) and seed != first


def _known(kind: str, asked: Sequence[str] | None, suite: str, known: Sequence[str] | dict) -> None:
    for name in asked or ():
        if name not in known:
            raise SystemExit(f"there is no {kind} `{name}` in suite {suite}: {', '.join(known)}")


def run_suite(suite: str, chosen: argparse.Namespace) -> Done:
    jobs = jobs_of(suite, chosen)
    with (
        writing(chosen.results, suite) as results,
        held(chosen.folder.resolve() / suite) as lock,
    ):
        done = perform(jobs, results, RUNNERS[suite], max(1, chosen.jobs), lock)
    tell(f"{suite}: {done.run} rows run, {done.known} known, {len(done.failures)} failed")
    return done


def _leave(number: int, frame: object) -> None:
    del number, frame
    raise KeyboardInterrupt


def main(words: list[str] | None = None) -> int:
    chosen = parser().parse_args(words)
    if chosen.list:
        for suite in chosen.suite:
            for job in jobs_of(suite, chosen):
                row = job.row
                options = " ".join(row.options) if isinstance(row, Synthesis) else "-"
                print(f"{suite}  {job.name}  {options}")
        return 0
    # SIGINT, too: a shell starts what runs in the background with SIGINT ignored, and so would be
    # all that is started from here.
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, _leave)
    failures: list[tuple[str, str]] = []
    if not chosen.table_only:
        for suite in chosen.suite:
            jobs_of(suite, chosen)  # A name that is not known is told before anything is run.
        for suite in chosen.suite:
            try:
                failures += run_suite(suite, chosen).failures
            except KeyboardInterrupt:
                tell("interrupted; the same command goes on from here")
                return 130
    for suite in (CLASSIC, TORCS, "peers"):
        left_out = message(read(chosen.results, suite).left_out)
        if left_out:
            tell(left_out)
    for page in write_pages(chosen.results):
        print(page)
    if failures:
        names = "\n".join(f"  {name}" for name, _ in failures)
        tell(f"failed, for the reasons above; the same command tries again:\n{names}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
