"""What is found in a program without being asked: `Matter` lists it.

Proofs are over all histories of good readings, in real arithmetic; where a branch is dead or a
guard constant only as long as nothing is rounded, the evidence says so.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import z3

from pirlc.ir.evidence import PROVED, Evidence, Kind
from pirlc.ir.policy import Continuous, Program
from pirlc.ir.printer import term_text
from pirlc.ir.terms import Term
from pirlc.semantics.precision import BINARY32, BINARY64
from pirlc.source import Span
from pirlc.symbolic import z3_terms as exact
from pirlc.symbolic.z3_form import Branching, Guard
from pirlc.symbolic.z3_terms import Truth
from pirlc.verify.bounds.actions import operations, restricted
from pirlc.verify.bounds.extremes import limited
from pirlc.verify.findings import GuardRounding, Matter, Remark
from pirlc.verify.model import Model, unroll
from pirlc.verify.properties.asking import DEFAULT_LIMITS, Limits
from pirlc.verify.properties.deciding import LARGEST, perturbation
from pirlc.verify.remarks.hazards import hazards, same_place
from pirlc.verify.remarks.idle import idle
from pirlc.verify.remarks.jumps import jump
from pirlc.verify.remarks.occurrences import occurrences
from pirlc.verify.rounding import rounding

WHERE_DEFINED = Evidence(
    Kind.PROVED, "where nothing is divided by zero and no root is taken of a negative number"
)
OVER_REALS = Evidence(Kind.PROVED, "over the reals; rounding may turn a guard")


def remarks(program: Program, limits: Limits = DEFAULT_LIMITS) -> tuple[Remark, ...]:
    """Everything worth saying about each action, then about parameters.

    Nothing of programs that are too large to ask about.
    """
    found: list[Remark] = []
    if operations(program, 1) > LARGEST:
        return ()
    for spec in program.interface.actions:
        part = restricted(program, spec.name)
        model = unroll(part, 1)
        rounded = unroll(part, 1, perturbation=perturbation(part, BINARY32))
        found.extend(_branches(model, rounded, spec.name, limits))
        found.extend(_guards(model, rounded, spec.name, limits))
        if isinstance(spec.domain, Continuous):
            found.extend(jump(program, model, spec.name, limits))
        found.extend(hazards(program, model, spec.name, limits))
    found.extend(idle(program, limits))
    return tuple(found)


def _never(model: Model, limits: Limits, *truths: Truth) -> bool:
    """No history satisfies them all: z3 proved it."""
    solver = limited(model, limits)
    solver.add(*(exact.as_term(truth, model.context) for truth in truths))
    return bool(solver.check() == z3.unsat)


def _branches(model: Model, rounded: Model, action: str, limits: Limits) -> Iterator[Remark]:
    """Branches that no history reaches, each `if` of the text once; not those inside them."""
    groups: dict[tuple[Term, Span], list[tuple[Branching, Branching]]] = {}
    exactly, off = (m.steps[0].records[action].branchings for m in (model, rounded))
    for pair in zip(exactly, off, strict=True):
        groups.setdefault((pair[0].term, pair[0].term.span), []).append(pair)
    for pairs in groups.values():
        if all(_never(model, limits, one.path) for one, _ in pairs):
            continue
        for taken in (True, False):
            if not all(_never(model, limits, *_taken(one, taken)) for one, _ in pairs):
                continue
            term = pairs[0][0].term
            branch = term.consequent if taken else term.alternative
            sure = all(_never(rounded, limits, *_taken(other, taken)) for _, other in pairs)
            answer = "never" if taken else "always"
            text = f"`{term_text(branch)}` is never reached: `{term_text(term.condition)}` "
            text += f"{answer} holds"
            evidence = _evidence(model, action, sure, limits)
            yield Remark(Matter.DEAD_BRANCH, text, evidence, False, branch.span)


def _evidence(model: Model, action: str, sure: bool, limits: Limits) -> Evidence:
    """Of what no history of reals does; `sure`: nor does rounding. NaNs answer no comparison, so
    that where a side may be one another branch may be taken."""
    guards = model.steps[0].records[action].guards
    if all(_never(model, limits, exact.negation(guard.defined)) for guard in guards):
        return PROVED if sure else OVER_REALS
    return WHERE_DEFINED


def _taken(branching: Branching, taken: bool) -> tuple[Truth, ...]:
    truth = branching.condition.value
    return branching.path, truth if taken else exact.negation(truth)


def _guards(model: Model, rounded: Model, action: str, limits: Limits) -> Iterator[Remark]:
    """Comparisons that have one answer wherever they count."""
    nodes = _guard_nodes(model, action)
    exactly, off = (m.steps[0].records[action].guards for m in (model, rounded))
    for places in same_place(nodes):
        node = nodes[places[0]]
        if exactly[places[0]].relation is None:
            continue
        if all(_never(model, limits, exactly[i].path) for i in places):
            continue
        for answer in (True, False):
            if all(_never(model, limits, *_answers(exactly[i], not answer)) for i in places):
                sure = all(_never(rounded, limits, *_answers(off[i], not answer)) for i in places)
                text = f"`{term_text(node)}` is {'always' if answer else 'never'} true"
                evidence = _evidence(model, action, sure, limits)
                yield Remark(Matter.CONSTANT_GUARD, text, evidence, False, node.span)


def _answers(guard: Guard, answer: bool) -> tuple[Truth, ...]:
    outcome = guard.outcome if answer else exact.negation(guard.outcome)
    return guard.path, outcome


def _guard_nodes(model: Model, action: str) -> tuple[Term, ...]:
    names = [spec.name for spec in model.program.interface.actions]
    return occurrences(model.program.bodies[names.index(action)]).guards


def guard_margins(program: Program, limits: Limits = DEFAULT_LIMITS) -> tuple[GuardRounding, ...]:
    """The comparisons that rounding could turn on some history, and how near their sides must be.

    A margin of 0: not in that precision.
    """
    found: list[GuardRounding] = []
    if operations(program, 1) > LARGEST:
        return ()
    off = {p: rounding(program, p).steps[0].margins for p in (BINARY64, BINARY32)}
    for spec in program.interface.actions:
        model = unroll(restricted(program, spec.name), 1)
        nodes = _guard_nodes(model, spec.name)
        guards = model.steps[0].records[spec.name].guards
        for places in same_place(nodes):
            margins = []
            for precision in (BINARY64, BINARY32):
                at = [off[precision][spec.name][i] for i in places]
                reached = [
                    margin
                    for margin, i in zip(at, places, strict=True)
                    if _within_reach(model, guards[i], margin, limits)
                ]
                known = [margin for margin in reached if margin is not None]
                margins.append(None if len(known) < len(reached) else max(known, default=0.0))
            if margins != [0.0, 0.0]:
                node = nodes[places[0]]
                found.append(GuardRounding(term_text(node), margins[0], margins[1], node.span))
    return tuple(found)


def _within_reach(model: Model, guard: Guard, margin: float | None, limits: Limits) -> bool:
    """Some history brings the sides closer than the margin, where the guard counts."""
    if margin == 0.0 or guard.discrete:
        return False
    if margin is None:
        return not _never(model, limits, guard.path, guard.defined)
    apart = exact.subtract(guard.a, guard.b)
    near = exact.within(apart, -Fraction(margin), Fraction(margin))
    return not _never(model, limits, guard.path, guard.defined, near)
