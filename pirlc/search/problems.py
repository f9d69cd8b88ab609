"""What is told about optimisers that cannot take a sketch's templates (E0430 to E0432)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import assert_never

from pirlc.diagnostics import Diagnostic, PirlcError, Severity
from pirlc.tune.how import Optimizer


@dataclass(frozen=True)
class NothingSuits:
    """`reasons`: why the optimiser cannot take each of the templates tried at first."""

    optimizer: Optimizer
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class LeftOut:
    """Some of the `templates` of a stage, with the reasons why, are not tuned; a warning."""

    optimizer: Optimizer
    reasons: tuple[str, ...]
    templates: int


@dataclass(frozen=True)
class Unanswered:
    """Templates that an optimiser came to no end with, each with what it notes; a warning."""

    optimizer: Optimizer
    notes: tuple[str, ...]
    stage: str


Problem = NothingSuits | LeftOut | Unanswered

_SHOWN = 3
_HELP = "`--optimizer casadi` takes every template; `--optimizer auto` takes the best that can"


def error(problem: Problem) -> PirlcError:
    return PirlcError(describe(problem))


def describe(problem: Problem) -> Diagnostic:
    """The problem in words."""
    match problem:
        case NothingSuits(optimizer, reasons):
            return Diagnostic(
                "E0430",
                f"`{optimizer}` can take none of the sketch's {len(reasons):,} shortest templates",
                notes=tuple(_counted(reasons)),
                help=_HELP,
            )
        case LeftOut(optimizer, reasons, templates):
            return Diagnostic(
                "E0431",
                f"`{optimizer}` cannot take {len(reasons):,} of {templates:,} templates, which are "
                "left out",
                notes=(*_counted(reasons), "the same goes for templates met later"),
                help=_HELP,
                severity=Severity.WARNING,
            )
        case Unanswered(optimizer, notes, stage):
            return Diagnostic(
                "E0432",
                f"`{optimizer}` has no answer for {len(notes):,} "
                f"template{'s' * (len(notes) > 1)} ({stage})",
                notes=tuple(f"{count:,}: {note}" for note, count in Counter(notes).most_common()),
                help="leave `--optimizer` out, or look at shorter programs with `--max-size`",
                severity=Severity.WARNING,
            )
        case _:
            assert_never(problem)


def _counted(reasons: Iterable[str]) -> Iterable[str]:
    """The commonest reasons, each with how often it holds."""
    for reason, count in Counter(reasons).most_common(_SHOWN):
        yield f"{count:,} with {reason}"
