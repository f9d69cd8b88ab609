"""What a program makes of actions before: rate limits, hysteresis, memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from fractions import Fraction

from pirlc.analyze.reading.sums import Atom, Compare, Function, Guard, Sum
from pirlc.analyze.reading.wording import number
from pirlc.analyze.tangent import Earlier


def previous_texts(
    action: str, laws: Iterable[Sum], guards: Iterable[tuple[int, Guard]]
) -> tuple[str, ...]:
    """In words, each thing once. `guards`: the conditions of each branch."""
    found: dict[str, None] = {}
    for law in laws:
        for function in functions_of(law):
            found |= dict.fromkeys(_rate_limit(function))
    by_name: dict[str, list[int]] = {}
    for number_, guard in guards:
        for name in earlier_in(guard):
            by_name.setdefault(name, []).append(number_)
    for name, branches in by_name.items():
        listed = ", ".join(map(str, dict.fromkeys(branches)))
        what = "its own last value" if name == action else f"the last {name}"
        plural = "branch" if len(set(branches)) == 1 else "branches"
        found[f"hysteresis: {what} decides with the readings on {plural} {listed}"] = None
    return tuple(found)


def functions_of(total: Sum) -> Iterator[Function]:
    """All functions in a sum, the outer ones first."""
    for atom, _ in total.terms:
        if isinstance(atom, Function):
            yield atom
            for argument in atom.arguments:
                yield from functions_of(argument)


def atoms_of(total: Sum) -> Iterator[Atom]:
    """All readings and earlier actions that a sum depends on."""
    for atom, _ in total.terms:
        if isinstance(atom, Function):
            for argument in atom.arguments:
                yield from atoms_of(argument)
            if atom.condition is not None:
                yield from atoms_in(atom.condition)
        else:
            yield atom


def atoms_in(guard: Guard) -> Iterator[Atom]:
    if isinstance(guard, Compare):
        yield from atoms_of(guard.sum)
        return
    for part in guard.parts:
        yield from atoms_in(part)


def earlier_in(guard: Guard) -> Iterator[str]:
    for atom in atoms_in(guard):
        if isinstance(atom, Earlier):
            yield atom.action


def _rate_limit(function: Function) -> Iterator[str]:
    match function:
        case Function("clip", (_, low, high)):
            down, up = _step(low), _step(high)
            if down is not None and up is not None and down[0] == up[0]:
                yield (
                    f"rate limit: changes by {number(down[1])} to {number(up[1])} of the last "
                    f"{down[0]} in a step"
                )
        case Function("min" | "max" as name, arguments):
            for argument in arguments:
                step = _step(argument)
                if step is not None:
                    way = "rises by at most" if name == "min" else "falls by at most"
                    yield f"rate limit: {way} {number(abs(step[1]))} from the last {step[0]}"
        case _:
            pass


def _step(total: Sum) -> tuple[str, Fraction] | None:
    """`previous(A) + r`."""
    match total:
        case Sum(constant, ((Earlier(action), weight),)) if weight == 1:
            return action, constant
        case _:
            return None
