"""Programs met by a search, and how good they are."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from pirlc.ir.expansion import Derivation, Expansion, expand
from pirlc.ir.policy import Program, Sketch


@dataclass(frozen=True)
class Candidate:
    """A template with values for its parameters.

    `loss` is what tuning minimised: the distance to the oracle (0 to 1 for discrete actions), or,
    without an oracle, minus the mean return; infinite where it was not measured. `returns` are
    those of single episodes, from seeds that all candidates share; None for a candidate that was
    not simulated.
    """

    expansion: Expansion
    values: tuple[tuple[str, float], ...]
    loss: float
    returns: tuple[float, ...] | None = None

    @cached_property
    def program(self) -> Program:
        return self.expansion.template.close(dict(self.values))

    @property
    def size(self) -> int:
        return self.expansion.template.size

    @property
    def mean(self) -> float:
        """The mean of the returns; minus infinity where there are none."""
        return -float("inf") if self.returns is None else float(np.mean(self.returns))

    def with_returns(self, returns: NDArray[np.float64]) -> Candidate:
        return replace(self, returns=tuple(float(r) for r in returns))


def within_noise(one: Candidate, other: Candidate) -> bool:
    """Whether the mean returns differ by less than the 95 % interval of their paired difference.

    Of a single episode no noise can be told: then only equal returns are within it.
    """
    assert one.returns is not None
    assert other.returns is not None
    difference = np.array(one.returns) - np.array(other.returns)
    if len(difference) == 1:
        return bool(difference[0] == 0.0)
    spread = float(np.std(difference, ddof=1)) / len(difference) ** 0.5
    return bool(abs(np.mean(difference)) <= 1.96 * spread)


def choose(candidates: list[Candidate]) -> Candidate:
    """The best by return, or the shortest of those whose return is within its noise."""
    best = max(candidates, key=lambda c: (c.mean, -c.size))
    equal = [c for c in candidates if c is best or within_noise(c, best)]
    return min(equal, key=lambda c: (c.size, -c.mean))


class Entry(TypedDict):
    """A line of the record: enough to build the program again from the sketch."""

    stage: str
    size: int
    loss: float | None
    mean_return: float | None
    episodes: int
    values: dict[str, float]
    derivations: list[Any]


def as_entry(candidate: Candidate, stage: str) -> Entry:
    return {
        "stage": stage,
        "size": candidate.size,
        "loss": candidate.loss if math.isfinite(candidate.loss) else None,
        "mean_return": None if candidate.returns is None else candidate.mean,
        "episodes": len(candidate.returns or ()),
        "values": dict(candidate.values),
        "derivations": [_plain(d) for d in candidate.expansion.derivations],
    }


def from_entry(sketch: Sketch, entry: Entry) -> Candidate:
    """The candidate of a line of the record, without its returns."""
    derivations = tuple(_derivation(d) for d in entry["derivations"])
    loss = math.inf if entry["loss"] is None else entry["loss"]
    values = tuple(sorted(entry["values"].items()))
    return Candidate(expand(sketch, derivations), values, loss)


def _plain(derivation: Derivation) -> list[Any]:
    return [derivation.alternative, *(_plain(child) for child in derivation.children)]


def _derivation(entry: list[Any]) -> Derivation:
    return Derivation(int(entry[0]), tuple(_derivation(child) for child in entry[1:]))
