"""The delay margin of the linear loop, where the simulator has it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pirlc.analyze.analysis import analyze
from pirlc.analyze.plants.find import find_plant
from pirlc.analyze.simulated import from_states
from pirlc.ir.policy import Program
from pirlc.semantics.policies import InterpretedPolicy
from pirlc.simulation.environments import make
from pirlc.simulation.rollout import run_episode
from pirlc.simulation.torcs.installation import Installation
from tests.support.plants import program

PENDULUM = """policy hold
environment "Pendulum-v1"
sensor Side : [-1, 1] = 1
sensor Speed : [-8, 8] = 2
action Torque : [-2, 2] = -24 * peek(Side, -1) - 5 * peek(Speed, -1)
"""
PRINTED = Path(__file__).parents[2] / "examples" / "torcs" / "printed" / "aalborg.pirl"


def late(policy: Program, steps: int) -> Program:
    return replace(policy, interface=replace(policy.interface, latency=steps))


def test_the_pendulum_holds_with_readings_as_late_as_the_margin_allows() -> None:
    policy = program(PENDULUM)
    environment = policy.interface.environment
    assert environment is not None
    plant = find_plant(policy, environment)
    (loop,) = analyze(policy, plant).loops
    assert loop.margins is not None
    margin = loop.margins.delay_samples
    assert 1.0 < margin < 2.0
    ends = []
    for steps in (1, 2):
        slow = late(policy, steps)
        start = np.array([0.02, 0.0])
        (run,) = from_states(slow, slow, environment, plant, start, 400, trust=False)
        ends.append(float(np.max(np.abs(run[-40:, 1]))))
    assert ends[0] < 1e-6
    assert ends[1] > 0.01


class LateSteering:
    """The steering sees old readings, the accelerator new ones."""

    def __init__(self, policy: Program, steps: int) -> None:
        self._steering, self._engine = (
            InterpretedPolicy(late(policy, steps)),
            InterpretedPolicy(policy),
        )

    def reset(self) -> None:
        self._steering.reset()
        self._engine.reset()

    def act(self, observation: NDArray[np.float64]) -> tuple[float, ...]:
        return self._steering.act(observation)[0], self._engine.act(observation)[1]


@pytest.mark.slow
def test_the_car_stays_on_its_line_as_late_as_the_margin_allows(
    torcs_installation: Installation,
) -> None:
    policy = program(PRINTED.read_text(encoding="utf-8"))
    environment = policy.interface.environment
    assert environment is not None
    environment = environment.with_arguments((("track", "michigan"), ("laps", 0)))
    found = analyze(policy, find_plant(policy, environment))
    loop = next(loop for loop in found.loops if loop.leaf == "steer")
    assert loop.margins is not None
    margin = loop.margins.delay_samples
    simulator = make(environment.with_arguments((("max_episode_steps", 1700),)))
    try:
        swings = []
        for steps in (math.floor(margin) - 1, math.ceil(margin) + 1):
            episode = run_episode(simulator, LateSteering(policy, steps), 0)
            # From 20 s on the car is on the straight, in its line, if it is on the road at all.
            straight = episode.observations[1000:, 2]
            swings.append(float(straight.std()) if len(straight) > 300 else math.inf)
    finally:
        simulator.close()
    assert swings[0] < 0.02
    assert swings[1] > 0.2
