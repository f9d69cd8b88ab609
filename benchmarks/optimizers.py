"""The optimisers of a template's parameters side by side, on the same templates and histories.

    python -m benchmarks.optimizers [--examples cartpole ...] [--templates 12] [--trials 200]

For each example the oracle is trained (or found in the cache), its histories are those that a
search begins with, and templates are taken from the pool of `initialize`, spread over its sizes.
Each optimiser tunes every template that it can take. Times are CPU seconds of this one process, so
that they mean something on a busy machine. Writes benchmarks/results/optimizers.json and .md.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import mean
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pirlc.tune import Tuning, TuningProblem

# Before any of the libraries is loaded: more threads only slow matrices of this size down.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

EXAMPLES = ("cartpole", "mountain_car", "acrobot", "pendulum")
OPTIMIZERS = ("casadi", "bayes", "smt")
RESULTS = Path("benchmarks/results")


@dataclass(frozen=True)
class Row:
    """A template, with distances and CPU seconds by optimiser; or none."""

    environment: str
    template: int
    size: int
    parameters: int
    distances: dict[str, float]
    seconds: dict[str, float]


@dataclass(frozen=True)
class Summary:
    """Two optimisers over the templates that both can take, in one environment or in all."""

    environment: str
    optimizers: tuple[str, str]
    templates: int
    means: tuple[float, float]
    largest_excess: float
    seconds: tuple[float, float]

    @property
    def ratio(self) -> float:
        """The time of the first, in units of that of the second."""
        return self.seconds[0] / self.seconds[1]


def problems_of(example: str, seed: int, count: int) -> tuple[str, list[tuple[int, TuningProblem]]]:
    """The environment, and templates of the pool with their numbers in it, shortest first."""
    from pirlc.frontend import parse_sketch
    from pirlc.oracle.store import default_cache
    from pirlc.oracle.train import plan, train_or_load
    from pirlc.search.context import Search
    from pirlc.search.imitation import create_histories
    from pirlc.search.journal import Budget, Journal
    from pirlc.search.ndps import first_templates
    from pirlc.search.neighbourhood import Neighbour
    from pirlc.search.settings import Settings
    from pirlc.simulation.environments import facts
    from pirlc.simulation.workers import ALONE
    from pirlc.source import SourceText

    place = Path("examples") / example / f"{example}.pirl"
    sketch = parse_sketch(SourceText(str(place), place.read_text(encoding="utf-8")))
    environment = sketch.interface.environment
    assert environment is not None
    search = Search(
        sketch,
        environment,
        Settings(seed=seed),
        Journal(None, Budget()),
        ALONE,
        lambda _: None,
        lambda *_: None,
    )
    training = plan(environment, facts(environment), algorithm=None, seed=seed, overrides={})
    oracle = train_or_load(training, default_cache(), lambda _: None).oracle
    objective = create_histories(search, oracle)
    pool = [(i, e) for i, e in enumerate(first_templates(search), 1) if e.template.free]
    chosen = [pool[i] for i in spread(len(pool), count)]
    problems = objective.problems(search, [Neighbour(e, ()) for _, e in chosen])
    numbered = [(i, p) for (i, _), p in zip(chosen, problems, strict=True)]
    return environment.id, numbered


def spread(total: int, count: int) -> list[int]:
    """At most `count` places of so many, evenly apart, the first and the last among them."""
    if total <= count:
        return list(range(total))
    if count == 1:
        return [total // 2]
    return [i * (total - 1) // (count - 1) for i in range(count)]


def compare(
    environment: str, number: int, problem: TuningProblem, seed: int, hows: Sequence[Tuning]
) -> Row:
    """Every optimiser that can take the template, one after the other."""
    from pirlc.tune import tune_apart, unsuitable

    distances: dict[str, float] = {}
    seconds: dict[str, float] = {}
    for how in hows:
        if unsuitable(problem.template, how.optimizer) is None:
            began = time.process_time()
            distances[how.optimizer.value] = tune_apart(problem, seed, how).distance
            seconds[how.optimizer.value] = time.process_time() - began
    size, parameters = problem.template.size, len(problem.names)
    return Row(environment, number, size, parameters, distances, seconds)


def warmed_up(problem: TuningProblem, hows: Sequence[Tuning]) -> None:
    """Libraries load when they are first used; that is no part of an optimiser's time."""
    from dataclasses import replace

    from pirlc.tune import tune_apart, unsuitable

    few = replace(
        problem, histories=problem.histories.select(range(50)), labels=problem.labels[:50]
    )
    for how in hows:
        if unsuitable(problem.template, how.optimizer) is None:
            tune_apart(few, 0, replace(how, trials=12, effort=100_000))


def summaries(rows: Sequence[Row]) -> Iterator[Summary]:
    """CasADi beside each of the others, by environment and over all."""
    environments = list(dict.fromkeys(row.environment for row in rows))
    for other in OPTIMIZERS[1:]:
        for environment in (*environments, "all"):
            both = [
                row
                for row in rows
                if environment in (row.environment, "all")
                and {"casadi", other} <= row.distances.keys()
            ]
            if both:
                pair = ("casadi", other)
                yield Summary(
                    environment,
                    pair,
                    len(both),
                    (
                        mean(r.distances["casadi"] for r in both),
                        mean(r.distances[other] for r in both),
                    ),
                    max(r.distances["casadi"] - r.distances[other] for r in both),
                    (sum(r.seconds["casadi"] for r in both), sum(r.seconds[other] for r in both)),
                )


def as_markdown(rows: Sequence[Row], trials: int) -> str:
    """The summary, then every template."""
    lines = [
        "# The optimisers side by side",
        "",
        f"`python -m benchmarks.optimizers --trials {trials}`: distances to the oracle and CPU",
        "seconds on the same templates and histories, in one process on one core.",
        "",
        "| environment | casadi beside | templates | mean distance, casadi | the other's "
        "| largest excess of casadi | seconds, casadi | the other's | ratio of times |",
        "|---" * 9 + "|",
    ]
    lines += [
        f"| {s.environment} | {s.optimizers[1]} | {s.templates} | {s.means[0]:.4f} "
        f"| {s.means[1]:.4f} | {s.largest_excess:+.4f} | {s.seconds[0]:.1f} "
        f"| {s.seconds[1]:.1f} | 1/{1 / s.ratio:.0f} |"
        for s in summaries(rows)
    ]
    heads = " | ".join(f"{name}: distance | s" for name in OPTIMIZERS)
    lines += ["", f"| environment | template | nodes | parameters | {heads} |", "|---" * 10 + "|"]
    for row in rows:
        cells = []
        for name in OPTIMIZERS:
            known = name in row.distances
            cells += [f"{row.distances[name]:.4f}" if known else "-"]
            cells += [f"{row.seconds[name]:.1f}" if known else "-"]
        lines.append(
            f"| {row.environment} | {row.template} | {row.size} | {row.parameters} "
            f"| {' | '.join(cells)} |"
        )
    return "\n".join(lines) + "\n"


def write(rows: Sequence[Row], trials: int, seed: int, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    data = {
        "trials": trials,
        "seed": seed,
        "rows": [asdict(row) for row in rows],
        "summary": [{**asdict(s), "ratio": s.ratio} for s in summaries(rows)],
    }
    (folder / "optimizers.json").write_text(json.dumps(data, indent=2) + "\n", encoding="utf-8")
    (folder / "optimizers.md").write_text(as_markdown(rows, trials), encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--examples", nargs="+", default=list(EXAMPLES), choices=EXAMPLES)
    parser.add_argument("--optimizers", nargs="+", default=list(OPTIMIZERS), choices=OPTIMIZERS)
    parser.add_argument("--templates", type=int, default=12, help="of each example")
    parser.add_argument("--trials", type=int, default=200, help="of bayes, for each template")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=RESULTS, help="where results are written")
    asked = parser.parse_args(arguments)
    from pirlc.tune import Optimizer, Tuning

    hows = [Tuning(Optimizer(name), trials=asked.trials) for name in asked.optimizers]
    rows: list[Row] = []
    for example in asked.examples:
        environment, problems = problems_of(example, asked.seed, asked.templates)
        warmed_up(problems[0][1], hows)
        for number, problem in problems:
            rows.append(compare(environment, number, problem, asked.seed, hows))
            print(json.dumps(asdict(rows[-1])), flush=True)
            write(rows, asked.trials, asked.seed, asked.folder)
    print(as_markdown(rows, asked.trials))


if __name__ == "__main__":
    main()
