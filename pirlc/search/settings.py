"""What a search may be told, and who it is told to. Budgets are counts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from pirlc.search.candidate import Candidate
from pirlc.tune.how import Optimizer, Tuning


@dataclass(frozen=True)
class Settings:
    """The knobs of a search; the defaults suit problems of the size of classic control.

    Attributes:
        seed: of everything random in the search.
        largest: the largest size of a program template, of all actions together.
        create_episodes: episodes of the oracle that `create_histories` records.
        update_episodes: episodes of the program that `update_histories` adds.
        histories: the histories that tuning and distances look at (a random sample).
        pool: the templates that `initialize` tunes, shortest first.
        neighbours: the templates that `neighborhood_pool` returns.
        growth: how much larger a regenerated subexpression may be than the one that is elided.
        per_move: the subexpressions that each move tries at one place.
        iterations: the most turns of Algorithm 1's loop.
        simulated: how many of the closest programs are simulated at each stage.
        episodes: episodes of `collect_reward`.
        refined: how many structures the refinement on return starts with.
        refine_episodes: the episodes that the refinement may simulate.
        climb_episodes: the episodes of each program of a generation: few, for many noisy
            generations get further than few exact ones.
        climb_step: the first step of the refinement, in the natural scales of the parameters.
        optimizer: finds the parameters of a template; None: the one that measures best.
        tuning: how long it may look.
    """

    seed: int = 0
    largest: int = 60
    create_episodes: int = 24
    update_episodes: int = 12
    histories: int = 4000
    pool: int = 160
    neighbours: int = 32
    growth: int = 14
    per_move: int = 12
    iterations: int = 4
    simulated: int = 12
    episodes: int = 100
    refined: int = 4
    refine_episodes: int = 40_000
    climb_episodes: int = 10
    climb_step: float = 0.3
    optimizer: Optimizer | None = None
    tuning: Tuning = field(default_factory=Tuning)


def default_settings(*, actions: int = 1, native: bool = False) -> Settings:
    """The settings for a sketch of this many actions.

    `native`: the environment runs compiled programs by itself. It does so because an episode is
    costly: three minutes of a race in TORCS take a tenth of a second, an episode of CartPole a
    few milliseconds.
    """
    settings = Settings(largest=Settings.largest * actions)
    if not native:
        return settings
    return replace(
        settings,
        create_episodes=6,
        update_episodes=3,
        episodes=8,
        refined=2,
        refine_episodes=3_000,
        climb_episodes=1,
        climb_step=0.1,
    )


@dataclass(frozen=True)
class Progress:
    """How far a stage is: `done` of `total` steps of it, and the best program so far."""

    stage: str
    done: int
    total: int
    best: Candidate | None = None


Tell = Callable[[Progress], None]


@dataclass(frozen=True)
class Measured:
    """A template that optimisers were compared on, with the distance that each one reached."""

    size: int
    parameters: int
    distances: Mapping[str, float]


@dataclass(frozen=True)
class Choice:
    """The optimiser that a search tunes with, and why.

    `means` are mean distances over the `measured` templates, by optimiser; `seconds` how long each
    took for them on this machine, where this run measured it (a run that is resumed reads what was
    measured). All are empty where nothing was to be measured.
    """

    optimizer: Optimizer
    why: str
    means: Mapping[Optimizer, float] = field(default_factory=dict)
    measured: tuple[Measured, ...] = ()
    seconds: Mapping[Optimizer, float] = field(default_factory=dict)
