"""What a run went without."""

from __future__ import annotations

from collections.abc import Mapping

_LEFT_OUT = {
    "augment": "--no-augment",
    "sketch": "--no-sketch",
    "branches": "--no-if",
    "refine": "--no-refine",
}


def left_out(oracle: object | None, plan: Mapping[str, bool]) -> tuple[str, ...]:
    """The options by which a run goes without an oracle and without parts of a `Plan`."""
    by_return = ("--no-oracle",) if oracle is None else ()
    return (*by_return, *(option for part, option in _LEFT_OUT.items() if not plan.get(part, True)))
