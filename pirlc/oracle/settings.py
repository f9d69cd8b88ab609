"""How oracles are trained by default: one row an algorithm, and better ones for known problems.

The rows follow Stable-Baselines3's defaults and RL Baselines3 Zoo's tuned values, shortened by
measurement; docs/oracles.md tells what they reach in what time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from pirlc.diagnostics import suggestion
from pirlc.ir.policy import Scalar
from pirlc.oracle.manifest import Json
from pirlc.oracle.problems import BadHyperparameter, UnknownAlgorithm, WrongAlgorithm, failure
from pirlc.simulation.environments import DiscreteActions, EnvironmentFacts

DISCRETE = ("ppo", "dqn", "duel-ddqn")
CONTINUOUS = ("ppo", "td3", "sac", "ddpg")
ALGORITHMS = ("ppo", "dqn", "duel-ddqn", "td3", "sac", "ddpg")


@dataclass(frozen=True)
class Settings:
    """One training.

    `steps`: steps of one attempt, at most. `copies`: environments stepped in turn.
    `evaluate_every`: steps between evaluations. `scale`: bounded observations are mapped onto
    [-1, 1]. `enough`: a mean return at which training stops at once; `acceptable`: one below which
    another attempt is made, up to `attempts`. None: unknown. `patience`: evaluations without
    progress, once acceptable, after which training stops. `episodes`: episodes of an evaluation;
    one tells all where every episode is the same.

    `repeat`: the environment's steps that the learner's step takes, all with the same action; the
    oracle acts at each. `reward_scale`: a factor on the rewards that the learner sees. `centre` and
    `spread`: the learner's observations are ``(x - centre) / spread``, one number a component;
    empty: as `scale` says. `least` and `most`: the range of the learner's actions, where it is to
    be wider than the environment's, to which they are clipped.

    `learner`: the arguments of the algorithm's constructor; ``"lin_0.001"`` falls linearly to 0, as
    in RL Baselines3 Zoo. Beside them: `noise`, the standard deviation of the exploration that is
    added to the actions (on [-1, 1]; one number, or one a component); `drift`, the share by which
    that noise returns to 0 in a step (Ornstein and Uhlenbeck's process; 1, the default, is white
    noise); `fade`, the share of the training over which the noise falls linearly to a tenth; and
    `bias`, the actions (before tanh) around which an untrained network acts. With `bias` the
    network acts from the first step; without it, uniformly random actions fill `learning_starts`.
    """

    steps: int
    copies: int = 1
    evaluate_every: int = 5_000
    scale: bool = True
    enough: float | None = None
    acceptable: float | None = None
    attempts: int = 1
    patience: int = 6
    episodes: int = 100
    repeat: int = 1
    reward_scale: float = 1.0
    centre: tuple[float, ...] = ()
    spread: tuple[float, ...] = ()
    least: tuple[float, ...] = ()
    most: tuple[float, ...] = ()
    learner: Mapping[str, Json] = field(default_factory=dict)


_PPO = Settings(
    steps=200_000,
    copies=8,
    evaluate_every=10_000,
    learner={"n_steps": 256, "batch_size": 256, "gae_lambda": 0.95, "learning_rate": 3e-4},
)
_DQN = Settings(
    steps=100_000,
    learner={
        "learning_rate": 1e-3,
        "batch_size": 64,
        "buffer_size": 50_000,
        "learning_starts": 2_000,
        "gamma": 0.99,
        "target_update_interval": 300,
        "train_freq": 8,
        "gradient_steps": 4,
        "exploration_fraction": 0.3,
        "exploration_final_eps": 0.05,
        "net_arch": [64, 64],
    },
)
_DUELING = replace(
    _DQN, learner={**_DQN.learner, "n_steps": 3, "learning_starts": 5_000, "hold": 2.0}
)
_TD3 = Settings(
    steps=50_000,
    evaluate_every=2_500,
    learner={
        "learning_rate": 1e-3,
        "gamma": 0.99,
        "buffer_size": 200_000,
        "learning_starts": 2_000,
        "noise": 0.1,
        "net_arch": [64, 64],
    },
)
_SAC = Settings(
    steps=50_000,
    evaluate_every=2_500,
    learner={
        "learning_rate": 1e-3,
        "gamma": 0.99,
        "learning_starts": 1_000,
        "net_arch": [64, 64],
    },
)

GENERIC: Mapping[str, Settings] = {
    "ppo": _PPO,
    "dqn": _DQN,
    "duel-ddqn": _DUELING,
    "td3": _TD3,
    "sac": _SAC,
    "ddpg": _TD3,
}

_TORCS = "pirlc/Torcs-v0"
_SPEEDS = ("ndps", "gym_torcs")
"""Rewards that are speeds in km/h, some 200 times as large as metres a step."""

# What the 29 readings of a car that races are like: speedX, angle, trackPos, speedY, speedZ, rpm,
# four wheels, and 19 beams, of which the outer ones are short.
_RACING = Settings(
    steps=90_000,
    evaluate_every=5_000,
    episodes=1,
    repeat=5,
    centre=(0.4, 0.0, 0.0, 0.0, 0.0, 0.6, *(1.0,) * 4, *(0.0,) * 19),
    spread=(0.2, 0.05, 0.5, 0.02, 0.01, 0.2, *(0.5,) * 4, *(0.1,) * 2, *(0.3,) * 15, *(0.1,) * 2),
)
_TORCS_SAC = replace(
    _RACING,
    # Most of the learner's range is no brake at all: with a little of it the car does not start.
    least=(-1.0, -0.5, -3.0),
    most=(1.0, 1.5, 1.0),
    reward_scale=0.2,
    learner={
        "learning_rate": 5e-4,
        "gamma": 0.99,
        "batch_size": 256,
        "buffer_size": 300_000,
        "learning_starts": 1_000,
        "train_freq": 1,
        "gradient_steps": 1,
        "net_arch": [128, 128],
        "ent_coef": "auto_0.05",
        # Braking into a corner takes a second of it, which white noise never tries.
        "noise": [0.1, 0.5, 0.8],
        "drift": 0.1,
        "fade": 0.6,
        "bias": [0.0, 1.0, -1.0],
    },
)
_TORCS_DDPG = replace(
    _RACING,
    steps=50_000,
    reward_scale=0.4,
    learner={
        "learning_rate": 3e-4,
        "gamma": 0.99,
        "tau": 0.005,
        "batch_size": 64,
        "buffer_size": 100_000,
        "learning_starts": 1_000,
        "train_freq": 1,
        "gradient_steps": 1,
        "net_arch": [300, 600],
        "noise": 0.3,
        "drift": 0.15,
        "fade": 0.7,
        "bias": [0.0, 0.5, -2.0],
    },
)

KNOWN: Mapping[tuple[str, str], Settings] = {
    ("CartPole-v1", "ppo"): Settings(
        steps=50_000,
        copies=8,
        scale=False,
        enough=500.0,
        acceptable=495.0,
        attempts=3,
        learner={
            "n_steps": 32,
            "batch_size": 256,
            "n_epochs": 20,
            "gae_lambda": 0.8,
            "gamma": 0.98,
            "ent_coef": 0.0,
            "learning_rate": "lin_0.001",
            "clip_range": "lin_0.2",
        },
    ),
    ("MountainCar-v0", "duel-ddqn"): replace(
        _DUELING,
        steps=80_000,
        acceptable=-104.0,
        attempts=3,
        learner={**_DUELING.learner, "learning_rate": "lin_0.002", "hold": 1.5},
    ),
    ("Acrobot-v1", "ppo"): Settings(
        steps=300_000,
        copies=16,
        evaluate_every=20_000,
        # The bounds of its velocities are far from what occurs.
        scale=False,
        acceptable=-82.0,
        attempts=3,
        patience=8,
        learner={
            "n_steps": 128,
            "batch_size": 256,
            "n_epochs": 6,
            "gae_lambda": 0.94,
            "gamma": 0.99,
            "ent_coef": 0.01,
            "learning_rate": "lin_0.002",
        },
    ),
    ("Pendulum-v1", "sac"): replace(
        _SAC,
        steps=12_000,
        acceptable=-170.0,
        attempts=3,
        learner={**_SAC.learner, "gamma": 0.98, "learning_starts": 500},
    ),
    ("Pendulum-v1", "td3"): replace(
        _TD3, steps=15_000, acceptable=-170.0, attempts=3, learner={**_TD3.learner, "gamma": 0.98}
    ),
    (_TORCS, "sac"): _TORCS_SAC,
    (_TORCS, "ddpg"): _TORCS_DDPG,
}

_PREFERRED = {
    "CartPole-v1": "ppo",
    "MountainCar-v0": "duel-ddqn",
    "Acrobot-v1": "ppo",
    "Pendulum-v1": "sac",
    _TORCS: "sac",
}


def default_algorithm(facts: EnvironmentFacts) -> str:
    """The algorithm for an environment where the user names none."""
    if facts.id in _PREFERRED:
        return _PREFERRED[facts.id]
    return "ppo" if isinstance(facts.actions, DiscreteActions) else "sac"


def default_settings(
    algorithm: str, facts: EnvironmentFacts, arguments: Mapping[str, Scalar]
) -> Settings:
    """The row for an algorithm and an environment with its arguments.

    Raises PirlcError E0611 or E0612.
    """
    if algorithm not in ALGORITHMS:
        raise failure(UnknownAlgorithm(algorithm, suggestion(algorithm, ALGORITHMS), ALGORITHMS))
    discrete = isinstance(facts.actions, DiscreteActions)
    fitting = DISCRETE if discrete else CONTINUOUS
    if algorithm not in fitting:
        raise failure(WrongAlgorithm(algorithm, facts.id, discrete, fitting))
    known = KNOWN.get((facts.id, algorithm))
    if known is not None:
        if facts.id == _TORCS and arguments.get("reward", "ndps") in _SPEEDS:
            known = replace(known, reward_scale=known.reward_scale / 200)
        return _for_components(known, facts.components)
    return replace(GENERIC[algorithm], acceptable=facts.reward_threshold)


def _for_components(settings: Settings, k: int) -> Settings:
    """A row's numbers for each component of an action, when some components are left out."""
    learner = {
        name: value[:k] if name in ("noise", "bias") and isinstance(value, list) else value
        for name, value in settings.learner.items()
    }
    least, most = settings.least[:k], settings.most[:k]
    return replace(settings, least=least, most=most, learner=learner)


@dataclass(frozen=True)
class _Kind:
    """A kind of value: its name in a message, and what is one."""

    words: str
    fits: Callable[[Json], bool]


def _is_number(value: Json) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_count(value: Json) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value > 0


def _kind(name: str) -> _Kind:
    match name:
        case "scale":
            return _Kind("true or false", lambda value: isinstance(value, bool))
        case "enough" | "acceptable":
            return _Kind("a number", lambda value: value is None or _is_number(value))
        case "reward_scale":
            return _Kind("a number", _is_number)
        case "centre" | "spread" | "least" | "most":
            return _Kind(
                "a list of numbers",
                lambda value: isinstance(value, list) and all(map(_is_number, value)),
            )
        case _:
            return _Kind("a count above 0", _is_count)


def with_overrides(settings: Settings, algorithm: str, overrides: Mapping[str, Json]) -> Settings:
    """Settings changed by name: a field of `Settings`, or else an argument of the learner.

    Raises PirlcError E0613 for a value of the wrong kind; unknown learner arguments are found out
    when the learner is made.
    """
    own = {f.name for f in fields(Settings)} - {"learner"}
    changes: dict[str, Any] = {}
    learner = dict(settings.learner)
    for name, value in overrides.items():
        if name not in own:
            learner[name] = value
            continue
        kind = _kind(name)
        if not kind.fits(value):
            reason = f"it must be {kind.words}, not {value!r}"
            raise failure(BadHyperparameter(algorithm, name, reason, None))
        changes[name] = tuple(value) if isinstance(value, list) else value
    return replace(settings, **changes, learner=learner)


_SELDOM = ("episodes", "repeat", "reward_scale", "centre", "spread", "least", "most")
"""Written only where they differ from the default, which keeps older oracles recognisable."""


def settings_as_json(settings: Settings) -> dict[str, Json]:
    data: dict[str, Json] = {}
    for f in fields(Settings):
        value = getattr(settings, f.name)
        if f.name == "learner" or (f.name in _SELDOM and value == f.default):
            continue
        data[f.name] = list(value) if isinstance(value, tuple) else value
    return {**data, "learner": dict(settings.learner)}
