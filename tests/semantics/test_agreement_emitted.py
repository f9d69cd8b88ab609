"""Interpreter, emitted Python and emitted C agree bit for bit on random programs."""

from __future__ import annotations

import os
import random
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pytest

from pirlc.semantics.precision import Precision
from tests.support.emitted import Tally, compare_all, random_case
from tests.support.programs import Kinds


def batch(seed: int, programs: int, runs: tuple[int, ...], folder: Path) -> Tally:
    """Half of the programs in each precision."""
    rng = random.Random(seed)
    precisions = list(Precision)
    cases = [
        random_case(rng, f"r{seed}n{i}", precisions[i % 2], runs, Kinds()) for i in range(programs)
    ]
    return compare_all(cases, folder, ("-std=c99", "-O1", "-ffp-contract=off"))


def test_agreement_on_a_hundred_thousand_steps(tmp_path: Path) -> None:
    tally = batch(1, 160, (400, 150, 75), tmp_path)
    assert tally.steps == 100_000
    assert tally.mismatches == 0
    # The programs are worth comparing: they move, meet bad readings, and mostly stay finite.
    assert tally.moving > 0.2 * tally.steps
    assert 0.05 * tally.steps < tally.missing < 0.7 * tally.steps
    assert 0.05 * tally.steps < tally.out_of_range < 0.7 * tally.steps
    assert 0.05 * tally.steps < tally.safe < 0.7 * tally.steps
    assert tally.discrete > 0.3 * tally.programs


@pytest.mark.slow
def test_agreement_on_ten_million_steps(tmp_path: Path) -> None:
    folders = [tmp_path / str(seed) for seed in range(100, 200)]
    for folder in folders:
        folder.mkdir()
    workers = os.cpu_count() or 1
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        jobs = [
            pool.submit(batch, 100 + i, 100, (700, 200, 100), folder)
            for i, folder in enumerate(folders)
        ]
        tallies = [job.result() for job in jobs]
    assert sum(tally.steps for tally in tallies) == 10_000_000
    assert sum(tally.mismatches for tally in tallies) == 0
