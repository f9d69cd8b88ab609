"""Neighbours are permitted by the sketch, differ, and keep what an edit does not touch."""

from __future__ import annotations

import random
import re
import time

import numpy as np
import pytest

from pirlc.ir.expansion import Derivation, Expansion, calls, expand
from pirlc.ir.policy import ProgramTemplate, Sketch
from pirlc.ir.printer import term_text
from pirlc.ir.terms import RuleCall, Term
from pirlc.search.canonical import canonical_form
from pirlc.search.enumeration import Enumeration
from pirlc.search.neighbourhood import Neighbour, neighbourhood
from pirlc.search.observation import probes
from pirlc.semantics.histories import HistorySet
from pirlc.semantics.vectorised import compile_plan
from tests.search.sketches import SHAPES, random_expansion, sketch_of

SWITCHED = """
    action A : [-1, 1] = Switched
    rule Law = ?k * peek(S, -1) | ?k * peek(T, -1) + ?b
    rule Guard = peek(S, -1) > ?c | Guard and Guard | peek(T, -1) > ?d
    rule Switched = Law | if Guard then Switched else Switched
"""


def neighbours(
    sketch: Sketch,
    expansion: Expansion,
    values: dict[str, float] | None = None,
    growth: int = 14,
    per_move: int = 12,
    largest: int = 60,
) -> tuple[Neighbour, ...]:
    return neighbourhood(
        Enumeration(sketch),
        expansion,
        some_values(expansion) if values is None else values,
        growth=growth,
        per_move=per_move,
        largest=largest,
    )


def some_values(expansion: Expansion) -> dict[str, float]:
    """Different numbers for the parameters, so that they tell what was carried where."""
    return {p.name: 0.5 + 0.25 * n for n, p in enumerate(expansion.template.free)}


def texts(found: tuple[Neighbour, ...]) -> list[str]:
    """The neighbours' bodies, with the carried values in place of parameters."""
    written = []
    for neighbour in found:
        (body,) = neighbour.expansion.template.bodies
        text = term_text(body)
        for name, value in neighbour.values:
            text = re.sub(rf"\b{name}\b", str(value), text)
        written.append(text)
    return written


def at(sketch: Sketch, *derivations: Derivation) -> Expansion:
    return expand(sketch, derivations)


LEAF = Derivation(0, (Derivation(0),))  # Switched -> Law -> ?k * peek(S, -1)
SIMPLE = Derivation(1, (Derivation(0), LEAF, Derivation(0, (Derivation(1),))))
"""if S > c then k * S else k_2 * T + b"""


def well_formed(sketch: Sketch, body: Term, derivation: Derivation) -> bool:
    wanted: tuple[RuleCall, ...] = calls(body)
    return len(wanted) == len(derivation.children) and all(
        child.alternative < len(sketch.rule(call.rule).alternatives)
        and well_formed(sketch, sketch.rule(call.rule).alternatives[child.alternative], child)
        for call, child in zip(wanted, derivation.children, strict=True)
    )


@pytest.mark.parametrize("kind", SHAPES)
def test_neighbours_are_permitted_and_differ(kind: str) -> None:
    sketch = sketch_of(SHAPES[kind])
    met = 0
    for seed in range(6):
        start = random_expansion(sketch, random.Random(seed), depth=2)
        if start.template.size > 60:
            continue
        first, *others = neighbours(sketch, start, growth=10, per_move=6)
        assert first == Neighbour(start, tuple(sorted(some_values(start).items())))
        forms = [canonical_form(n.expansion.template) for n in (first, *others)]
        assert len(set(forms)) == len(forms)
        sizes = [n.expansion.template.size for n in others]
        assert sizes == sorted(sizes)
        assert all(size <= 60 for size in sizes)
        for neighbour in others:
            derivations = neighbour.expansion.derivations
            assert all(
                well_formed(sketch, body, derivation)
                for body, derivation in zip(sketch.bodies, derivations, strict=True)
            )
            assert expand(sketch, derivations) == neighbour.expansion
            free = {p.name for p in neighbour.expansion.template.free}
            assert {name for name, _ in neighbour.values} <= free
        met += len(others)
    assert met >= 5


def test_promotion_takes_each_branch_with_its_values() -> None:
    sketch = sketch_of(SWITCHED)
    found = texts(neighbours(sketch, at(sketch, Derivation(0, (SIMPLE,)))))
    assert found[0] == "if peek(S, -1) > 0.5 then 0.75 * peek(S, -1) else 1.0 * peek(T, -1) + 1.25"
    assert "0.75 * peek(S, -1)" in found
    assert "1.0 * peek(T, -1) + 1.25" in found


def test_wrapping_keeps_the_program_in_either_branch() -> None:
    sketch = sketch_of(SWITCHED)
    start = at(sketch, Derivation(0, (Derivation(0, (Derivation(1),)),)))
    own, new = "0.5 * peek(T, -1) + 0.75", "A_k{} * peek(S, -1)"
    found = texts(neighbours(sketch, start, per_move=40))
    assert found[0] == own
    for guard in ("peek(S, -1) > A_c", "peek(T, -1) > A_d"):
        assert f"if {guard} then {own} else {new.format('_2')}" in found
        assert f"if {guard} then {new.format('')} else {own}" in found


def test_one_part_is_regenerated_and_the_others_keep_their_values() -> None:
    sketch = sketch_of(SWITCHED)
    found = texts(neighbours(sketch, at(sketch, Derivation(0, (SIMPLE,)))))
    law, other = "0.75 * peek(S, -1)", "1.0 * peek(T, -1) + 1.25"
    assert f"if peek(T, -1) > A_d then {law} else {other}" in found
    assert f"if peek(S, -1) > 0.5 then A_k * peek(T, -1) + A_b else {other}" in found
    assert f"if peek(S, -1) > 0.5 then {law} else A_k_2 * peek(S, -1)" in found
    assert (
        f"if peek(S, -1) > 0.5 and peek(S, -1) > A_c_2 then {law} else {other}" in found
        or f"if peek(S, -1) > A_c and peek(S, -1) > 0.5 then {law} else {other}" in found
    )


def test_a_wrapped_guard_computes_the_same_where_the_new_part_is_idle() -> None:
    sketch = sketch_of(SWITCHED)
    start = at(sketch, Derivation(0, (SIMPLE,)))
    values = some_values(start)
    histories = probes(sketch.interface)
    expected = run(start.template, values, histories)
    wrapped = 0
    for neighbour in neighbours(sketch, start, values, per_move=30):
        template = neighbour.expansion.template
        carried = dict(neighbour.values)
        new = [p.name for p in template.free if p.name not in carried]
        holes = {name: origin.hole for name, origin in neighbour.expansion.origins}
        if (
            new
            and all(holes[n] in "cd" for n in new)
            and set(values.values()) <= set(carried.values())
        ):
            # A conjunct that always holds leaves the program as it was.
            held = {**carried, **dict.fromkeys(new, -1e6)}
            wrapped += 1
            assert np.array_equal(run(template, held, histories), expected), term_text(
                template.bodies[0]
            )
    assert wrapped >= 2


def run(
    template: ProgramTemplate, values: dict[str, float], histories: HistorySet
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return compile_plan(template, histories.precision, histories.layout).run(values, histories)


def test_actions_that_an_edit_leaves_alone_compute_the_same() -> None:
    sketch = sketch_of("""
        param q in [0, 10]
        action A : [-1, 1] = Law + q
        action B : [-1, 1] = Law * Law
        rule Law = ?k * peek(S, -1) | ?k * peek(T, -1) + ?b | Law + q * Law
    """)
    histories = probes(sketch.interface)
    changed = [0, 0]
    for seed in range(4):
        start = random_expansion(sketch, random.Random(seed), depth=1)
        values = some_values(start)
        expected = run(start.template, values, histories)
        for neighbour in neighbours(sketch, start, values)[1:]:
            carried = dict(neighbour.values)
            template = neighbour.expansion.template
            filled = {p.name: carried.get(p.name, 77.0) for p in template.free}
            found = run(template, filled, histories)
            same = [
                ours == theirs
                for ours, theirs in zip(
                    neighbour.expansion.derivations, start.derivations, strict=True
                )
            ]
            assert any(same)
            for column in range(2):
                if same[column]:
                    assert np.array_equal(found[:, column], expected[:, column])
                else:
                    changed[column] += 1
    assert min(changed) >= 5


def test_shared_parameters_keep_their_values() -> None:
    sketch = sketch_of("""
        param q in [0, 10]
        action A : [-1, 1] = q * Law
        rule Law = q * peek(S, -1) | ?q * peek(T, -1)
    """)
    start = at(sketch, Derivation(0, (Derivation(1),)))
    found = neighbours(sketch, start, {"q": 3.0, "A_q": 4.0})
    assert [dict(n.values) for n in found] == [{"q": 3.0, "A_q": 4.0}, {"q": 3.0}]


def test_growth_and_size_are_limited() -> None:
    sketch = sketch_of(SWITCHED)
    start = at(sketch, Derivation(0, (SIMPLE,)))
    small = neighbours(sketch, start, growth=2, per_move=50)
    large = neighbours(sketch, start, growth=14, per_move=50)
    assert len(small) < len(large)
    limit = start.template.size
    limited = neighbours(sketch, start, per_move=50, largest=limit)
    assert all(n.expansion.template.size <= limit for n in limited)
    assert len(neighbours(sketch, start, per_move=1)) < len(large)
    assert len(limited) < len(large)


def test_a_rule_that_hands_its_argument_on_is_wrapped_and_promoted() -> None:
    sketch = sketch_of("""
        action A : [-1, 1] = Sum(S)
        rule Sum(x) = ?k * peek(x, -1) | Sum(x) + ?l * peek(x, -2)
    """)
    leaf = Derivation(0)
    short, long = (
        at(sketch, Derivation(0, (derivation,))) for derivation in (leaf, Derivation(1, (leaf,)))
    )
    assert "0.5 * peek(S, -1) + A_l * peek(S, -2)" in texts(neighbours(sketch, short))
    assert texts(neighbours(sketch, long))[:2] == [
        "0.5 * peek(S, -1) + 0.75 * peek(S, -2)",
        "0.5 * peek(S, -1)",
    ]


def test_rich_rules_below_one_that_does_not_recur_take_no_time() -> None:
    sketch = sketch_of("""
        action A : {0, 1} = Top
        rule Top = if Guard then 1 else 0
        rule Guard = Atom > 0 | Guard and Guard | Guard or Guard
        rule Atom = peek(S, -1) | peek(T, -1) | ?k | Atom + Atom | Atom * Atom | abs(Atom)
    """)
    start = at(sketch, Derivation(0, (Derivation(0, (Derivation(0, (Derivation(0),)),)),)))
    began = time.perf_counter()
    assert len(neighbours(sketch, start)) > 10
    # Enumerating all that the rules allow at these sizes takes minutes.
    assert time.perf_counter() - began < 5.0
