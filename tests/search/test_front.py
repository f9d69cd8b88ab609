"""The front: nothing that was met is shorter and earns as much; it is small; it changes nothing."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pirlc.frontend import parse_sketch
from pirlc.ir.expansion import expand
from pirlc.ir.policy import Sketch
from pirlc.search.candidate import Candidate
from pirlc.search.enumeration import Enumeration
from pirlc.search.front import MOST, Front, find_front, undominated
from pirlc.search.journal import Budget, Journal
from pirlc.search.synthesis import Found, Plan, find_program
from pirlc.source import SourceText
from tests.support.small_search import ByHand, search_in

SUMS = parse_sketch(
    SourceText(
        "sums.pirl",
        """policy sums
environment "CartPole-v1"
sensor Angle : [-0.21, 0.21] = 2
action Push : {0, 1} = if Sum > 0 then 1 else 0
rule Sum = peek(Angle, -1) | Sum + ?k
""",
    )
)


def _of_sizes(sketch: Sketch, count: int) -> list[Candidate]:
    """A candidate of each of the smallest sizes."""
    shortest = Enumeration(sketch).shortest_first(60)
    found = []
    for derivations in shortest:
        expansion = expand(sketch, derivations)
        values = tuple((p.name, 0.0) for p in expansion.template.free)
        found.append(Candidate(expansion, values, 0.0))
        if len(found) == count:
            return found
    raise AssertionError("the sketch allows too few")


LADDER = _of_sizes(SUMS, 6)

measured = st.lists(
    st.tuples(st.integers(0, 5), st.lists(st.integers(-5, 5), min_size=2, max_size=2)),
    min_size=1,
    max_size=12,
).map(lambda rows: [replace(LADDER[i], returns=tuple(map(float, returns))) for i, returns in rows])


@given(measured)
def test_no_member_is_dominated_and_all_others_are(candidates: list[Candidate]) -> None:
    members = undominated(candidates)
    assert all(any(member is c for c in candidates) for member in members)
    for one, next_ in pairwise(members):
        assert one.mean > next_.mean and one.size > next_.size
    for candidate in candidates:
        assert any(m.size <= candidate.size and m.mean >= candidate.mean for m in members)
    for member in members:
        assert not any(
            c is not member and c.size <= member.size and c.mean > member.mean for c in candidates
        )


@given(measured)
def test_the_order_of_what_was_met_plays_no_part(candidates: list[Candidate]) -> None:
    def figures(members: tuple[Candidate, ...]) -> list[tuple[int, float]]:
        return [(m.size, m.mean) for m in members]

    assert figures(undominated(candidates)) == figures(undominated(candidates[::-1]))


def test_numbers_are_counted_from_one() -> None:
    first, second = (replace(c, returns=(9.0 - i,)) for i, c in enumerate(LADDER[1::-1]))
    front = Front((first, second), second)
    assert front.chosen_number == 2
    assert (front.member(1), front.member(2)) == (first, second)
    assert front.member(0) is front.member(3) is front.member(-1) is None
    assert Front((first,), second).chosen_number is None


@pytest.fixture(scope="module")
def searched(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Candidate, Front]:
    """A search, the program that it chose, and the front of what it met; and its journal."""
    path = tmp_path_factory.mktemp("front") / "journal"
    run = search_in(Journal(path, Budget()))
    found = find_program(run.search, ByHand(), Plan())
    assert isinstance(found, Found)
    before = list(run.search.met)
    front = find_front(run.search, found.program)
    assert run.search.met == before
    run.search.journal.close()
    return path, found.program, front


def test_the_front_of_a_search(searched: tuple[Path, Candidate, Front]) -> None:
    _, chosen, front = searched
    assert 1 <= len(front.members) <= MOST
    assert front.chosen.values == chosen.values
    assert front.chosen.expansion == chosen.expansion
    episodes = {len(member.returns or ()) for member in front.members}
    assert episodes == {len(front.chosen.returns or ())} == {16}
    sizes = [member.size for member in front.members]
    means = [member.mean for member in front.members]
    assert sizes == sorted(sizes, reverse=True) and means == sorted(means, reverse=True)
    assert any(m.size <= chosen.size and m.mean >= front.chosen.mean for m in front.members)


def test_the_front_again_is_read_from_the_journal(
    searched: tuple[Path, Candidate, Front],
) -> None:
    path, _, front = searched
    known = len(path.read_text().splitlines())
    run = search_in(Journal(path, Budget()))
    found = find_program(run.search, ByHand(), Plan())
    assert isinstance(found, Found)
    again = find_front(run.search, found.program)
    assert [(m.size, m.values, m.returns) for m in again.members] == [
        (m.size, m.values, m.returns) for m in front.members
    ]
    assert len(path.read_text().splitlines()) == known
