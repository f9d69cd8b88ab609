"""The manifest beside an oracle's weights: where they come from and what they reach."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, assert_never

from pirlc.ir.policy import Environment, Scalar
from pirlc.oracle.network import Bounded, Greedy, Head
from pirlc.simulation.rollout import ReturnEstimate

FORMAT = 1

Json = None | bool | int | float | str | list["Json"] | dict[str, "Json"]


@dataclass(frozen=True)
class Manifest:
    """`steps` is what the training took in all, `first_seed` the first seed of the evaluation.

    `score` is the return over episodes that played no part in the training.
    """

    environment: Environment
    algorithm: str
    hyperparameters: Mapping[str, Json]
    seed: int
    steps: int
    attempts: int
    seconds: float
    versions: Mapping[str, str]
    score: ReturnEstimate
    first_seed: int
    layers: tuple[int, ...]
    activation: str
    head: Head
    scaled: bool
    sha256: str


def environment_as_json(environment: Environment) -> dict[str, Json]:
    return {"id": environment.id, "arguments": dict(environment.arguments)}


_ANY_ARGUMENTS = ("pirlc/Torcs-v0",)
"""Environments whose arguments change the task, but not what readings and actions mean."""
_OF_THE_TASK = ("max_episode_steps",)
"""Arguments that change no environment's readings and actions."""


def usable_for(trained: Environment, wanted: Environment) -> bool:
    """Whether an oracle of one environment may guide another, as far as their arguments tell.

    Equal ids, and equal arguments in any order; but for the arguments that leave readings and
    actions what they are: in pirlc/Torcs-v0 a driver for one track is a driver on any.
    """

    def telling(environment: Environment) -> dict[str, Scalar]:
        given = dict(environment.arguments)
        return {name: value for name, value in given.items() if name not in _OF_THE_TASK}

    if trained.id != wanted.id:
        return False
    return trained.id in _ANY_ARGUMENTS or telling(trained) == telling(wanted)


def to_json(manifest: Manifest) -> dict[str, Json]:
    score = manifest.score
    head: dict[str, Json]
    match manifest.head:
        case Greedy(values, rated):
            head = {"kind": "greedy", "values": list(values), "rated": rated}
        case Bounded(lower, upper, squashed, reach):
            head = {
                "kind": "bounded",
                "lower": list(lower),
                "upper": list(upper),
                "squashed": squashed,
            }
            if reach is not None:
                head["reach"] = [list(reach[0]), list(reach[1])]
        case _:
            assert_never(manifest.head)
    return {
        "format": FORMAT,
        "environment": environment_as_json(manifest.environment),
        "algorithm": manifest.algorithm,
        "hyperparameters": dict(manifest.hyperparameters),
        "seed": manifest.seed,
        "steps": manifest.steps,
        "attempts": manifest.attempts,
        "seconds": manifest.seconds,
        "versions": dict(manifest.versions),
        "return": {
            "mean": score.mean,
            "low": score.low if math.isfinite(score.low) else None,
            "high": score.high if math.isfinite(score.high) else None,
            "std": score.std,
            "episodes": score.episodes,
            "first_seed": manifest.first_seed,
        },
        "network": {
            "layers": list(manifest.layers),
            "activation": manifest.activation,
            "scaled_observations": manifest.scaled,
            "head": head,
        },
        "weights_sha256": manifest.sha256,
    }


def from_json(data: Any) -> Manifest:
    """Read a manifest of this format; a ValueError says what is wrong with it."""
    environment = _get(data, "environment", dict)
    score, network = _get(data, "return", dict), _get(data, "network", dict)
    low, high = score.get("low"), score.get("high")
    return Manifest(
        environment=Environment(
            _get(environment, "id", str), _arguments(_get(environment, "arguments", dict))
        ),
        algorithm=_get(data, "algorithm", str),
        hyperparameters=_get(data, "hyperparameters", dict),
        seed=_get(data, "seed", int),
        steps=_get(data, "steps", int),
        attempts=_get(data, "attempts", int),
        seconds=_number(data, "seconds"),
        versions=_get(data, "versions", dict),
        score=ReturnEstimate(
            _number(score, "mean"),
            -math.inf if low is None else _number(score, "low"),
            math.inf if high is None else _number(score, "high"),
            _number(score, "std"),
            _get(score, "episodes", int),
        ),
        first_seed=_get(score, "first_seed", int),
        layers=tuple(_integers(network, "layers")),
        activation=_get(network, "activation", str),
        head=_head(_get(network, "head", dict)),
        scaled=_get(network, "scaled_observations", bool),
        sha256=_get(data, "weights_sha256", str),
    )


def _head(data: dict[str, Any]) -> Head:
    match _get(data, "kind", str):
        case "greedy":
            return Greedy(tuple(_integers(data, "values")), _get(data, "rated", bool))
        case "bounded":
            bounds = [_get(data, name, list) for name in ("lower", "upper")]
            bounds += _get(data, "reach", list) if "reach" in data else []
            if not all(isinstance(x, int | float) for bound in bounds for x in bound):
                raise ValueError("the manifest's action bounds are not numbers")
            lower, upper, *reach = (tuple(float(x) for x in bound) for bound in bounds)
            if len({len(bound) for bound in bounds}) > 1 or len(reach) not in (0, 2):
                raise ValueError("the manifest's action bounds differ in length")
            reached = (reach[0], reach[1]) if reach else None
            return Bounded(lower, upper, _get(data, "squashed", bool), reached)
        case other:
            raise ValueError(f"the manifest names an unknown kind of output, {other!r}")


def _arguments(data: dict[str, Any]) -> tuple[tuple[str, Scalar], ...]:
    if not all(isinstance(value, str | int | float | bool) for value in data.values()):
        raise ValueError("the manifest's environment arguments are not plain values")
    return tuple(data.items())


def _get(data: Any, name: str, kind: type[Any]) -> Any:
    if not isinstance(data, dict) or name not in data:
        raise ValueError(f"the manifest lacks `{name}`")
    value = data[name]
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise ValueError(f"the manifest's `{name}` is not of type {kind.__name__}")
    return value


def _number(data: Any, name: str) -> float:
    value = data.get(name)
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise ValueError(f"the manifest's `{name}` is not a number")
    return float(value)


def _integers(data: Any, name: str) -> list[int]:
    values = _get(data, name, list)
    if not values or not all(isinstance(v, int) and not isinstance(v, bool) for v in values):
        raise ValueError(f"the manifest's `{name}` is not a list of integers")
    return list(values)
