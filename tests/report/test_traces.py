"""The program beside the oracle: the program's own episode, and the oracle asked along it."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from pirlc.frontend import parse_sketch
from pirlc.ir.expansion import close
from pirlc.oracle.network import Bounded, Network, NetworkOracle, Scaling
from pirlc.report.traces import trace_episode, traces_data, write_traces
from pirlc.semantics.policies import InterpretedPolicy
from pirlc.simulation.environments import make
from pirlc.simulation.rollout import run_return
from pirlc.source import SourceText
from tests.support.oracles import balancer

PENDULUM = """policy swing
environment "Pendulum-v1" { max_episode_steps = 30 }
sensor Side  : [-1, 1] = 1
sensor Speed : [-8, 8] = 2
action Torque : [-1, 1] = 3 * peek(Side, -1) + peek(Speed, -1)
"""


def program(text: str):
    found = close(parse_sketch(SourceText("p.pirl", text)))
    assert found is not None and found.interface.environment is not None
    return found, found.interface.environment


def twisting() -> NetworkOracle:
    """Asks for a torque of three times the height, up to 2."""
    network = Network(
        scaling=Scaling(np.zeros(3, np.float32), np.ones(3, np.float32)),
        weights=(np.array([[3.0, 0.0, 0.0]], np.float32),),
        biases=(np.zeros(1, np.float32),),
        activation="relu",
    )
    return NetworkOracle(network, Bounded((-2.0,), (2.0,), squashed=False))


def test_the_program_drives_and_the_oracle_is_asked():
    found, environment = program(PENDULUM)
    traces = trace_episode(found, environment, twisting(), 7)
    data = traces_data(traces)
    assert data["steps"] == 30
    alone = run_return(make(environment), InterpretedPolicy(found), 7)
    assert data["return"] == alone
    (torque,) = data["actions"]
    side, speed = (np.array(sensor["readings"]) for sensor in data["sensors"])
    assert torque["program"] == np.clip(3 * side + speed, -1, 1).tolist()
    height = traces.episode.observations[:, 0]
    # Clipped to the action's range, which is half the environment's.
    asked = np.clip(3 * height, -1.0, 1.0)
    assert torque["oracle"] == pytest.approx(asked.tolist(), abs=1e-6)
    assert data["distance"] == pytest.approx(
        (np.abs(np.array(torque["program"]) - asked) / 2.0).tolist(), abs=1e-6
    )
    assert data["mean_distance"] == pytest.approx(math.fsum(data["distance"]) / 30)
    assert data["largest_distance"] == max(data["distance"])


def test_a_discrete_action_agrees_or_not(synthesised):
    found = synthesised.program
    data = traces_data(trace_episode(found, found.interface.environment, balancer(), 1_000_000))
    (push,) = data["actions"]
    assert push["values"] == [0, 1] and push["range"] is None
    differ = [float(a != b) for a, b in zip(push["program"], push["oracle"], strict=True)]
    assert data["distance"] == differ


def test_without_an_oracle(tmp_path):
    found, environment = program(PENDULUM)
    place = write_traces(trace_episode(found, environment, None, 7), tmp_path)
    data = json.loads(place.read_text())
    assert place == tmp_path / "traces.json"
    assert data["distance"] is None and data["actions"][0]["oracle"] is None
    assert len(data["actions"][0]["program"]) == 30


def test_the_same_seed_gives_the_same_bytes(tmp_path):
    found, environment = program(PENDULUM)
    texts = set()
    for name in ("one", "two"):
        place = write_traces(trace_episode(found, environment, twisting(), 3), tmp_path / name)
        texts.add(place.read_bytes())
    assert len(texts) == 1
