"""The methods: each makes one record's worth of figures for an environment and a seed."""

from __future__ import annotations

import resource
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import Any

from benchmarks.peers import dagger, linear, symbolic, tree_code, trees
from benchmarks.peers.evaluation import distance, evaluate, evaluate_network, provable
from benchmarks.peers.footprint import measure_program, recorded
from benchmarks.peers.network import OnnxPolicy
from benchmarks.peers.simulators import episodes_of
from benchmarks.peers.tasks import RATED, Task, actions_of, algorithm_of, labels, oracle, task
from benchmarks.study.records import Record, Return, finite
from pirlc.ir.policy import Program
from pirlc.ir.printer import program_text
from pirlc.oracle.store import StoredOracle

SUITE = "peers"
LEAVES = (2, 3, 4, 5, 6, 7, 8, 16, 64)
LENGTHS = (12, 30)
"""The most nodes, as pyoperon counts them, of a formula."""

WITH_VALUES = dict.fromkeys(("CartPole-v0", "CartPole-v1", "Acrobot-v1"), "duel-ddqn")
"""Where pirlc's own oracle has no Q values: an algorithm that learns them."""


@dataclass
class Spent:
    """CPU time of this process and its children, and time on the clock, in seconds."""

    core: float = 0.0
    wall: float = 0.0


@contextmanager
def measured() -> Iterator[Spent]:
    spent = Spent()
    core, wall = _core_seconds(), time.perf_counter()
    yield spent
    spent.core, spent.wall = _core_seconds() - core, time.perf_counter() - wall


def _core_seconds() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


@dataclass(frozen=True)
class Effort:
    """How hard each method tries; smaller ones are for tests."""

    dagger: dagger.Settings = field(default_factory=dagger.Settings)
    linear: linear.Settings = field(default_factory=linear.Settings)
    symbolic: symbolic.Settings = field(default_factory=symbolic.Settings)


@dataclass(frozen=True)
class Job:
    """`number`: the most leaves or nodes, for methods that come in sizes. `algorithm`: of another
    oracle than pirlc's own."""

    method: str
    environment: str
    seed: int
    number: int | None = None
    algorithm: str | None = None

    @property
    def name(self) -> str:
        """The record's method."""
        words = [self.method, self.number, self.algorithm if self.method == "onnx" else None]
        return "-".join(str(word) for word in words if word is not None)

    @property
    def command(self) -> tuple[str, ...]:
        chosen = ["--method", self.name, "--environment", self.environment]
        return ("python", "-m", "benchmarks.peers", *chosen, "--seed", str(self.seed))

    def record(self, **figures: Any) -> Record:
        return Record(SUITE, self.name, self.environment, self.seed, self.command, **figures)


def run(job: Job, effort: Effort) -> Record:
    """Raises SystemExit where a method cannot do what it is asked."""
    match job.method:
        case "viper" | "viper-logits" | "dagger-tree":
            return _tree(job, effort.dagger)
        case "cma-linear" | "cma-argmax":
            return _linear(job, effort.linear)
        case "symbolic":
            return _symbolic(job, effort.symbolic)
        case "onnx":
            return _network(job)
        case _:
            raise SystemExit(f"there is no method {job.method}")


def _tree(job: Job, settings: dagger.Settings) -> Record:
    algorithm = job.algorithm or algorithm_of(job.environment)
    if job.method == "viper" and algorithm not in RATED:
        # Before an oracle is trained for nothing.
        raise dagger.NoValues(job.environment, algorithm)
    chosen, stored = task(job.environment), oracle(job.environment, job.seed, job.algorithm)
    weigh: dagger.Weigh = dagger.unit_weights
    if job.method == "viper":
        weigh = dagger.q_weights(stored.oracle, job.environment, stored.manifest.algorithm)
    elif job.method == "viper-logits":
        weigh = dagger.logit_weights(stored.oracle, job.environment, stored.manifest.algorithm)
    assert job.number is not None
    with measured() as spent:
        grown = dagger.grow(chosen, stored.oracle, weigh, job.number, job.seed, settings)
    program = trees.program_of(grown.tree, chosen)
    observations = recorded(program)
    as_c = {
        "m2cgen": tree_code.measured(tree_code.by_m2cgen(grown.fitted), grown.fitted, observations),
        "emlearn": tree_code.measured(
            tree_code.by_emlearn(grown.fitted), grown.fitted, observations
        ),
    }
    code_bytes, nanoseconds = measure_program(program, observations)
    return job.record(
        **_of_program(chosen, program, stored),
        **_spent(spent),
        code_bytes=as_c["m2cgen"].code_bytes,
        step_nanoseconds=finite(as_c["m2cgen"].step_nanoseconds, 4),
        figures={
            **_of_oracle(stored),
            "leaves": trees.leaves(grown.tree),
            "validation": finite(grown.validation),
            "iteration": grown.iteration,
            "settings": asdict(settings),
            **{name: asdict(code) for name, code in as_c.items()},
            "pirlc": {"code_bytes": code_bytes, "step_nanoseconds": finite(nanoseconds, 4)},
        },
    )


def _linear(job: Job, settings: linear.Settings) -> Record:
    chosen = task(job.environment)
    rows = len(chosen.values) if job.method == "cma-argmax" else 1
    if job.method == "cma-argmax" and (not chosen.discrete or rows != 3):
        raise SystemExit(f"{job.method} is for three actions; {job.environment} has others")
    with measured() as spent:
        found = linear.tune(chosen, rows, job.seed, settings)
    program = linear.program_of(found, chosen)
    return job.record(
        **_of_program(chosen, program, None),
        **_spent(spent),
        **_of_code(program),
        figures={"validation": finite(found.validation), "settings": asdict(settings)},
    )


def _symbolic(job: Job, settings: symbolic.Settings) -> Record:
    chosen, stored = task(job.environment), oracle(job.environment, job.seed)
    assert job.number is not None
    with measured() as spent:
        found = symbolic.regress(chosen, stored.oracle, job.number, job.seed, settings)
    return job.record(
        **_of_program(chosen, found.program, stored),
        **_spent(spent),
        **_of_code(found.program),
        figures={
            **_of_oracle(stored),
            "formula": found.text,
            "validation": finite(found.validation),
            "settings": asdict(settings),
        },
    )


def _network(job: Job) -> Record:
    stored = oracle(job.environment, job.seed, job.algorithm)
    policy = OnnxPolicy(stored.oracle)
    returns, differing = evaluate_network(job.environment, policy.actions, policy)
    observations, _ = episodes_of(job.environment, policy.actions, range(900_000, 900_020))
    return job.record(
        returns=_rounded(returns),
        core_seconds=None,
        step_nanoseconds=finite(policy.step_nanoseconds(observations), 4),
        code_bytes=len(policy.data),
        provable="nothing by pirlc; code_bytes are the model's, without the runtime",
        distance=0.0,
        oracle=stored.manifest.sha256,
        figures={
            **_of_oracle(stored),
            "parameters": policy.parameters,
            "layers": list(stored.manifest.layers),
            "episodes_that_differ_one_by_one": differing,
        },
    )


def _of_program(chosen: Task, program: Program, stored: StoredOracle | None) -> dict[str, Any]:
    apart = None
    if stored is not None:
        act = actions_of(program)
        seen, _ = episodes_of(chosen.environment, act, range(900_000, 900_050))
        span = None if chosen.discrete else chosen.bounds[1] - chosen.bounds[0]
        apart = distance(span, act(seen)[:, 0], labels(stored.oracle, seen))
    return {
        "returns": _rounded(evaluate(program)),
        "size": program.size,
        "provable": provable(program),
        "distance": finite(apart, 4),
        "program": program_text(program),
        "oracle": None if stored is None else stored.manifest.sha256,
    }


def _of_code(program: Program) -> dict[str, Any]:
    code_bytes, nanoseconds = measure_program(program)
    return {"code_bytes": code_bytes, "step_nanoseconds": finite(nanoseconds, 4)}


def _of_oracle(stored: StoredOracle) -> dict[str, Any]:
    return {"algorithm": stored.manifest.algorithm, "oracle_seconds": stored.manifest.seconds}


def _spent(spent: Spent) -> dict[str, float | None]:
    return {"core_seconds": finite(spent.core, 4), "wall_seconds": finite(spent.wall, 4)}


def _rounded(found: Return) -> Return:
    mean, low, high = (finite(x, 8) for x in (found.mean, found.low, found.high))
    assert mean is not None and low is not None and high is not None
    return Return(mean, low, high, found.episodes, found.first_seed)


def jobs(environment: str, seed: int) -> list[Job]:
    """All that is run of an environment unless less is asked for."""
    at = partial(Job, environment=environment, seed=seed)
    values = WITH_VALUES.get(environment)
    chosen: list[Job] = [at("onnx"), at("cma-linear")]
    if environment in ("MountainCar-v0", "Acrobot-v1"):
        chosen.append(at("cma-argmax"))
    chosen += [at("symbolic", number=n) for n in LENGTHS]
    if environment == "MountainCar-v0" or values is not None:
        chosen += [at("viper", number=n, algorithm=values) for n in LEAVES]
    if values is not None:
        chosen.append(at("onnx", algorithm=values))
    if environment != "MountainCar-v0":
        chosen += [at("dagger-tree", number=n) for n in LEAVES]
    return chosen
