"""The mistakes in what a TORCS environment is asked to be (codes E0527 to E0531)."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import assert_never

from pirlc.diagnostics import Diagnostic, PirlcError, suggestion


class BadArgument(PirlcError, ValueError):
    """Also a ValueError: that is what environments raise for what they cannot be."""


@dataclass(frozen=True)
class UnknownTrack:
    track: str
    known: tuple[str, ...]


@dataclass(frozen=True)
class UnknownCar:
    car: str
    known: tuple[str, ...]


@dataclass(frozen=True)
class UnknownPreset:
    kind: str
    """`reward` or `termination`."""
    name: str
    known: tuple[str, ...]


@dataclass(frozen=True)
class UnknownReading:
    name: str
    known: tuple[str, ...]


@dataclass(frozen=True)
class BadValue:
    argument: str
    value: str
    wanted: str


Problem = UnknownTrack | UnknownCar | UnknownPreset | UnknownReading | BadValue

_LISTED = 10
"""Names in a help; more are no help."""


def describe(problem: Problem) -> Diagnostic:
    """The problem in words."""
    match problem:
        case UnknownTrack(track, known):
            message = f"TORCS has no track called `{track}`"
            return Diagnostic("E0527", message, help=_instead(track, known, "tracks"))
        case UnknownCar(car, known):
            message = f"TORCS has no car called `{car}`"
            return Diagnostic("E0528", message, help=_instead(car, known, "cars"))
        case UnknownPreset(kind, name, known):
            message = f"the TORCS environment has no {kind} called `{name}`"
            return Diagnostic("E0529", message, help=_instead(name, known, f"{kind}s"))
        case UnknownReading(name, known):
            message = f"the TORCS environment has no reading called `{name}` to block"
            return Diagnostic("E0530", message, help=_instead(name, known, "readings"))
        case BadValue(argument, value, wanted):
            message = f"the TORCS environment's argument `{argument}` cannot be {value}"
            return Diagnostic("E0531", message, help=f"it is {wanted}")
        case _:
            assert_never(problem)


def _instead(name: str, known: Sequence[str], plural: str) -> str:
    similar = suggestion(name, known)
    if similar is not None:
        return f"did you mean `{similar}`?"
    listed = ", ".join(f"`{one}`" for one in known[:_LISTED])
    rest = f" and {len(known) - _LISTED} more" if len(known) > _LISTED else ""
    return f"its {plural} are {listed}{rest}"


def failure(problem: Problem) -> BadArgument:
    return BadArgument(describe(problem))


def require_track(track: object, known: Collection[str]) -> str:
    """Raises BadArgument E0527."""
    if not isinstance(track, str) or track not in known:
        raise failure(UnknownTrack(str(track), tuple(sorted(known))))
    return track


def require_car(car: object, known: Collection[str]) -> str:
    """Raises BadArgument E0528."""
    if not isinstance(car, str) or car not in known:
        raise failure(UnknownCar(str(car), tuple(sorted(known))))
    return car


def require_preset(kind: str, name: object, known: Collection[str]) -> str:
    """Raises BadArgument E0529."""
    if not isinstance(name, str) or name not in known:
        raise failure(UnknownPreset(kind, str(name), tuple(known)))
    return name


def require_readings(names: object, known: Sequence[str]) -> tuple[str, ...]:
    """The names in a text that separates them by commas. Raises BadArgument E0530."""
    if not isinstance(names, str):
        wanted = "a text of names with commas between them"
        raise failure(BadValue("blocked", repr(names), wanted))
    listed = tuple(name.strip() for name in names.split(",") if name.strip())
    for name in listed:
        if name not in known:
            raise failure(UnknownReading(name, tuple(known)))
    return listed


def require_whole(argument: str, value: object, most: int) -> int:
    """Raises BadArgument E0531 for what is not a whole number from 0 to `most`."""
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= most:
        wanted = f"a whole number from 0 to {most:,}"
        raise failure(BadValue(argument, repr(value), wanted))
    return value


def require_real(
    argument: str, value: object, upper: float = math.inf, closed: bool = True
) -> float:
    """Raises BadArgument E0531 for what is not a number from 0 to `upper`."""
    real = isinstance(value, int | float) and not isinstance(value, bool)
    number = float(value) if real else math.nan  # type: ignore[arg-type]
    if math.isfinite(number) and (0 <= number < upper or (closed and number == upper)):
        return number
    if math.isinf(upper):
        wanted = "a number from 0 on"
    elif closed:
        wanted = f"a number from 0 to {upper:g}"
    else:
        wanted = f"a number from 0 to {upper:g}, less than {upper:g}"
    raise failure(BadValue(argument, repr(value), wanted))


def require_switch(argument: str, value: object) -> bool:
    """Raises BadArgument E0531 for what is neither true nor false (or 1 or 0)."""
    if value not in (0, 1):
        raise failure(BadValue(argument, repr(value), "true or false"))
    return bool(value)
