"""Today's alternatives to pirlc: `python -m benchmarks.peers`.

    python -m benchmarks.peers [--method viper] [--environment Pendulum-v1] [--seed 0] [--table]

A method is named as in the records (`viper-8`) or without its size. Rows that are recorded are not
run again; remove a record to have it remade. Oracles are trained if they are not in the cache.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from benchmarks.peers.methods import SUITE, Effort
from benchmarks.peers.running import perform, wanted
from benchmarks.peers.table import comparison, tables
from benchmarks.peers.tasks import EXAMPLES
from benchmarks.study.records import RESULTS, read


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.peers",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--method", nargs="+", default=[], metavar="NAME")
    parser.add_argument("--environment", nargs="+", default=list(EXAMPLES), choices=EXAMPLES)
    parser.add_argument("--seed", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--iterations", type=int, help="of DAgger, instead of 30")
    parser.add_argument("--workers", type=int, default=1, help="processes (default 1)")
    parser.add_argument("--folder", type=Path, default=RESULTS, help="of the records")
    parser.add_argument("--table", action="store_true", help="only print what is recorded")
    given = parser.parse_args()
    effort = Effort()
    if given.iterations is not None:
        effort = replace(effort, dagger=replace(effort.dagger, iterations=given.iterations))
    refused: list[str] = []
    if not given.table:
        chosen = wanted(given.environment, given.seed, given.method)
        refused = perform(chosen, given.folder, effort, given.workers)[1]
    records = read(given.folder, SUITE).records
    print(tables([record for record in records if record.environment in given.environment]))
    own = [
        record
        for record in read(given.folder, "classic").records
        if record.method == "synth" and record.environment in given.environment
    ]
    if beside := comparison(records, own):
        print(f"\n### Trees of at most the size of pirlc's programs\n\n{beside}")
    if refused:
        raise SystemExit("\n".join(refused))


if __name__ == "__main__":
    main()
