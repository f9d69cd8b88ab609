"""The suite `classic`: one record for a row, an environment and a seed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, assert_never

from benchmarks.study import reading
from benchmarks.study.records import (
    COMPLETE,
    EPISODES,
    FIRST_SEED,
    ROOT,
    Record,
    Return,
)
from benchmarks.study.rows import CLASSIC, Lowest, Place, Row, Synthesis, Teacher
from benchmarks.study.running import (
    Children,
    Failed,
    Outcome,
    Run,
    answer,
    digest,
    short,
    synthesise,
)
from pirlc.backend.files import write_text
from pirlc.frontend import parse_sketch
from pirlc.ir.policy import ActionSpec, Choice, Continuous, Program
from pirlc.ir.printer import program_text
from pirlc.ir.terms import DiscreteLiteral, Literal, Term
from pirlc.ir.types import Discrete
from pirlc.source import SourceText


@dataclass(frozen=True)
class Job:
    """One row on one environment with one seed. `folder`: of the suite's runs."""

    row: Row
    place: Place
    seed: int
    folder: Path
    episodes: int = EPISODES
    more: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        return f"{self.row.method}-{self.place.name}-{self.seed}".replace(" ", "-")

    @property
    def asked(self) -> dict[str, Any]:
        """What a record must have been made with to be of this job."""
        options = [*self.row.options, *self.more] if isinstance(self.row, Synthesis) else []
        return {
            "options": options,
            "episodes": self.episodes,
            "sketch": digest(sketch_file(self.place, self.folder)),
        }


def sketch_file(place: Place, folder: Path) -> Path:
    """The sketch for an environment: the example itself, or one made from it in the runs."""
    source = ROOT / place.sketch
    if place.exchanged is None:
        return source
    text = source.read_text("utf-8")
    exchanged = text.replace(f'"{place.exchanged}"', f'"{place.name}"')
    to = folder / "sketches" / f"{place.name}.pirl"
    if not to.is_file() or to.read_text("utf-8") != exchanged:
        write_text(to, exchanged)
    return to


def run(job: Job, children: Children) -> Record:
    """Does what the row asks for. Raises Failed."""
    match job.row:
        case Synthesis():
            return synthesised(job, children)
        case Teacher():
            return taught(job, children)
        case Lowest():
            return lowest(job, children)
        case _:
            assert_never(job.row)


def run_of(job: Job) -> Run:
    """The run of `pirlc synth` that fills the row."""
    assert isinstance(job.row, Synthesis)
    seed = ("--seed", str(job.seed), "--workers", "1", "--episodes", str(job.episodes))
    words = (*job.row.options, *job.more, *job.place.arguments, *seed)
    return Run(sketch_file(job.place, job.folder), job.folder / job.name, words)


def synthesised(job: Job, children: Children) -> Record:
    """A row of programs: the program's own figures, evaluated by the run itself."""
    made = run_of(job)
    found = synthesise(made, children)
    manifest = found.manifest
    if manifest is None:
        return without_program(CLASSIC, job, made, found)
    figures = {
        "algorithm": manifest["oracle"] and manifest["oracle"]["algorithm"],
        "optimizer": reading.optimizer_of(manifest),
    }
    before = reading.return_of(manifest, "without refinement")
    if before is not None:
        figures["without_refinement"] = [before.mean, before.low, before.high]
        figures["without_refinement_size"] = manifest["imitated"]["size"]
    return with_program(CLASSIC, job, made, found, manifest, figures, COMPLETE)


def without_program(suite: str, job: Job, made: Run, found: Outcome) -> Record:
    """A row whose run found nothing."""
    took = found.took
    return Record(
        suite=suite,
        method=job.row.method,
        environment=job.place.name,
        seed=job.seed,
        command=made.command,
        core_seconds=took and round(took.core, 1),
        wall_seconds=took and round(took.wall, 1),
        ending=found.ending,
        figures={"asked": job.asked, "resumed": found.resumed, "why": found.why},
    )


def with_program(
    suite: str,
    job: Job,
    made: Run,
    found: Outcome,
    manifest: dict[str, Any],
    figures: dict[str, Any],
    ending: str,
) -> Record:
    """A row with the program that its run found; `figures` are the suite's own."""
    text = manifest["program"]["text"]
    code, step = reading.cost(text)
    points = reading.pairs(made.folder)
    return replace(
        without_program(suite, job, made, found),
        returns=reading.return_of(manifest, "program"),
        size=manifest["program"]["size"],
        step_nanoseconds=step,
        code_bytes=code,
        provable=reading.provable(made.folder),
        distance=manifest["program"]["loss"] if manifest["oracle"] else None,
        ending=ending,
        program=text,
        oracle=reading.oracle_of(manifest),
        figures={
            "asked": job.asked,
            "resumed": found.resumed,
            "calls": manifest["calls_of_search"],
            "search_seconds": manifest["seconds_of_search"],
            "pairs": points,
            "rank_correlation": reading.correlation(points),
            **figures,
        },
    )


def taught(job: Job, children: Children) -> Record:
    """The oracle: trained, or found in the cache, and evaluated as the programs are."""
    sketch = short(sketch_file(job.place, job.folder))
    training = ("pirlc", "oracle", "train", sketch, "--seed", str(job.seed), "--json")
    trained, _ = answer(training, job.folder / f"{job.name}-training.json", children)
    weights = trained["folder"]
    returns = rollout((weights, "--sketch", sketch), job, job.name, children)
    manifest = trained["oracle"]
    return Record(
        suite=CLASSIC,
        method=job.row.method,
        environment=job.place.name,
        seed=job.seed,
        command=training[:-1],
        returns=returns,
        wall_seconds=manifest["seconds"],
        provable="nothing",
        distance=0.0,
        oracle=manifest["weights_sha256"],
        figures={"asked": job.asked, "algorithm": manifest["algorithm"]},
    )


def rollout(words: tuple[str, ...], job: Job, name: str, children: Children) -> Return:
    """The return of a policy over the episodes that all are compared by. Raises Failed."""
    count = ("--episodes", str(job.episodes), "--seed", str(FIRST_SEED), "--workers", "1")
    command = ("pirlc", "rollout", *words, *count, "--json")
    found, _ = answer(command, job.folder / f"{name}.json", children)
    told = found["return"]
    mean, low, high = (float(f"{told[key]:.8g}") for key in ("mean", "low", "high"))
    return Return(mean, low, high, int(told["episodes"]), FIRST_SEED)


def lowest(job: Job, children: Children) -> Record:
    """The constant action that earns least. It does not depend on the seed."""
    tried = []
    for number, program in enumerate(constants(job.place, job.folder)):
        name = f"{job.name}-{number}"
        file = write_text(job.folder / f"{name}.pirl", program_text(program))
        tried.append((rollout((str(file),), job, name, children), program, file))
    if not tried:
        raise Failed(f"{job.place.name}: its sketch has an action without a constant")
    returns, program, file = min(tried, key=lambda each: each[0].mean)
    count = ("--episodes", str(job.episodes), "--seed", str(FIRST_SEED))
    return Record(
        suite=CLASSIC,
        method=job.row.method,
        environment=job.place.name,
        seed=job.seed,
        command=("pirlc", "rollout", short(file), *count),
        returns=returns,
        size=program.size,
        provable="all",
        program=program_text(program),
        figures={"asked": job.asked},
    )


def constants(place: Place, folder: Path) -> list[Program]:
    """Programs that always do the same: each value of a discrete action; the two ends and the
    middle of a continuous one."""
    path = sketch_file(place, folder)
    interface = parse_sketch(SourceText(path.name, path.read_text("utf-8"))).interface
    sides = [_values(action) for action in interface.actions]
    count = min(map(len, sides), default=0)
    bare = replace(interface, window=1)
    return [Program(bare, (), tuple(side[number] for side in sides)) for number in range(count)]


def _values(action: ActionSpec) -> list[Term]:
    match action.domain:
        case Choice(values):
            return [DiscreteLiteral(value, Discrete(values)) for value in values]
        case Continuous(lower, upper):
            found = (lower, (lower + upper) / 2, upper)
            return [Literal(value) for value in found if math.isfinite(value)]
        case _:
            assert_never(action.domain)
