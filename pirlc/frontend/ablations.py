"""The paper's ablations of a sketch, as sketches of their own: NoSketch and NoIF.

Both give text, which is read like any other sketch and can be kept with what was found in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

from pirlc.diagnostics import Diagnostic, Label, PirlcError, Severity
from pirlc.frontend.own_grammar import own_grammar
from pirlc.ir.ablation import bound_to_branch, has_branches, without_branches
from pirlc.ir.policy import Sketch
from pirlc.ir.printer import sketch_text
from pirlc.ir.terms import If, Term, subterms
from pirlc.source import SourceText, Span


@dataclass(frozen=True)
class BoundToBranch:
    """No program without an `if` is left for an action; `own` is the first `if` of its body."""

    action: str
    body: Span
    own: Span | None


@dataclass(frozen=True)
class NoBranch:
    """A sketch has no `if` that could be left out."""


Problem = BoundToBranch | NoBranch


def without_sketch(source: SourceText, sketch: Sketch) -> SourceText:
    """The language's own grammar over the sensors and actions of a sketch (NoSketch)."""
    return own_grammar(sketch, f"{source.name} (without its rules)")


def without_if(source: SourceText, sketch: Sketch) -> tuple[SourceText, tuple[Diagnostic, ...]]:
    """The programs of a sketch that have no `if` (NoIF), and a warning if those are all.

    `source` is what the sketch was read from. Raises PirlcError E0435 where an action has no
    program left.
    """
    impossible = bound_to_branch(sketch)
    if impossible:
        bodies = dict(zip(sketch.interface.actions, sketch.bodies, strict=True))
        found = [BoundToBranch(a.name, bodies[a].span, _own_if(bodies[a])) for a in impossible]
        raise PirlcError(describe(problem, source) for problem in found)
    header = (
        f"The programs of {sketch.interface.name} that have no `if`: what `--no-if` searches.",
    )
    text = sketch_text(without_branches(sketch), header)
    remarks = () if has_branches(sketch) else (describe(NoBranch(), source),)
    return SourceText(f"{source.name} (without `if`)", text), remarks


def _own_if(body: Term) -> Span | None:
    return next((sub.span for sub in subterms(body) if isinstance(sub, If)), None)


def describe(problem: Problem, source: SourceText) -> Diagnostic:
    match problem:
        case BoundToBranch(action, body, own):
            return Diagnostic(
                "E0435",
                f"without `if` no program is left for the action `{action}`",
                source,
                Label(body, "every program that this allows has an `if`")
                if own is None
                else Label(own, "this `if` is part of every program"),
                help="add an alternative without `if`, or leave out `--no-if`",
            )
        case NoBranch():
            return Diagnostic(
                "E0436",
                "the sketch has no `if`: `--no-if` leaves nothing out",
                severity=Severity.WARNING,
            )
        case _:
            assert_never(problem)
