"""Training an oracle with Stable-Baselines3, or finding it among those trained before.

The policy is evaluated every so often in an environment of its own; the best ones seen meet in a
run-off, whose winner is kept.
Training ends when its budget is used, when an evaluation reaches all that can be reached
(`Settings.enough`, twice in a row), or when an acceptable policy has stopped getting better. An
attempt that ends below what is acceptable is followed by another from a fresh seed. Nothing is
written before the end, so an interruption leaves nothing behind.
"""

from __future__ import annotations

import hashlib
import json
import math
import platform
import time
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from pirlc import __version__
from pirlc.diagnostics import PirlcError
from pirlc.ir.policy import Environment
from pirlc.oracle.manifest import FORMAT, Json, Manifest, environment_as_json
from pirlc.oracle.network import NetworkOracle
from pirlc.oracle.settings import (
    Settings,
    default_algorithm,
    default_settings,
    settings_as_json,
    with_overrides,
)
from pirlc.oracle.store import StoredOracle, load_stored, save_oracle
from pirlc.oracle.training import FINALISTS, Candidate, Progress, Report, Tell, Training
from pirlc.simulation.environments import EnvironmentFacts, make
from pirlc.simulation.rollout import estimate, run_returns

SELECTION_SEEDS = range(500_000, 500_100)
"""The episodes that policies are judged by while they are trained: a `Candidate`'s return.

`Settings.episodes` says how many of them are used, and of the other two in proportion.
"""
RUN_OFF_SEEDS = range(520_000, 520_300)
"""The episodes that decide among the best of them."""
SCORE_SEEDS = range(510_000, 510_100)
"""The episodes that the manifest's return is measured on."""
_TRAINING_SEEDS = range(400_000, 500_000)


def plan(
    environment: Environment,
    facts: EnvironmentFacts,
    *,
    algorithm: str | None = None,
    seed: int = 0,
    overrides: Mapping[str, Json] | None = None,
) -> Training:
    """The training that these choices ask for. Raises PirlcError E0611 to E0613."""
    name = default_algorithm(facts) if algorithm is None else algorithm
    settings = default_settings(name, facts, dict(environment.arguments))
    settings = with_overrides(settings, name, overrides or {})
    return Training(environment, facts, name, settings, seed)


def versions() -> dict[str, str]:
    """What a training's outcome depends on beside its settings."""
    libraries = ("gymnasium", "numpy", "stable_baselines3", "torch")
    return {"pirlc": __version__, "python": platform.python_version()} | {
        name: version(name) for name in libraries
    }


def cache_folder(training: Training, cache: Path) -> Path:
    """Where in a cache the oracle of a training is kept; its name ends in a hash of all of it."""
    content = {
        "format": FORMAT,
        "environment": environment_as_json(training.environment),
        "algorithm": training.algorithm,
        "settings": settings_as_json(training.settings),
        "seed": training.seed,
        "versions": versions(),
    }
    key = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    plain = "".join(
        c if c.isascii() and (c.isalnum() or c in "-.") else "_" for c in training.facts.id
    )
    return cache / f"{plain[:60]}-{training.algorithm}-{training.seed}-{key[:16]}"


def cached(training: Training, cache: Path) -> StoredOracle | None:
    """The oracle of a training that was done before, if it is there and undamaged."""
    folder = cache_folder(training, cache)
    if not folder.is_dir():
        return None
    try:
        return load_stored(folder)
    except PirlcError:
        return None


def train_or_load(
    training: Training, cache: Path, report: Report | None = None, *, trust: bool = False
) -> StoredOracle:
    """The oracle of a training, trained only if `cache` does not hold it already.

    Raises PirlcError E0501 to E0506, E0514 to E0518, E0613 to E0615.
    """
    known = cached(training, cache)
    if known is not None:
        return known
    oracle, manifest = train(training, report, trust=trust)
    return save_oracle(oracle, manifest, cache_folder(training, cache))


def train(
    training: Training, report: Report | None = None, *, trust: bool = False
) -> tuple[NetworkOracle, Manifest]:
    """Train, whatever may be cached. Raises as `train_or_load` does."""
    from pirlc.oracle.attempt import run_attempt

    settings = training.settings
    began = time.monotonic()
    simulator = make(training.environment, trust)
    try:

        def mean_return(oracle: NetworkOracle, seeds: Sequence[int]) -> float:
            return math.fsum(run_returns(simulator, oracle, seeds)) / len(seeds)

        def evaluate(oracle: NetworkOracle) -> float:
            return mean_return(oracle, SELECTION_SEEDS[: settings.episodes])

        best: list[Candidate] = []
        steps = attempt = 0
        while attempt < settings.attempts:
            before = best[0][0] if best else -math.inf
            tell = _teller(report, settings, attempt, steps, before)
            seed = attempt_seed(training.seed, attempt)
            outcome = run_attempt(training, seed, evaluate, tell, trust)
            attempt += 1
            steps += outcome.steps
            best = sorted([*best, *outcome.best], key=lambda c: -c[0])[:FINALISTS]
            if settings.acceptable is None or best[0][0] >= settings.acceptable:
                break
        kept = best[0]
        if settings.enough is None or kept[0] < settings.enough:
            # Rare failures hide from a hundred episodes, and the luckiest looks best on them.
            seeds = RUN_OFF_SEEDS[: 3 * settings.episodes]
            kept = max(best, key=lambda candidate: mean_return(candidate[1], seeds))
        score = estimate(run_returns(simulator, kept[1], SCORE_SEEDS[: settings.episodes]))
    finally:
        simulator.close()
    if report is not None:
        report(Progress(1.0, steps, attempt, None, kept[0]))
    oracle = kept[1]
    network = oracle.network
    return oracle, Manifest(
        environment=training.environment,
        algorithm=training.algorithm,
        hyperparameters=settings_as_json(settings),
        seed=training.seed,
        steps=steps,
        attempts=attempt,
        seconds=round(time.monotonic() - began, 1),
        versions=versions(),
        score=score,
        first_seed=SCORE_SEEDS[0],
        layers=network.layers,
        activation=network.activation,
        head=oracle.head,
        scaled=settings.scale,
        sha256="",
    )


def _teller(
    report: Report | None, settings: Settings, attempt: int, before: int, best_before: float
) -> Tell:
    """How an attempt reports: its own steps and returns come after those `before`."""

    def tell(taken: int, recent: float | None, best: float | None) -> None:
        if report is not None:
            done = min(1.0, taken / settings.steps)
            top = best_before if best is None else max(best_before, best)
            shown = top if math.isfinite(top) else None
            report(Progress(done, before + taken, attempt + 1, recent, shown))

    return tell


def attempt_seed(seed: int, attempt: int) -> int:
    """A seed for one attempt, apart from all that anything is evaluated on."""
    drawn = int(np.random.SeedSequence([seed, attempt]).generate_state(1)[0])
    return _TRAINING_SEEDS[drawn % (len(_TRAINING_SEEDS) - 1_000)]
