"""Enumeration lists every derivation once, shortest first, and knows how many there are."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import pytest

from pirlc.ir.expansion import Derivation, calls, expand
from pirlc.ir.policy import Sketch
from pirlc.ir.printer import term_text
from pirlc.ir.terms import LocalRef, RuleCall, Term, subterms
from pirlc.search.enumeration import Enumeration
from tests.search.sketches import SHAPES, sketch_of

LARGEST = {
    "recursive": 44,
    "PID": 64,
    "atoms": 17,
    "unused": 17,
    "several": 26,
    "let": 50,
    "lambda": 24,
    "sequences": 20,
}
"""Up to which size each sketch is enumerated here."""

MOST_CHOICES = 10
"""The largest derivations that the brute force makes."""


# The brute force: all derivations with few choices, by counting choices and not sizes.


def trees(sketch: Sketch, term: Term, budget: int) -> Iterator[tuple[tuple[Derivation, ...], int]]:
    """The derivations of a term's calls that make at most `budget` choices, with how many."""

    def of_calls(
        open_calls: tuple[RuleCall, ...], left: int
    ) -> Iterator[tuple[tuple[Derivation, ...], int]]:
        if not open_calls:
            yield (), 0
            return
        rest = open_calls[1:]
        rule = sketch.rule(open_calls[0].rule)
        for number, alternative in enumerate(rule.alternatives):
            for below, spent in trees(sketch, alternative, left - 1 - len(rest)):
                for others, more in of_calls(rest, left - 1 - spent):
                    yield (Derivation(number, below), *others), 1 + spent + more

    wanted = calls(term)
    if len(wanted) <= budget:
        yield from of_calls(wanted, budget)


def all_derivations(sketch: Sketch, budget: int) -> Iterator[tuple[Derivation, ...]]:
    def go(bodies: tuple[Term, ...], left: int) -> Iterator[tuple[Derivation, ...]]:
        if not bodies:
            yield ()
            return
        for below, spent in trees(sketch, bodies[0], left):
            for rest in go(bodies[1:], left - spent):
                yield (Derivation(0, below), *rest)

    return go(sketch.bodies, budget)


def choices(derivation: Derivation) -> int:
    return 1 + sum(map(choices, derivation.children))


def without_unused(sketch: Sketch, derivations: tuple[Derivation, ...]) -> tuple[Derivation, ...]:
    """The derivations with those of arguments that go unused struck out: they choose nothing."""
    return tuple(
        Derivation(0, _without_unused(sketch, body, iter(derivation.children)))
        for body, derivation in zip(sketch.bodies, derivations, strict=True)
    )


def _without_unused(
    sketch: Sketch, term: Term, children: Iterator[Derivation]
) -> tuple[Derivation, ...]:
    if not isinstance(term, RuleCall):
        found: tuple[Derivation, ...] = ()
        for child in _below(term):
            found += _without_unused(sketch, child, children)
        return found
    own = next(children)
    rule = sketch.rule(term.rule)
    chosen = rule.alternatives[own.alternative]
    found = (Derivation(own.alternative, _without_unused(sketch, chosen, iter(own.children))),)
    used = {sub.name for sub in subterms(chosen) if isinstance(sub, LocalRef)}
    for (name, _), argument in zip(rule.parameters, term.arguments, strict=True):
        inner = _without_unused(sketch, argument, children)
        found += inner if name in used else ()
    return found


def _below(term: Term) -> Iterator[Term]:
    """The outermost rule calls of a term that is not one."""
    inside: set[int] = set()
    for sub in subterms(term):
        if isinstance(sub, RuleCall) and id(sub) not in inside:
            inside.update(id(s) for a in sub.arguments for s in subterms(a))
            yield sub


@pytest.mark.parametrize("kind", SHAPES)
def test_every_derivation_once_with_its_size(kind: str) -> None:
    sketch = sketch_of(SHAPES[kind])
    enumeration = Enumeration(sketch)
    listed = set()
    total = 0
    for size in range(1, LARGEST[kind] + 1):
        here = list(enumeration.derivations(size))
        assert len(here) == enumeration.count(size), size
        for derivations in here:
            assert expand(sketch, derivations).template.size == size
        listed.update(without_unused(sketch, d) for d in here)
        total += len(here)
        assert len(listed) == total, "a derivation is listed twice"
    assert total >= 40


@pytest.mark.parametrize("kind", SHAPES)
def test_none_is_missed(kind: str) -> None:
    sketch = sketch_of(SHAPES[kind])
    largest = LARGEST[kind]
    listed = {without_unused(sketch, d) for d in Enumeration(sketch).shortest_first(largest)}
    expected = {
        without_unused(sketch, d)
        for d in all_derivations(sketch, MOST_CHOICES)
        if expand(sketch, d).template.size <= largest
    }
    assert len(expected) >= 20
    assert expected <= listed
    for extra in listed - expected:
        assert sum(map(choices, extra)) > MOST_CHOICES


@pytest.mark.parametrize("kind", SHAPES)
def test_shorter_ones_come_first(kind: str) -> None:
    sketch = sketch_of(SHAPES[kind])
    first = islice(Enumeration(sketch).shortest_first(200), 60)
    sizes = [expand(sketch, d).template.size for d in first]
    assert sizes == sorted(sizes)
    assert len(sizes) == 60


@pytest.mark.parametrize("kind", SHAPES)
def test_the_order_depends_on_the_sketch_alone(kind: str) -> None:
    once = list(islice(Enumeration(sketch_of(SHAPES[kind])).shortest_first(40), 50))
    again = Enumeration(sketch_of(SHAPES[kind]))
    for size in (30, 12, 25):
        again.count(size)
    assert list(islice(again.shortest_first(40), 50)) == once


def test_the_list_for_a_small_sketch() -> None:
    sketch = sketch_of("""
        action A : [-1, 1] = R
        rule R = ?k | R + R
    """)
    enumeration = Enumeration(sketch)
    texts = {
        size: [
            term_text(expand(sketch, d).template.bodies[0]) for d in enumeration.derivations(size)
        ]
        for size in range(1, 6)
    }
    assert texts == {
        1: ["A_k"],
        2: [],
        3: ["A_k + A_k_2"],
        4: [],
        5: ["A_k + (A_k_2 + A_k_3)", "A_k + A_k_2 + A_k_3"],
    }


def test_counts_are_catalan_numbers_where_they_must_be() -> None:
    enumeration = Enumeration(sketch_of("action A : [-1, 1] = R\nrule R = ?k | R + R"))
    counts = [enumeration.count(size) for size in range(1, 82, 2)]
    catalan = [1]
    for n in range(40):
        catalan.append(catalan[-1] * 2 * (2 * n + 1) // (n + 2))
    assert counts == catalan


def test_a_sketch_with_nothing_to_choose_has_one_program() -> None:
    sketch = sketch_of("action A : [-1, 1] = ?k * peek(S, -1)\naction B : [-1, 1] = 0")
    enumeration = Enumeration(sketch)
    assert [enumeration.count(size) for size in range(1, 9)] == [0, 0, 0, 0, 0, 1, 0, 0]
    assert list(enumeration.shortest_first(60)) == [(Derivation(0), Derivation(0))]


def test_derivations_of_one_call() -> None:
    sketch = sketch_of("""
        action A : [-1, 1] = R(peek(S, -1) + 1)
        rule R(x) = x | x * ?k | R(x) + R(x)
    """)
    (call,) = calls(sketch.bodies[0])
    enumeration = Enumeration(sketch)
    leaf, scaled = Derivation(0), Derivation(1)
    assert list(enumeration.of_call(call, 1)) == [leaf]
    assert list(enumeration.of_call(call, 2)) == []
    assert list(enumeration.of_call(call, 3)) == [scaled, Derivation(2, (leaf, leaf))]
    assert set(enumeration.of_call(call, 5)) == {
        Derivation(2, (leaf, scaled)),
        Derivation(2, (scaled, leaf)),
        Derivation(2, (leaf, Derivation(2, (leaf, leaf)))),
        Derivation(2, (Derivation(2, (leaf, leaf)), leaf)),
    }
    assert len(list(enumeration.of_call(call, 5))) == 4


@pytest.mark.parametrize("argument", ["R", "R + R", "Constant(R)"])
def test_a_rule_may_call_itself_in_an_argument_that_goes_unused(argument: str) -> None:
    sketch = sketch_of(f"""
        action A : [-1, 1] = R
        rule R = ?k | 1 + Constant({argument})
        rule Constant(x) = ?c
    """)
    enumeration = Enumeration(sketch)
    assert [enumeration.count(size) for size in range(1, 6)] == [1, 0, 1, 0, 0]
    texts = [term_text(expand(sketch, d).template.bodies[0]) for d in enumeration.shortest_first(9)]
    # Names that went to the argument that goes unused are not handed out again.
    assert texts in (["A_k", "1 + A_c"], ["A_k", "1 + A_c_2"])
