"""Why there is no plant (codes E0930 to E0936)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

from pirlc.diagnostics import Diagnostic, PirlcError


@dataclass(frozen=True)
class UnknownOperatingPoint:
    id: str
    name: str
    known: tuple[str, ...]


@dataclass(frozen=True)
class NoEquations:
    id: str


@dataclass(frozen=True)
class NotResettable:
    """The environment cannot be put into a chosen state."""

    id: str
    reason: str


@dataclass(frozen=True)
class NoEquilibrium:
    """No state near the program's trajectory stays as it is. `drift`: how much changes in a step,
    in the environment's units."""

    id: str
    drift: float


@dataclass(frozen=True)
class TooShort:
    """Rollouts with too few usable steps to identify anything."""

    id: str
    steps: int
    needed: int


@dataclass(frozen=True)
class NotExcited:
    """An action, or a sensor, that did not change in the rollouts."""

    id: str
    what: str
    name: str


@dataclass(frozen=True)
class NoSensorRead:
    policy: str


Problem = (
    UnknownOperatingPoint
    | NoEquations
    | NotResettable
    | NoEquilibrium
    | TooShort
    | NotExcited
    | NoSensorRead
)


def describe(problem: Problem) -> Diagnostic:
    match problem:
        case UnknownOperatingPoint(name, point, known):
            listed = ", ".join(f"`{other}`" for other in known)
            return Diagnostic(
                "E0930",
                f"`{name}` has no operating point called `{point}`",
                help=f"it has {listed}"
                if known
                else "only environments with known equations have named operating points; "
                "others are taken where the program leads them",
            )
        case NoEquations(name):
            return Diagnostic(
                "E0931",
                f"no equations are known for the environment `{name}` with its arguments",
                help="find the plant by differences in the simulator, or identify it from rollouts",
            )
        case NotResettable(name, reason):
            return Diagnostic(
                "E0932",
                f"the environment `{name}` cannot be put into a chosen state",
                notes=(reason,),
                help="identify the plant from rollouts",
            )
        case NoEquilibrium(name, drift):
            return Diagnostic(
                "E0933",
                f"no equilibrium of `{name}` was found where the program leads it",
                notes=(f"nearest to rest, a step still changes the state by {drift:.3g}",),
                help="identify the plant from rollouts",
            )
        case TooShort(name, steps, needed):
            return Diagnostic(
                "E0934",
                f"the rollouts in `{name}` have {steps} usable steps, too few to identify a plant",
                notes=(f"at least {needed} are needed",),
                help="roll out more or longer episodes; does the program survive its first steps?",
            )
        case NotExcited(name, what, which):
            return Diagnostic(
                "E0935",
                f"{what} `{which}` did not change in the rollouts in `{name}`",
                notes=("nothing can be identified from what stands still",),
                help="a larger dither, or an operating point at which the action is not saturated",
            )
        case NoSensorRead(policy):
            return Diagnostic(
                "E0936",
                f"the actions of policy `{policy}` read no sensor",
                notes=("without feedback there is no loop to analyse",),
            )
        case _:
            assert_never(problem)


def failure(problem: Problem) -> PirlcError:
    return PirlcError(describe(problem))
