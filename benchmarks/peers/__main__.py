"""Today's alternatives to pirlc: `python -m benchmarks.peers`.

    python -m benchmarks.peers [--method viper] [--environment Pendulum-v1] [--seed 0] [--table]

A method is named as in the records (`viper-8`) or without its size. Rows that are recorded are not
run again; remove a record to have it remade. Oracles are trained if they are not in the cache.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path

from benchmarks.peers.methods import LEAVES, SUITE, Effort, Job, jobs, run
from benchmarks.peers.table import tables
from benchmarks.peers.tasks import EXAMPLES
from benchmarks.study.records import COMPLETE, RESULTS, Record, message, read, writing


def wanted(environments: Sequence[str], seeds: Sequence[int], methods: Sequence[str]) -> list[Job]:
    """The jobs that are asked for, cheap environments first. Raises SystemExit for an unknown
    method; one that an environment does not have is tried, to say why."""
    found: list[Job] = []
    for seed in seeds:
        for environment in environments:
            known = jobs(environment, seed)
            for method in methods or [""]:
                fitting = [j for j in known if method in ("", j.name, j.method)]
                found += fitting or _tried(method, environment, seed)
    return list(dict.fromkeys(found))


def _tried(name: str, environment: str, seed: int) -> list[Job]:
    words = name.split("-")
    number = int(words[-1]) if words[-1].isdigit() else None
    method = "-".join(words[:-1]) if number is not None else name
    if method in ("viper", "dagger-tree"):
        numbers = LEAVES if number is None else (number,)
        own = next((j for j in jobs(environment, seed) if j.method == method), None)
        algorithm = None if own is None else own.algorithm
        return [Job(method, environment, seed, n, algorithm) for n in numbers]
    if method == "symbolic" and number is not None:
        return [Job(method, environment, seed, number)]
    if number is None and method == "cma-argmax":
        return [Job(method, environment, seed)]
    raise SystemExit(f"there is no method {name}; see docs/peers.md")


def perform(
    chosen: Sequence[Job], folder: Path, effort: Effort, workers: int = 1
) -> tuple[list[Record], list[str]]:
    """Run what is not recorded yet, record it, and say what was refused."""
    made: list[Record] = []
    refused: list[str] = []
    with writing(folder, SUITE) as results:
        kept = results.read()
        print(message(kept.left_out), file=sys.stderr, end="\n" if kept.left_out else "")
        done = {(r.method, r.environment, r.seed) for r in kept.records if r.ending == COMPLETE}
        left = [j for j in chosen if (j.name, j.environment, j.seed) not in done]
        print(f"{len(chosen) - len(left)} recorded, {len(left)} to run", file=sys.stderr)

        def take(record: Record) -> None:
            results.write(record)
            made.append(record)
            mean = "-" if record.returns is None else f"{record.returns.mean:.2f}"
            place = f"{record.method} {record.environment} {record.seed}"
            print(f"{len(made)}/{len(left)} {place}: {mean}", file=sys.stderr, flush=True)

        if workers <= 1:
            for job in left:
                try:
                    take(run(job, effort))
                except SystemExit as refusal:
                    refused.append(str(refusal))
            return made, list(dict.fromkeys(refused))
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(workers, mp_context=context) as pool:
            for future in as_completed([pool.submit(_alone, job, effort) for job in left]):
                answer = future.result()
                if isinstance(answer, str):
                    refused.append(answer)
                else:
                    take(answer)
    return made, list(dict.fromkeys(refused))


def _alone(job: Job, effort: Effort) -> Record | str:
    """In a process of its own: on one thread, a refusal as a value."""
    from threadpoolctl import threadpool_limits

    try:
        with threadpool_limits(1):
            return run(job, effort)
    except SystemExit as refusal:
        return str(refusal)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    parser.add_argument("--method", nargs="+", default=[], metavar="NAME")
    parser.add_argument("--environment", nargs="+", default=list(EXAMPLES), choices=EXAMPLES)
    parser.add_argument("--seed", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--iterations", type=int, help="of DAgger, instead of 40")
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
    print(
        tables([r for r in read(given.folder, SUITE).records if r.environment in given.environment])
    )
    if refused:
        raise SystemExit("\n".join(refused))


if __name__ == "__main__":
    main()
