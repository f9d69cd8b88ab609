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
    """

    method: str
    options: tuple[str, ...] = ()
    usual: bool = True


@dataclass(frozen=True)
class Teacher:
    """The oracle itself: the paper's row DRL."""

    method: str = "DRL"
    usual: bool = True


@dataclass(frozen=True)
class Lowest:
    """The worst that a constant action earns: the paper's row Minimum."""

    method: str = "minimum"
    usual: bool = True


Row = Synthesis | Teacher | Lowest

_BAYES = ("--optimizer", "bayes", "--trials", "50", "--pool", "40")
_SMT = ("--optimizer", "smt", "--pool", "40")
_CASADI = ("--optimizer", "casadi")
_ALONE = ("--no-refine",)

CLASSIC_ROWS: tuple[Row, ...] = (
    Teacher(),
    Synthesis("NDPS-CasADi", (*_CASADI, *_ALONE)),
    Synthesis("NDPS-SMT", (*_SMT, *_ALONE)),
    Synthesis("NDPS-BOPT", (*_BAYES, *_ALONE)),
    Lowest(),
    Synthesis("Naive", ("--no-oracle", *_ALONE)),
    Synthesis("NoAug", (*_CASADI, "--no-augment", *_ALONE)),
    Synthesis("NoSketch", (*_CASADI, "--no-sketch", *_ALONE)),
    Synthesis("NoIF", (*_CASADI, "--no-if", *_ALONE)),
    # `pirlc synth` with nothing but its defaults.
    Synthesis("synth"),
    Synthesis("NDPS-SMT" + REFINED, _SMT, usual=False),
    Synthesis("NDPS-BOPT" + REFINED, _BAYES, usual=False),
    Synthesis("Naive" + REFINED, ("--no-oracle",), usual=False),
    Synthesis("NoAug" + REFINED, (*_CASADI, "--no-augment"), usual=False),
    Synthesis("NoSketch" + REFINED, (*_CASADI, "--no-sketch"), usual=False),
    Synthesis("NoIF" + REFINED, (*_CASADI, "--no-if"), usual=False),
)

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
