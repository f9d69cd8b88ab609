"""Drops what no action depends on: compilers warn of it, and it would lengthen buffers."""

from __future__ import annotations

from collections.abc import Set as AbstractSet
from typing import assert_never

from pirlc.ir.controller import (
    Branch,
    Declare,
    Define,
    Local,
    Loop,
    Set,
    Statement,
    expressions,
)


def without_unused(
    statements: tuple[Statement, ...], results: AbstractSet[str]
) -> tuple[Statement, ...]:
    """The statements that the locals named in `results` depend on."""
    needed = set(results)
    while True:
        kept = _filtered(statements, needed)
        read = {e.name for e in expressions(kept) if isinstance(e, Local)}
        if read <= needed:
            return kept
        needed |= read


def _filtered(statements: tuple[Statement, ...], needed: set[str]) -> tuple[Statement, ...]:
    kept: list[Statement] = []
    for statement in statements:
        match statement:
            case Define(local) | Declare(local) | Set(local):
                if local.name in needed:
                    kept.append(statement)
            case Branch(condition, consequent, alternative):
                taken, other = _filtered(consequent, needed), _filtered(alternative, needed)
                if taken or other:
                    kept.append(Branch(condition, taken, other))
            case Loop(index, body):
                inside = _filtered(body, needed)
                if inside:
                    kept.append(Loop(index, inside))
            case _:
                assert_never(statement)
    return tuple(kept)
