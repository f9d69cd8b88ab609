"""Which rows are asked for, and running those that are not recorded yet."""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from benchmarks.peers.methods import LEAVES, SUITE, Effort, Job, jobs, run
from benchmarks.study.records import COMPLETE, Record, message, writing


def wanted(environments: Sequence[str], seeds: Sequence[int], methods: Sequence[str]) -> list[Job]:
    """The jobs that are asked for, cheap environments first. Raises SystemExit for an unknown
    method; one that an environment does not have is tried, to say why."""
    found: list[Job] = []
    for seed in seeds:
        for environment in environments:
            known = jobs(environment, seed)
            for method in methods or [""]:
                exact = [j for j in known if j.name == method]
                fitting = exact or [j for j in known if method in ("", j.method)]
                found += fitting or _tried(method, environment, seed)
    return list(dict.fromkeys(found))


def _tried(name: str, environment: str, seed: int) -> list[Job]:
    words = name.split("-")
    number = int(words[-1]) if words[-1].isdigit() else None
    method = "-".join(words[:-1]) if number is not None else name
    if method in ("viper", "viper-logits", "dagger-tree"):
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
                try:
                    answer = future.result()
                except BrokenProcessPool:
                    raise SystemExit(
                        "a worker died; what is recorded stays: run the same command again"
                    ) from None
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
