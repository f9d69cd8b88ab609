"""Gymnasium environments: made by id and arguments, measured, and compared with an interface."""

from __future__ import annotations

import importlib
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, assert_never

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from pirlc.diagnostics import Diagnostic, PirlcError, suggestion
from pirlc.ir.policy import ActionSpec, Choice, Continuous, Environment, Interface
from pirlc.simulation.native import is_deterministic, is_native
from pirlc.simulation.problems import (
    BadArguments,
    ComponentMissing,
    ComponentOutside,
    ComponentTwice,
    EnvironmentFailed,
    NoEnvironment,
    Problem,
    RangeWider,
    SampleTimeDiffers,
    SensorOutside,
    UnknownEnvironment,
    UnsupportedActions,
    UnsupportedObservations,
    UntrustedEnvironment,
    ValueOutside,
    WrongActionKind,
    failure,
    place,
)
from pirlc.source import SourceText, Span

Simulator = gym.Env[Any, Any]
"""An environment as Gymnasium has it."""

OWN = {"pirlc/Torcs-v0": "pirlc.simulation.torcs.environment:Torcs"}
"""Environments of this package, registered with Gymnasium when they are first asked for."""

_RUNS_CODE = ("GymV21Environment-v0", "GymV26Environment-v0")
"""Environments whose own arguments name a module to import."""


@dataclass(frozen=True)
class DiscreteActions:
    """The actions are the integers ``start, ..., start + n - 1``."""

    n: int
    start: int

    @property
    def values(self) -> tuple[int, ...]:
        return tuple(range(self.start, self.start + self.n))


@dataclass(frozen=True)
class BoxActions:
    """The action is a vector between `lower` and `upper`, of a floating `dtype`."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    dtype: str


@dataclass(frozen=True)
class EnvironmentFacts:
    """What the compiler needs to know of an environment.

    `max_episode_steps` and `sample_time` (seconds a step) are None where the environment does not
    tell; `reward_threshold` is the return at which its authors call it solved. `native`: it runs
    compiled policies by itself. `deterministic`: it says that its seed changes nothing, so that one
    episode tells all.
    """

    id: str
    observation_lower: tuple[float, ...]
    observation_upper: tuple[float, ...]
    observation_dtype: str
    actions: DiscreteActions | BoxActions
    max_episode_steps: int | None
    sample_time: float | None
    reward_threshold: float | None
    native: bool = False
    deterministic: bool = False

    @property
    def observation_size(self) -> int:
        return len(self.observation_lower)

    @property
    def components(self) -> int:
        """The number of components of an action."""
        match self.actions:
            case DiscreteActions():
                return 1
            case BoxActions(lower):
                return len(lower)


def import_trusted(module: str) -> Any:
    """Import a module that the user trusts, also from the current folder."""
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)
    return importlib.import_module(module)


def register_own() -> None:
    """Makes this package's environments known to ``gymnasium.make``."""
    for name, entry_point in OWN.items():
        if name not in gym.registry:
            gym.register(name, entry_point)


def make(environment: Environment, trust: bool = False) -> Simulator:
    """The environment, without Gymnasium's checker around it.

    Ids of the form ``module:id`` import that module, so they need `trust`. Raises PirlcError
    E0501 to E0504.
    """
    register_own()
    name = environment.id
    arguments: dict[str, Any] = dict(environment.arguments)
    runs_code = ":" in name or name in _RUNS_CODE
    if runs_code and not trust:
        raise failure(UntrustedEnvironment(name))
    clashing = tuple(key for key in arguments if key in ("id", "disable_env_checker"))
    if clashing:
        raise failure(BadArguments(name, clashing, "these names are Gymnasium's own"))
    module, _, plain = name.rpartition(":")
    try:
        if module:
            import_trusted(module)
    except Exception as error:
        raise failure(EnvironmentFailed(name, _words(error))) from error
    with warnings.catch_warnings():
        # Gymnasium warns of older versions, which a sketch may well ask for.
        warnings.simplefilter("ignore")
        try:
            specification = gym.spec(plain)
            made: Simulator = gym.make(plain, disable_env_checker=True, **arguments)
        except (gym.error.UnregisteredEnv, gym.error.DeprecatedEnv) as error:
            similar = suggestion(plain, list(gym.registry))
            raise failure(UnknownEnvironment(name, similar)) from error
        except PirlcError:
            # This package's own environments say themselves what is wrong.
            raise
        except Exception as error:
            if type(error) is gym.error.Error and str(error).startswith("Malformed"):
                similar = suggestion(plain, list(gym.registry))
                raise failure(UnknownEnvironment(name, similar)) from error
            reason = _words(error).split(" was raised from the environment creator")[0]
            # Without its arguments the environment can be made: then they are to blame.
            if arguments and _can_be_made(specification):
                raise failure(BadArguments(name, tuple(arguments), reason)) from error
            raise failure(EnvironmentFailed(name, reason)) from error
    return made


def _can_be_made(specification: gym.envs.registration.EnvSpec) -> bool:
    try:
        gym.make(specification, disable_env_checker=True).close()
    except Exception:
        return False
    return True


def _words(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


def facts_of(simulator: Simulator, environment: Environment) -> EnvironmentFacts:
    """Measure an environment. Raises PirlcError E0505 or E0506 for spaces of other kinds."""
    observations, chosen = simulator.observation_space, simulator.action_space
    if not isinstance(observations, spaces.Box) or len(observations.shape) != 1:
        raise failure(UnsupportedObservations(environment.id, _space(observations)))
    actions: DiscreteActions | BoxActions
    match chosen:
        case spaces.Discrete():
            actions = DiscreteActions(int(chosen.n), int(chosen.start))
        case spaces.Box() if len(chosen.shape) == 1 and np.issubdtype(chosen.dtype, np.floating):
            actions = BoxActions(_floats(chosen.low), _floats(chosen.high), str(chosen.dtype))
        case _:
            raise failure(UnsupportedActions(environment.id, _space(chosen)))
    specification = simulator.spec
    return EnvironmentFacts(
        environment.id,
        _floats(observations.low),
        _floats(observations.high),
        str(observations.dtype),
        actions,
        None if specification is None else specification.max_episode_steps,
        _sample_time(simulator),
        None if specification is None else specification.reward_threshold,
        is_native(simulator),
        is_deterministic(simulator),
    )


def facts(environment: Environment, trust: bool = False) -> EnvironmentFacts:
    """Make an environment only to measure it. Raises PirlcError E0501 to E0506."""
    simulator = make(environment, trust)
    try:
        return facts_of(simulator, environment)
    finally:
        simulator.close()


def _floats(array: Any) -> tuple[float, ...]:
    return tuple(float(value) for value in array)


def _space(space: Any) -> str:
    return " ".join(str(space).split())


def _sample_time(simulator: Simulator) -> float | None:
    """Seconds a step, by the names that Gymnasium's own environments and MuJoCo's use."""
    for name in ("dt", "tau"):
        value = getattr(simulator.unwrapped, name, None)
        if isinstance(value, int | float) and np.isfinite(value) and value > 0:
            return float(value)
    return None


def require_environment(interface: Interface) -> Environment:
    """The environment that a file names. Raises PirlcError E0513 if it names none."""
    if interface.environment is None:
        raise failure(NoEnvironment(interface.name))
    return interface.environment


def check_interface(
    interface: Interface, facts: EnvironmentFacts, source: SourceText | None = None
) -> tuple[Diagnostic, ...]:
    """What does not fit between a file's sensors and actions and the environment's.

    Errors E0507 to E0510, warnings E0511 and E0512; empty where all is well. With `source` the
    diagnostics point into it.
    """
    return tuple(place(problem, source, span) for problem, span in _misfits(interface, facts))


def _misfits(interface: Interface, facts: EnvironmentFacts) -> Iterator[tuple[Problem, Span]]:
    size, count = facts.observation_size, facts.components
    for sensor in interface.sensors:
        if not 0 <= sensor.index < size:
            yield SensorOutside(sensor.name, sensor.index, facts.id, size), sensor.span
    driven: dict[int, ActionSpec] = {}
    for action in interface.actions:
        if not 0 <= action.component < count:
            outside = ComponentOutside(action.name, action.component, facts.id, count)
            yield outside, action.span
        elif action.component in driven:
            other = driven[action.component]
            twice = ComponentTwice(action.name, other.name, action.component, other.span)
            yield twice, action.span
        else:
            driven[action.component] = action
            yield from _domain_misfits(action, facts)
    whole = interface.environment
    for component in range(count):
        if component not in driven:
            where = whole.span if whole is not None else interface.actions[-1].span
            yield ComponentMissing(component, facts.id, count), where
    stated, simulated = interface.sample_time, facts.sample_time
    if stated is not None and simulated is not None and not np.isclose(stated, simulated):
        where = whole.span if whole is not None else interface.actions[-1].span
        yield SampleTimeDiffers(facts.id, stated, simulated), where


def _domain_misfits(action: ActionSpec, facts: EnvironmentFacts) -> Iterator[tuple[Problem, Span]]:
    match action.domain, facts.actions:
        case Choice(values), DiscreteActions(n, start):
            for value in values:
                if not start <= value < start + n:
                    outside = ValueOutside(action.name, value, facts.id, start, start + n - 1)
                    yield outside, action.span
        case Continuous(lower, upper), BoxActions(space_lower, space_upper, dtype):
            low, high = space_lower[action.component], space_upper[action.component]
            # The bounds as the environment's own type has them: 0.1 is no wider than binary32's.
            cast = np.dtype(dtype).type
            if float(cast(lower)) < low or float(cast(upper)) > high:
                yield RangeWider(action.name, lower, upper, facts.id, low, high), action.span
        case Choice(), BoxActions() as box:
            space = f"a box of {len(box.lower)} x {box.dtype}"
            yield WrongActionKind(action.name, facts.id, False, space), action.span
        case Continuous(), DiscreteActions(n, start):
            space = f"the values {start} to {start + n - 1}"
            yield WrongActionKind(action.name, facts.id, True, space), action.span
        case _ as never:
            assert_never(never)  # type: ignore[arg-type]
