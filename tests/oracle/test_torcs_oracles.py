"""Oracles for the race: trained in small, and those that come with the examples."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pirlc.ir.policy import Environment
from pirlc.oracle.load import load
from pirlc.oracle.settings import default_algorithm
from pirlc.oracle.store import list_stored
from pirlc.oracle.train import plan, train
from pirlc.simulation.environments import facts, make
from pirlc.simulation.rollout import run_returns
from pirlc.simulation.torcs.installation import Installation

SHIPPED = Path(__file__).parents[2] / "examples" / "torcs" / "oracles"
RACE = Environment(
    "pirlc/Torcs-v0",
    (("track", "g-track-1"), ("laps", 0), ("reward", "progress"), ("max_episode_steps", 300)),
)


@pytest.mark.parametrize("algorithm", ["sac", "ddpg"])
def test_a_driver_is_trained(torcs_installation: Installation, algorithm: str) -> None:
    del torcs_installation
    known = facts(RACE)
    assert default_algorithm(known) == "sac"
    given = {"steps": 300, "learning_starts": 250, "batch_size": 16}
    oracle, manifest = train(plan(RACE, known, algorithm=algorithm, overrides=given))
    # Every race is the same, so that one tells all; steps are counted as the learner takes them.
    assert (manifest.score.episodes, manifest.steps) == (1, 300)
    assert np.isfinite(manifest.score.mean)
    actions = oracle.actions(np.random.default_rng(0).normal(size=(50, 29)))
    assert (actions >= [-1.0, 0.0]).all()
    assert (actions <= 1.0).all()


@pytest.mark.parametrize("folder", sorted(p.parent for p in SHIPPED.glob("*/manifest.json")))
def test_a_shipped_driver_reaches_what_its_manifest_says(
    torcs_installation: Installation, folder: Path
) -> None:
    del torcs_installation
    (stored,) = (one for one in list_stored(SHIPPED) if one.folder == folder)
    environment = stored.manifest.environment
    found = load(str(folder), environment, facts(environment))
    simulator = make(environment)
    try:
        (mean,) = run_returns(simulator, found.oracle, [0])
    finally:
        simulator.close()
    # Other processors round the network's sums otherwise, and races drift apart.
    assert mean == pytest.approx(stored.manifest.score.mean, rel=0.1)


def test_the_shipped_drivers_are_small() -> None:
    assert len(list_stored(SHIPPED)) >= 4
    for file in SHIPPED.glob("*/weights.safetensors"):
        assert file.stat().st_size < 1_500_000
