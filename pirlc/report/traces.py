"""A program beside its oracle, step by step, over one episode."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirlc.backend.files import write_text
from pirlc.ir.policy import ActionSpec, Choice, Continuous, Environment, Program
from pirlc.oracle.network import Oracle
from pirlc.report.manifest import sha256_of
from pirlc.report.run import TRACES
from pirlc.semantics.policies import InterpretedPolicy
from pirlc.semantics.vectorised import distances
from pirlc.simulation.rollout import Episode, episode_return
from pirlc.simulation.workers import ALONE, collect_episodes


@dataclass(frozen=True, eq=False)
class Traces:
    """An episode of T steps that the program drove, and what the oracle would have done there.

    `program` and `oracle` are (T, k), actions in declaration order; the oracle was asked on the
    program's observations, and clipped to the actions' ranges. `distance` (T,) is the search's own
    measure of how far they are apart. Both are None without an oracle.
    """

    program_sha256: str
    seed: int
    episode: Episode
    specs: tuple[ActionSpec, ...]
    sensors: tuple[tuple[str, int], ...]
    program: NDArray[np.float64]
    oracle: NDArray[np.float64] | None
    distance: NDArray[np.float64] | None


def trace_episode(
    program: Program,
    environment: Environment,
    oracle: Oracle | None,
    seed: int,
    *,
    trust: bool = False,
) -> Traces:
    """Run the program for one episode from `seed` and ask the oracle along the way.

    Raises PirlcError as a rollout does.
    """
    factory = partial(InterpretedPolicy, program)
    (episode,) = collect_episodes(factory, environment, [seed], ALONE, trust)
    digest = sha256_of(program)
    specs = program.interface.actions
    components = [spec.component for spec in specs]
    driven = episode.actions[:, components]
    sensors = tuple((sensor.name, sensor.index) for sensor in program.interface.sensors)
    if oracle is None:
        return Traces(digest, seed, episode, specs, sensors, driven, None, None)
    asked = _clipped(oracle.actions(episode.observations)[:, components], specs)
    return Traces(
        digest, seed, episode, specs, sensors, driven, asked, distances(driven, asked, specs)
    )


def _clipped(actions: NDArray[np.float64], specs: tuple[ActionSpec, ...]) -> NDArray[np.float64]:
    clipped = np.array(actions, dtype=np.float64)
    for column, spec in enumerate(specs):
        if isinstance(spec.domain, Continuous):
            clipped[:, column] = np.clip(clipped[:, column], spec.domain.lower, spec.domain.upper)
    return clipped


def write_traces(traces: Traces, folder: Path) -> Path:
    """The traces as `traces.json` of a run's folder."""
    text = json.dumps(traces_data(traces), indent=None, separators=(",", ":"), allow_nan=False)
    return write_text(folder / TRACES, text + "\n")


def traces_data(traces: Traces) -> dict[str, Any]:
    """Plain data; a missing reading, for which JSON has no word, is null."""
    distance = traces.distance
    return {
        "program_sha256": traces.program_sha256,
        "seed": traces.seed,
        "steps": len(traces.program),
        "return": episode_return(traces.episode),
        "actions": [
            {
                "name": spec.name,
                "range": None if isinstance(spec.domain, Choice) else _range(spec.domain),
                "values": list(spec.domain.values) if isinstance(spec.domain, Choice) else None,
                "program": _numbers(traces.program[:, column]),
                "oracle": None if traces.oracle is None else _numbers(traces.oracle[:, column]),
            }
            for column, spec in enumerate(traces.specs)
        ],
        "distance": None if distance is None else _numbers(distance),
        "mean_distance": None if distance is None else float(distance.mean()),
        "largest_distance": None if distance is None else float(distance.max()),
        "sensors": [
            {"name": name, "readings": _numbers(traces.episode.observations[:, index])}
            for name, index in traces.sensors
        ],
    }


def _range(domain: Continuous) -> list[float]:
    return [domain.lower, domain.upper]


def _numbers(column: NDArray[np.float64]) -> list[float | None]:
    return [value if math.isfinite(value) else None for value in column.tolist()]
