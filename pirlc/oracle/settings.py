"""How oracles are trained by default: one row an algorithm, and better ones for known problems.

The rows follow Stable-Baselines3's defaults and RL Baselines3 Zoo's tuned values, shortened by
measurement; docs/oracles.md tells what they reach in what time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

from pirlc.diagnostics import suggestion
from pirlc.oracle.manifest import Json
from pirlc.oracle.problems import BadHyperparameter, UnknownAlgorithm, WrongAlgorithm, failure
from pirlc.simulation.environments import DiscreteActions, EnvironmentFacts

DISCRETE = ("ppo", "dqn", "duel-ddqn")
CONTINUOUS = ("ppo", "td3", "sac", "ddpg")
ALGORITHMS = ("ppo", "dqn", "duel-ddqn", "td3", "sac", "ddpg")


@dataclass(frozen=True)
class Settings:
    """One training.

    `steps`: environment steps of one attempt, at most. `copies`: environments stepped in turn.
    `evaluate_every`: steps between evaluations. `scale`: bounded observations are mapped onto
    [-1, 1]. `enough`: a mean return at which training stops at once; `acceptable`: one below which
    another attempt is made, up to `attempts`. None: unknown. `patience`: evaluations without
    progress, once acceptable, after which training stops. `learner`: the arguments of the
    algorithm's constructor; ``"lin_0.001"`` falls linearly to 0, as in RL Baselines3 Zoo;
    `noise` is the standard deviation of TD3's and DDPG's exploration.
    """

    steps: int
    copies: int = 1
    evaluate_every: int = 5_000
    scale: bool = True
    enough: float | None = None
    acceptable: float | None = None
    attempts: int = 1
    patience: int = 6
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
}

_PREFERRED = {
    "CartPole-v1": "ppo",
    "MountainCar-v0": "duel-ddqn",
    "Acrobot-v1": "ppo",
    "Pendulum-v1": "sac",
}


def default_algorithm(facts: EnvironmentFacts) -> str:
    """The algorithm for an environment where the user names none."""
    if facts.id in _PREFERRED:
        return _PREFERRED[facts.id]
    return "ppo" if isinstance(facts.actions, DiscreteActions) else "sac"


def default_settings(algorithm: str, facts: EnvironmentFacts) -> Settings:
    """The row for an algorithm and an environment. Raises PirlcError E0611 or E0612."""
    if algorithm not in ALGORITHMS:
        raise failure(UnknownAlgorithm(algorithm, suggestion(algorithm, ALGORITHMS), ALGORITHMS))
    discrete = isinstance(facts.actions, DiscreteActions)
    fitting = DISCRETE if discrete else CONTINUOUS
    if algorithm not in fitting:
        raise failure(WrongAlgorithm(algorithm, facts.id, discrete, fitting))
    known = KNOWN.get((facts.id, algorithm))
    if known is not None:
        return known
    return replace(GENERIC[algorithm], acceptable=facts.reward_threshold)


def with_overrides(settings: Settings, algorithm: str, overrides: Mapping[str, Json]) -> Settings:
    """Settings changed by name: a field of `Settings`, or else an argument of the learner.

    Raises PirlcError E0613 for a value of the wrong kind; unknown learner arguments are found out
    when the learner is made.
    """
    own = {f.name for f in fields(Settings)} - {"learner"}
    changes: dict[str, Json] = {}
    learner = dict(settings.learner)
    for name, value in overrides.items():
        if name not in own:
            learner[name] = value
            continue
        optional = name in ("enough", "acceptable")
        if name == "scale":
            fits = isinstance(value, bool)
        elif optional:
            fits = value is None or (isinstance(value, int | float) and not isinstance(value, bool))
        else:
            fits = isinstance(value, int) and not isinstance(value, bool) and value > 0
        if not fits:
            wanted = (
                "true or false"
                if name == "scale"
                else "a number"
                if optional
                else "a count above 0"
            )
            reason = f"it must be {wanted}, not {value!r}"
            raise failure(BadHyperparameter(algorithm, name, reason, None))
        changes[name] = value
    return replace(settings, **changes, learner=learner)  # type: ignore[arg-type]


def settings_as_json(settings: Settings) -> dict[str, Json]:
    data: dict[str, Json] = {
        f.name: getattr(settings, f.name) for f in fields(Settings) if f.name != "learner"
    }
    return {**data, "learner": dict(settings.learner)}
