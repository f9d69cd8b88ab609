"""Oracles from files and functions of several kinds.

Data: a folder of pirlc's own format, an ONNX file. With trust, since they run code: TorchScript, a
Stable-Baselines3 .zip, ``module:function``.
"""

from __future__ import annotations

import re
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, assert_never

import numpy as np

from pirlc.diagnostics import PirlcError
from pirlc.ir.policy import Environment
from pirlc.oracle.called import (
    FunctionOracle,
    OnnxOracle,
    TorchScriptOracle,
    expected_actions,
)
from pirlc.oracle.manifest import Manifest, usable_for
from pirlc.oracle.network import Bounded, Greedy, NetworkOracle, Oracle
from pirlc.oracle.problems import (
    DamagedOracle,
    ForeignFile,
    OtherActions,
    OtherEnvironment,
    OtherObservations,
    Problem,
    UnreadableOracle,
    UnsupportedNetwork,
    UntrustedOracle,
    failure,
)
from pirlc.oracle.store import load_stored
from pirlc.simulation.environments import BoxActions, DiscreteActions, EnvironmentFacts

_FUNCTION = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")


@dataclass(frozen=True)
class LoadedOracle:
    """`manifest` is None for oracles that are not of pirlc's own format."""

    oracle: Oracle
    manifest: Manifest | None
    origin: str


def load(
    origin: str, environment: Environment, facts: EnvironmentFacts, *, trust: bool = False
) -> LoadedOracle:
    """The oracle at a path, or the function ``module:function``, for this environment.

    ONNX and TorchScript models map a batch of observations (N, d) in binary32 to the actions'
    components (N, k), which are clipped to the environment's range; for discrete actions to one
    score an action (N, n), of which the largest is taken, or to the actions (N,) or (N, 1) as
    integers. Only a model's first output counts. A function takes one observation (d,) in binary64
    and returns its action, a number or k of them. Raises PirlcError E0601 to E0610.
    """
    path = Path(origin)
    if not path.exists() and _FUNCTION.fullmatch(origin):
        if not trust:
            raise failure(UntrustedOracle(origin, "a Python function"))
        return LoadedOracle(_checked(FunctionOracle(origin, facts), facts), None, origin)
    if not path.exists():
        raise failure(UnreadableOracle(origin, "there is no such file or folder"))
    if path.is_dir():
        return _load_folder(path, environment, facts)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise failure(UnreadableOracle(origin, error.strerror or str(error))) from error
    if path.suffix == ".onnx":
        return LoadedOracle(_checked(OnnxOracle(origin, data, facts), facts), None, origin)
    kind = _kind_of_archive(path)
    if kind is None:
        raise failure(_why_not(origin, data))
    if not trust:
        raise failure(UntrustedOracle(origin, kind))
    if kind == _STABLE_BASELINES:
        return LoadedOracle(_from_stable_baselines(path, facts), None, origin)
    return LoadedOracle(_checked(TorchScriptOracle(origin, data, facts), facts), None, origin)


def _load_folder(path: Path, environment: Environment, facts: EnvironmentFacts) -> LoadedOracle:
    stored = load_stored(path)
    trained = stored.manifest.environment
    if not usable_for(trained, environment):
        raise failure(OtherEnvironment(str(path), _words(trained), _words(environment)))
    _fit(str(path), stored.oracle, facts)
    return LoadedOracle(stored.oracle, stored.manifest, str(path))


def _words(environment: Environment) -> str:
    if not environment.arguments:
        return f"`{environment.id}`"
    given = ", ".join(f"{name} = {value!r}" for name, value in environment.arguments)
    return f"`{environment.id}` with {given}"


def _fit(origin: str, oracle: NetworkOracle, facts: EnvironmentFacts) -> None:
    if oracle.network.inputs != facts.observation_size:
        size = oracle.network.inputs
        raise failure(OtherObservations(origin, size, facts.id, facts.observation_size))
    expected = expected_actions(facts.actions)
    match oracle.head, facts.actions:
        case Greedy(values), DiscreteActions() as actions if values == actions.values:
            return
        case Bounded(lower, upper), BoxActions() as box if (lower, upper) == (box.lower, box.upper):
            return
        case Greedy(values), _:
            found = f"one of {', '.join(map(str, values))}"
            raise failure(OtherActions(origin, found, facts.id, expected))
        case Bounded(lower, upper), _:
            found = expected_actions(BoxActions(lower, upper, ""))
            raise failure(OtherActions(origin, found, facts.id, expected))
        case _ as never:
            assert_never(never)


# Archives.

_STABLE_BASELINES = "a Stable-Baselines3 file holds pickled Python objects"
_TORCHSCRIPT = "TorchScript is a program"


def _kind_of_archive(path: Path) -> str | None:
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except (zipfile.BadZipFile, OSError, ValueError):
        return None
    if "data" in names and "policy.pth" in names:
        return _STABLE_BASELINES
    inner = {name.split("/", 1)[-1] for name in names}
    if "constants.pkl" in inner and any(name.startswith("code/") for name in inner):
        return _TORCHSCRIPT
    return None


def _why_not(origin: str, data: bytes) -> Problem:
    if data[:2] == b"PK":
        if origin.endswith((".zip", ".pt", ".pth")) and not _ends_as_zip(data):
            return DamagedOracle(origin, "the archive is cut short")
        return ForeignFile(origin, "it is an archive of another kind")
    if not data:
        return ForeignFile(origin, "the file is empty")
    return ForeignFile(origin, "neither its name nor its content is that of a known kind")


def _ends_as_zip(data: bytes) -> bool:
    return b"PK\x05\x06" in data[-66_000:]


def _from_stable_baselines(path: Path, facts: EnvironmentFacts) -> NetworkOracle:
    import json

    import stable_baselines3

    from pirlc.oracle.dueling import DuelingDoubleDQN
    from pirlc.oracle.export import export

    learners: dict[str, Any] = {
        "stable_baselines3.ppo.policies": stable_baselines3.PPO,
        "stable_baselines3.dqn.policies": stable_baselines3.DQN,
        "stable_baselines3.td3.policies": stable_baselines3.TD3,
        "stable_baselines3.sac.policies": stable_baselines3.SAC,
        "pirlc.oracle.dueling": DuelingDoubleDQN,
        # PPO's policy class is shared by the actor-critic algorithms.
        "stable_baselines3.common.policies": stable_baselines3.PPO,
    }
    origin = str(path)
    try:
        with zipfile.ZipFile(path) as archive:
            module = json.loads(archive.read("data"))["policy_class"]["__module__"]
        if module not in learners:
            raise failure(UnsupportedNetwork(origin, f"its policy is from {module}"))
        model = learners[module].load(path, device="cpu")
        oracle = export(model.policy, facts.actions)
    except PirlcError:
        raise
    except ValueError as error:
        raise failure(UnsupportedNetwork(origin, str(error))) from error
    except Exception as error:
        raise failure(DamagedOracle(origin, f"{type(error).__name__}: {error}")) from error
    size, width = oracle.network.inputs, oracle.network.outputs
    if size != facts.observation_size:
        raise failure(OtherObservations(origin, size, facts.id, facts.observation_size))
    space: Any = model.action_space
    discrete = isinstance(facts.actions, DiscreteActions)
    wanted = (
        len(facts.actions.values)
        if isinstance(facts.actions, DiscreteActions)
        else facts.components
    )
    if width != wanted or hasattr(space, "n") != discrete:
        raise failure(OtherActions(origin, str(space), facts.id, expected_actions(facts.actions)))
    return oracle


def _checked(oracle: Oracle, facts: EnvironmentFacts) -> Oracle:
    """The oracle, asked once, so that one that does not fit is found out before it is needed."""
    low = np.array(facts.observation_lower)
    high = np.array(facts.observation_upper)
    with np.errstate(invalid="ignore"):
        middle = np.where(np.isfinite(low) & np.isfinite(high), low * 0.5 + high * 0.5, 0.0)
    oracle.actions(np.stack([middle, middle]))
    return oracle
