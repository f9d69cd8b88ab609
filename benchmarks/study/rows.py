"""What the study runs: rows, their options, and the environments that they are run on.

Limits are counts, so that every row can be repeated; see `EFFORT` and the rows themselves.
"""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.torcs import paper as torcs_paper


@dataclass(frozen=True)
class Place:
    """An environment and the sketch for it.

    Attributes:
        sketch: the file, from the repository's root.
        exchanged: another environment's id in the sketch, for which this one's is put; None where
            the sketch is used as it is.
        arguments: given on the command line.
        ceiling: the return that no policy exceeds, where an episode can reach it.
    """

    name: str
    sketch: str
    exchanged: str | None = None
    arguments: tuple[str, ...] = ()
    ceiling: float | None = None


CLASSIC_PLACES = (
    Place("CartPole-v0", "examples/cartpole/cartpole.pirl", exchanged="CartPole-v1", ceiling=200.0),
    Place("MountainCar-v0", "examples/mountain_car/mountain_car.pirl"),
    Place("Acrobot-v1", "examples/acrobot/acrobot.pirl"),
    Place("CartPole-v1", "examples/cartpole/cartpole.pirl", ceiling=500.0),
    Place("Pendulum-v1", "examples/pendulum/pendulum.pirl"),
)
"""The paper's three first."""

TORCS_PLACES = tuple(
    Place(track, "examples/torcs/paper.pirl", arguments=("--argument", f"track={track}"))
    for track in torcs_paper.TRAINING
)

CLASSIC, TORCS = "classic", "torcs"
REFINED = " refined"
"""Ends the names of rows whose parameters were refined on return."""


@dataclass(frozen=True)
class Synthesis:
    """A row that `pirlc synth` fills, with these options.

    Attributes:
        usual: it is run where no row is asked for.
        places: the environments that it is run on where none is asked for; None: all.
    """

    method: str
    options: tuple[str, ...] = ()
    usual: bool = True
    places: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Teacher:
    """The oracle itself: the paper's row DRL."""

    method: str = "DRL"
    usual: bool = True
    places: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Lowest:
    """The worst that a constant action earns: the paper's row Minimum."""

    method: str = "minimum"
    usual: bool = True
    places: tuple[str, ...] | None = None


Row = Synthesis | Teacher | Lowest

_BAYES = ("--optimizer", "bayes", "--trials", "25", "--pool", "16", "--budget", "72")
_SMT = ("--optimizer", "smt", "--pool", "16", "--budget", "72")
"""Counts with which Algorithm 1 has one turn of its loop after `initialize`."""
_CASADI = ("--optimizer", "casadi")
_ALONE = ("--no-refine",)

_PAPERS = ("CartPole-v0", "MountainCar-v0", "Acrobot-v1")
_VARIED = (*_PAPERS, "Pendulum-v1")


def _both(
    method: str, options: tuple[str, ...], places: tuple[str, ...] | None
) -> tuple[Synthesis, Synthesis]:
    """A row before refinement on return, and the same refined, which is run if it is asked for."""
    alone = Synthesis(method, (*options, *_ALONE), places=places)
    return alone, Synthesis(method + REFINED, options, usual=False, places=places)


CLASSIC_ROWS: tuple[Row, ...] = (
    Teacher(),
    Synthesis("NDPS-CasADi", (*_CASADI, *_ALONE), places=_PAPERS),
    *_both("NDPS-SMT", _SMT, _PAPERS),
    *_both("NDPS-BOPT", _BAYES, _PAPERS),
    Lowest(),
    # `pirlc synth` with nothing but its defaults.
    Synthesis("synth", places=tuple(p.name for p in CLASSIC_PLACES if p.exchanged is None)),
    *_both("Naive", ("--no-oracle", "--pool", "24"), _VARIED),
    *_both("NoAug", (*_CASADI, "--no-augment"), _VARIED),
    *_both("NoSketch", (*_CASADI, "--no-sketch"), _VARIED),
    *_both("NoIF", (*_CASADI, "--no-if"), _VARIED),
)
"""In the order in which they are run."""

# The limit of every program's row, where the paper has twelve hours: this many tunings and races.
_LIMIT = ("--budget", "4000")

TORCS_ROWS: tuple[Row, ...] = (
    Teacher(),
    Synthesis("Naive", ("--no-oracle", *_LIMIT)),
    Synthesis("NoAug", (*_CASADI, "--no-augment", *_LIMIT)),
    Synthesis("NoSketch", (*_CASADI, "--no-sketch", *_LIMIT)),
    Synthesis("NoIF", (*_CASADI, "--no-if", *_LIMIT)),
    Synthesis("NDPS", (*_CASADI, *_LIMIT)),
)

ROWS: dict[str, tuple[Row, ...]] = {CLASSIC: CLASSIC_ROWS, TORCS: TORCS_ROWS}
PLACES: dict[str, tuple[Place, ...]] = {CLASSIC: CLASSIC_PLACES, TORCS: TORCS_PLACES}
SEEDS: dict[str, tuple[int, ...]] = {CLASSIC: (0, 1, 2), TORCS: (0,)}


def place(environment: str) -> Place:
    """Of an environment of any suite. Raises KeyError."""
    return {place.name: place for places in PLACES.values() for place in places}[environment]
