"""How learners of continuous actions explore: noise that fades, and where they start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.noise import ActionNoise

from pirlc.oracle.manifest import Json
from pirlc.oracle.problems import BadHyperparameter, failure
from pirlc.oracle.training import Training


class Wandering(ActionNoise):
    """Ornstein and Uhlenbeck's process, one step a call.

    `size`: its standard deviation, shape (k,). `drift`: the share of the way back to 0 that it goes
    in a step; 1 gives white noise. After `fade` calls a tenth of it is left (0: it does not fade).
    """

    def __init__(
        self, size: NDArray[np.float64], drift: float, fade: int, random: np.random.Generator
    ) -> None:
        super().__init__()
        self.size, self.drift, self.fade = size, drift, fade
        self._random = random
        self._calls = 0
        self._now = np.zeros_like(size)

    def __call__(self) -> NDArray[np.float64]:
        kick = np.sqrt(1.0 - (1.0 - self.drift) ** 2)
        noise = self._random.standard_normal(self.size.shape)
        self._now = (1.0 - self.drift) * self._now + kick * noise
        left = 1.0 if self.fade == 0 else max(0.1, 1.0 - 0.9 * self._calls / self.fade)
        self._calls += 1
        return left * self.size * self._now

    def reset(self) -> None:
        """A new episode: the noise is as it is in the long run, not at 0."""
        self._now = self._random.standard_normal(self.size.shape)

    def __deepcopy__(self, memo: dict[int, Any]) -> Wandering:
        """Stable-Baselines3 copies the noise for each of several environments: each its own."""
        return Wandering(self.size, self.drift, self.fade, self._random.spawn(1)[0])


@dataclass(frozen=True)
class Exploration:
    """`bias`: shape (k,), what the untrained network's last layer gives."""

    noise: Wandering | None
    bias: NDArray[np.float64] | None


def exploration_of(training: Training, given: Mapping[str, Json], seed: int) -> Exploration:
    """The exploration that the learner's hyperparameters ask for. Raises PirlcError E0613."""
    k, algorithm = training.facts.components, training.algorithm

    def refuse(name: str, reason: str) -> BadHyperparameter:
        return BadHyperparameter(algorithm, name, reason, None)

    def share(name: str, default: float) -> float:
        value = given.get(name, default)
        if not _is_number(value) or not 0.0 < float(value) <= 1.0:  # type: ignore[arg-type]
            raise failure(refuse(name, f"it must be above 0 and at most 1, not {value!r}"))
        return float(value)  # type: ignore[arg-type]

    def components(name: str) -> NDArray[np.float64] | None:
        value = given.get(name)
        if value is None:
            return None
        numbers = value if isinstance(value, list) else [value] * k
        if not all(map(_is_number, numbers)):
            raise failure(refuse(name, f"it must be a number or a list of them, not {value!r}"))
        if len(numbers) != k:
            reason = f"it has {len(numbers)} numbers, and an action {k} components"
            raise failure(refuse(name, reason))
        return np.array(numbers, dtype=np.float64)

    size, bias, drift = components("noise"), components("bias"), share("drift", 1.0)
    if size is None:
        return Exploration(None, bias)
    settings = training.settings
    calls = settings.steps // settings.copies
    fade = int(share("fade", 1.0) * calls) if "fade" in given else 0
    return Exploration(Wandering(size, drift, fade, np.random.default_rng(seed)), bias)


def _is_number(value: Json) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def acting_from_the_start(learner: Any) -> Any:
    """The learner's class, acting by its network also before learning starts."""

    def sample(self: Any, learning_starts: int, *arguments: Any, **named: Any) -> Any:
        del learning_starts
        return learner._sample_action(self, 0, *arguments, **named)

    return type(learner.__name__, (learner,), {"_sample_action": sample})


def set_bias(policy: Any, bias: NDArray[np.float64]) -> None:
    """Let an untrained TD3, DDPG or SAC policy act around a place of its own."""
    actor = policy.actor
    last = actor.mu if hasattr(actor, "latent_pi") else actor.mu[-2]
    for one in (last, *_target(policy)):
        with torch.no_grad():
            one.bias.copy_(torch.as_tensor(bias, dtype=one.bias.dtype))


def _target(policy: Any) -> tuple[Any, ...]:
    target = getattr(policy, "actor_target", None)
    return () if target is None else (target.mu[-2],)
