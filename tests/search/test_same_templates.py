"""Templates that are the same but for their writing are told to be; others are kept apart."""

from __future__ import annotations

from itertools import islice, product

import numpy as np
import pytest
from numpy.typing import NDArray

from pirlc.ir.expansion import expand, only_derivation
from pirlc.ir.policy import ProgramTemplate
from pirlc.ir.terms import Apply, ParameterRef, subterms
from pirlc.search.canonical import canonical_form, canonical_order
from pirlc.search.enumeration import Enumeration
from pirlc.search.observation import fingerprint, probes
from pirlc.semantics.histories import HistorySet
from pirlc.semantics.vectorised import compile_plan
from tests.search.sketches import SHAPES, sketch_of

REAL = "action A : [-1, 1] safe 0 = "
CHOICE = "action A : {0, 1} = "
X, Y = "peek(S, -1)", "peek(T, -1)"


def template(text: str) -> ProgramTemplate:
    sketch = sketch_of(text)
    derivations = only_derivation(sketch)
    assert derivations is not None
    return expand(sketch, derivations).template


def observed(text: str) -> str:
    found = template(text)
    return fingerprint(found, probes(found.interface))


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (f"{X} + {Y}", f"{Y} + {X}"),
        (f"?k * {X}", f"{X} * ?gain"),
        (f"?a * {X} + ?b * {Y}", f"{Y} * ?b + ?a * {X}"),
        (f"let e = {X} in e * ?k", f"let y = {X} in ?l * y"),
        (
            r"fold(\v acc -> v * ?a + acc, S, 0)",
            r"fold(\element sum -> sum + ?k * element, S, 0)",
        ),
        (f"if {X} > ?c then 1 else 0", f"if ?c < {X} then 1 else 0"),
        (f"if {X} >= ?c and {Y} < 0 then 1 else 0", f"if 0 > {Y} and ?d <= {X} then 1 else 0"),
        (f"if {X} == 0 or {Y} != 1 then 1 else 0", f"if 1 != {Y} or 0 == {X} then 1 else 0"),
    ],
)
def test_equal_in_form(one: str, other: str) -> None:
    assert canonical_form(template(REAL + one)) == canonical_form(template(REAL + other))
    assert observed(REAL + one) == observed(REAL + other)


DIFFERENT = [
    (f"?k * {X}", f"?k * {Y}"),
    (f"?k * {X}", "?k * peek(S, -2)"),
    (f"{X} - {Y}", f"{Y} - {X}"),
    (f"?k * {X} + ?l", f"?k * {X} + ?k"),
    (f"?a * {X} + ?b * {Y}", f"?a * {X} + ?a * {Y}"),
    (f"?(k in [0, 1]) * {X}", f"?(k in [0, 2]) * {X}"),
    (f"min({X}, ?k * {Y})", f"max({X}, ?k * {Y})"),
    ("fold(+, S)", "fold(*, S)"),
    ("fold(+, S)", f"{X} * 3"),
    (f"if {X} > ?c then 1 else 0", f"if {X} > ?c then 0 else 1"),
    (f"if {X} > ?c then 1 else 0", f"if {X} > 0.25 then 1 else 0"),
    (f"if {X} > ?c and {Y} > ?d then 1 else 0", f"if {X} > ?c or {Y} > ?d then 1 else 0"),
    (
        f"let e = {X} in let f = {Y} in e * e - f",
        f"let e = {X} in let f = {Y} in f * f - e",
    ),
    ("previous(A) * ?k", f"{X} * ?k"),
    (r"fold(\v acc -> v * 2 + acc, S, 0)", r"fold(\v acc -> v + 2 * acc, S, 0)"),
    # The same numbers within the bounds of one are those of the other, but not the other way round.
    (f"?(k in [-100, 100]) * {X}", f"?(k in [-1000, 1000]) * {X}"),
    (f"if {X} > ?c then 1 else 0", f"if {X} > ?c or {Y} > ?d and {X} > ?e then 1 else 0"),
    (
        f"if ?a * {X} > ?c then 1 else 0",
        f"if ?a * {X} > ?c or ?b * {X} > ?d and ?e * {X} > ?f then 1 else 0",
    ),
]


@pytest.mark.parametrize(("one", "other"), DIFFERENT)
def test_different(one: str, other: str) -> None:
    assert canonical_form(template(REAL + one)) != canonical_form(template(REAL + other))
    assert observed(REAL + one) != observed(REAL + other)


def test_a_parameter_is_not_taken_for_a_local_name() -> None:
    head = "param x0 = 3\n" + REAL
    one, other = template(head + f"let e = {X} in e + 1"), template(head + f"let e = {X} in x0 + 1")
    assert canonical_form(one) != canonical_form(other)


def test_local_names_of_other_actions_are_others() -> None:
    head = "action A : [-1, 1] = let x = 1 in let y = 2 in x + y\naction B : [-1, 1] = "
    one = template(head + f"let y = {X} in let x = {Y} in y")
    other = template(head + f"let x = {X} in let y = {Y} in y")
    assert canonical_form(one) != canonical_form(other)


def test_results_too_large_for_binary32_are_no_trouble(recwarn: pytest.WarningsRecorder) -> None:
    observed(REAL + f"exp(?k * {X}) * exp(?l * {Y})")
    assert not recwarn.list


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (f"if ?a + ?b * {X} > 0 then 1 else 0", f"if ?a + ?b * {X} > 0 then 0 else 1"),
        (f"if ?a + ?b * {X} > 0 then 1 else 0", f"if ?b * {X} + ?a < 0 then 1 else 0"),
        (f"if ?a * {X} > ?c then 0 else 0", "0"),
        (f"if {X} > ?c then {X} else {X}", X),
        (f"{X} + {X}", f"2 * {X}"),
        (f"?k * {X} + 0 * {Y}", f"?k * {X}"),
        (f"if not (?a * {X} > ?b) then 0 else 1", f"if ?a * {X} > ?b then 1 else 0"),
        (f"let e = {X} in 1 - e", f"1 - {X}"),
    ],
)
def test_equal_by_observation_only(one: str, other: str) -> None:
    assert canonical_form(template(REAL + one)) != canonical_form(template(REAL + other))
    assert observed(REAL + one) == observed(REAL + other)


@pytest.mark.parametrize(
    "guard",
    [
        f"?(a in [0, 10]) * {X} + ?b * {Y} > 0",
        f"{X} + ?b * {Y} > 0",
        f"?a * {X} > ?a * 0.1 + {Y}",
    ],
)
def test_a_guards_sign_is_no_matter_only_where_the_bounds_allow_both(guard: str) -> None:
    one, other = f"if {guard} then 1 else 0", f"if {guard} then 0 else 1"
    assert observed(REAL + one) != observed(REAL + other)


def test_a_sign_that_something_else_shares_is_not_flipped() -> None:
    one = f"if ?a * {X} > 0 then ?a else 0"
    other = f"if ?a * {X} > 0 then 0 else ?a"
    assert observed(REAL + one) != observed(REAL + other)


def test_discrete_actions() -> None:
    assert observed(CHOICE + f"if {X} > ?c then 1 else 1") == observed(CHOICE + "1")
    assert observed(CHOICE + f"if {X} > ?c then 1 else 0") != observed(CHOICE + "1")


def test_the_order_of_parameters_is_that_of_the_form() -> None:
    one = template(REAL + f"?a * {X} + ?b * {Y}")
    other = template(REAL + f"{Y} * ?x + {X} * ?y")
    assert dict(zip(canonical_order(one), canonical_order(other), strict=True)) == {
        "A_a": "A_y",
        "A_b": "A_x",
    }


# What is merged computes the same.


def outputs(
    found: ProgramTemplate, vectors: NDArray[np.float64], histories: HistorySet
) -> NDArray[np.float64]:
    plan = compile_plan(found, histories.precision, histories.layout)
    order = canonical_order(found)
    return np.stack(
        [plan.run(dict(zip(order, v.tolist(), strict=False)), histories) for v in vectors]
    )


def signs(found: ProgramTemplate) -> list[NDArray[np.float64]]:
    """Every choice of signs for the guards' parameters, in canonical order."""
    order = canonical_order(found)
    guards = [
        {p.name for p in subterms(sub) if isinstance(p, ParameterRef)}
        for body in found.bodies
        for sub in subterms(body)
        if isinstance(sub, Apply) and sub.operator.value in "<=>="
    ]
    choices = []
    for flips in product((1.0, -1.0), repeat=min(len(guards), 5)):
        row = np.ones(len(order))
        for guard, flip in zip(guards, flips, strict=False):
            row[[name in guard for name in order]] = flip
        choices.append(row)
    return choices


@pytest.mark.parametrize(
    ("kind", "largest", "merged"),
    [("several", 22, 0), ("atoms", 17, 5), ("unused", 13, 5), ("recursive", 36, 3)],
)
def test_what_is_merged_computes_the_same(kind: str, largest: int, merged: int) -> None:
    sketch = sketch_of(SHAPES[kind])
    histories, fresh = probes(sketch.interface), probes(sketch.interface, 99)
    groups: dict[str, dict[str, ProgramTemplate]] = {}
    for derivations in Enumeration(sketch).shortest_first(largest):
        found = expand(sketch, derivations).template
        group = groups.setdefault(fingerprint(found, histories), {})
        group.setdefault(canonical_form(found), found)
    rng = np.random.default_rng(3)
    vectors = rng.choice((-1.0, 1.0), (10, 12)) * 10.0 ** rng.uniform(-2.0, 2.0, (10, 12))
    count = 0
    for group in groups.values():
        first, *others = group.values()
        expected = outputs(first, vectors, fresh)
        for other in others:
            count += 1
            width = len(canonical_order(other))
            assert any(
                np.allclose(outputs(other, vectors[:, :width] * sign, fresh), expected, rtol=1e-5)
                for sign in signs(other)
            )
    assert count >= merged


@pytest.mark.parametrize("kind", SHAPES)
def test_what_is_equal_in_form_is_equal_by_observation(kind: str) -> None:
    sketch = sketch_of(SHAPES[kind])
    histories = probes(sketch.interface)
    seen: dict[str, str] = {}
    for derivations in islice(Enumeration(sketch).shortest_first(60), 40):
        found = expand(sketch, derivations).template
        seen_as = fingerprint(found, histories)
        assert seen.setdefault(canonical_form(found), seen_as) == seen_as
