"""What a synthesis is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pirlc.ir.policy import Scalar
from pirlc.oracle.manifest import Json
from pirlc.search.settings import Settings
from pirlc.search.synthesis import Plan
from pirlc.simulation.workers import ALONE, Workers
from pirlc.source import SourceText
from pirlc.tune.how import Optimizer, Tuning


@dataclass(frozen=True)
class OracleRequest:
    """Where the oracle comes from: `origin` (a path or ``module:function``), or training.

    Without an origin one that comes with the sketch is taken, if it fits and `shipped` says so,
    rather than training one.
    """

    origin: str | None = None
    shipped: bool = True
    algorithm: str | None = None
    seed: int | None = None
    overrides: Mapping[str, Json] = field(default_factory=dict)


@dataclass(frozen=True)
class SynthesisRequest:
    """What `pirlc synth` was asked for.

    `settings` None takes those that suit the environment, with `seed`, `optimizer`, `tuning` and,
    where they are given, `largest` and `pool`. `oracle` None searches by return alone. `calls` and
    `seconds` bound the search. `episodes` are those of the evaluation at the end (None: as many as
    suit the environment); `cache` is where trained oracles are kept. `arguments` of the environment
    take the place of the sketch's. `pick` takes the program of this number on the front (counted
    from 1) in place of the search's own.
    """

    source: SourceText
    folder: Path
    cache: Path
    oracle: OracleRequest | None = field(default_factory=OracleRequest)
    settings: Settings | None = None
    seed: int = 0
    largest: int | None = None
    pool: int | None = None
    optimizer: Optimizer | None = None
    tuning: Tuning = field(default_factory=Tuning)
    plan: Plan = field(default_factory=Plan)
    calls: int | None = None
    seconds: float | None = None
    episodes: int | None = None
    workers: Workers = ALONE
    arguments: tuple[tuple[str, Scalar], ...] = ()
    trust: bool = False
    pick: int | None = None
