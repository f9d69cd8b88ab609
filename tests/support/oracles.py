"""Oracles that need no training: networks written down by hand, in pirlc's own format."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from pirlc.ir.policy import Environment
from pirlc.oracle.manifest import Manifest
from pirlc.oracle.network import Greedy, Network, NetworkOracle, Scaling
from pirlc.oracle.store import save_oracle
from pirlc.simulation.rollout import ReturnEstimate


def balancer() -> NetworkOracle:
    """Balances CartPole-v1: pushes right where a weighted sum of the four sensors is positive."""
    direction = np.array([0.1, 0.5, 3.0, 1.0], dtype=np.float32)
    network = Network(
        scaling=Scaling(np.zeros(4, np.float32), np.ones(4, np.float32)),
        weights=(np.stack([-direction, direction]),),
        biases=(np.zeros(2, np.float32),),
        activation="relu",
    )
    return NetworkOracle(network, Greedy((0, 1), rated=False))


def save_balancer(folder: Path) -> Path:
    """The balancer as an oracle's folder."""
    return save_by_hand(balancer(), Environment("CartPole-v1"), 500.0, folder)


def save_by_hand(
    oracle: NetworkOracle, environment: Environment, returns: float, folder: Path
) -> Path:
    """An oracle that nobody trained, as the folder that training would have written."""
    manifest = Manifest(
        environment=environment,
        algorithm="written by hand",
        hyperparameters={},
        seed=0,
        steps=0,
        attempts=0,
        seconds=0.0,
        versions={},
        score=ReturnEstimate(returns, -math.inf, math.inf, 0.0, 1),
        first_seed=0,
        layers=oracle.network.layers,
        activation=oracle.network.activation,
        head=oracle.head,
        scaled=False,
        sha256="",
    )
    return save_oracle(oracle, manifest, folder).folder
