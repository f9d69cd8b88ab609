"""Oracles trained and listed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from pirlc.cli.arguments import Arguments
from pirlc.cli.files import read_sketch
from pirlc.cli.measure import interval, number
from pirlc.cli.places import fitting_facts
from pirlc.cli.progress import training as training_progress
from pirlc.cli.session import Session
from pirlc.diagnostics import PirlcError
from pirlc.oracle.manifest import Json, to_json
from pirlc.oracle.store import (
    StoredOracle,
    check_place,
    default_cache,
    list_stored,
    save_oracle,
)
from pirlc.oracle.train import cache_folder, cached, plan, train
from pirlc.oracle.training import Progress, Report, Training


@dataclass(frozen=True)
class Wish:
    """What the command line asks of a training; `output` is None for the cache."""

    algorithm: str | None
    seed: int
    overrides: Mapping[str, Json]
    output: Path | None
    trust: bool
    arguments: Arguments = ()


def train_for(session: Session, name: str, wish: Wish) -> None:
    """Train or find the oracle for a file's environment, save it and say what it reaches."""
    source, sketch = read_sketch(session, name, wish.arguments)
    found = fitting_facts(session, source, sketch.interface, wish.trust)
    environment = sketch.interface.environment
    assert environment is not None
    job = plan(
        environment, found, algorithm=wish.algorithm, seed=wish.seed, overrides=wish.overrides
    )
    stored, trained = _obtain(job, default_cache(), wish)
    session.say(_in_words(stored))
    session.say(f"{'saved in' if trained or wish.output else 'trained before, in'} {stored.folder}")
    session.finish(
        {"folder": str(stored.folder), "trained": trained, "oracle": to_json(stored.manifest)}
    )


def _obtain(job: Training, cache: Path, wish: Wish) -> tuple[StoredOracle, bool]:
    """The oracle in its folder, and whether it was trained now."""
    place = cache_folder(job, cache) if wish.output is None else wish.output
    known = cached(job, cache)
    if known is not None:
        if wish.output is None:
            return known, False
        return save_oracle(known.oracle, known.manifest, place), False
    check_place(place)
    with training_progress() as show:
        oracle, manifest = train(job, _report(show), trust=wish.trust)
    stored = save_oracle(oracle, manifest, place)
    if wish.output is not None:
        # The cache is a convenience here: the oracle is where it was wanted.
        with suppress(PirlcError):
            save_oracle(oracle, manifest, cache_folder(job, cache))
    return stored, True


def _report(show: Callable[[float, str], None] | None) -> Report | None:
    if show is None:
        return None

    return lambda progress: show(progress.fraction, training_words(progress))


def training_words(progress: Progress) -> str:
    """How far a training is."""
    words = [f"{progress.steps:,} steps"]
    if progress.attempt > 1:
        words.append(f"attempt {progress.attempt}")
    if progress.recent is not None:
        words.append(f"exploring {number(progress.recent)}")
    if progress.best is not None:
        words.append(f"best {number(progress.best)}")
    return ", ".join(words)


def _in_words(stored: StoredOracle) -> str:
    manifest = stored.manifest
    return (
        f"{manifest.environment.id}: {manifest.algorithm}, seed {manifest.seed}, "
        f"{manifest.steps:,} steps\n"
        f"return {number(manifest.score.mean)}   {interval(manifest.score)}   "
        f"{manifest.score.episodes:,} episodes"
    )


def show_stored(session: Session, folder: Path | None) -> None:
    """List the oracles in a folder; None: in the cache."""
    place = default_cache() if folder is None else folder
    found = list_stored(place)
    if not found:
        session.say(f"no oracles in {place}")
    for stored in found:
        session.say(f"{_in_words(stored)}\n  {stored.folder}")
    session.finish({"oracles": [{"folder": str(s.folder), **to_json(s.manifest)} for s in found]})
