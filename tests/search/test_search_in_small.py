"""Algorithm 1 and what follows it, on CartPole with an oracle written by hand."""

from __future__ import annotations

from dataclasses import replace
from itertools import count
from pathlib import Path

import pytest
from joblib.externals.loky import get_reusable_executor

from pirlc.search.candidate import Candidate, as_entry, from_entry
from pirlc.search.journal import Budget, Journal
from pirlc.search.settings import Progress
from pirlc.search.synthesis import Ending, Found, Plan, find_program
from pirlc.simulation.workers import Workers
from tests.support.small_search import (
    SETTINGS,
    SHORT,
    SKETCH,
    ByHand,
    Run,
    imitate,
    search_in,
)

FIRST = 8
"""Calls after which there is something to return."""


@pytest.fixture(scope="module")
def imitated(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Run, Candidate]:
    """Algorithm 1, run once, and its journal."""
    path = tmp_path_factory.mktemp("search") / "journal"
    journal = Journal(path, Budget())
    run = search_in(journal)
    found = imitate(run)
    journal.close()
    return path, run, found


def test_the_program_found_balances_the_pole(imitated: tuple[Path, Run, Candidate]) -> None:
    _, _, found = imitated
    assert found.mean > 400.0
    assert found.loss < 0.15
    assert len(found.returns or ()) == SETTINGS.episodes
    (again,) = search_in(Journal(None, Budget())).search.simulate([found], "unseen", 10)
    assert again.mean > 400.0


def test_what_was_met_is_recorded_and_can_be_built_again(
    imitated: tuple[Path, Run, Candidate],
) -> None:
    _, run, found = imitated
    assert run.recorded == run.search.met
    stages = {stage for stage, _ in run.recorded}
    assert {"tune (initialize)", "initialize", "tune (iteration 1)", "iteration 1"} <= stages
    assert any(c.returns == found.returns and c == found for _, c in run.recorded)
    for stage, candidate in run.recorded:
        entry = as_entry(candidate, stage)
        again = from_entry(SKETCH, entry)
        assert again.program == candidate.program
        assert entry["size"] == candidate.size <= SETTINGS.largest
    assert {p.stage.split(" ")[0] for p in run.told} >= {"create_histories", "tune", "simulate"}
    assert all(0 <= p.done <= p.total for p in run.told)


def test_resuming_gives_the_same_and_computes_nothing_again(
    imitated: tuple[Path, Run, Candidate],
) -> None:
    path, _, found = imitated
    before = path.read_bytes()
    journal = Journal(path, Budget())
    assert imitate(search_in(journal)) == found
    journal.close()
    assert path.read_bytes() == before


def test_a_search_that_was_cut_off_goes_on(
    imitated: tuple[Path, Run, Candidate], tmp_path: Path
) -> None:
    path, _, found = imitated
    lines = path.read_bytes().splitlines(keepends=True)
    cut = tmp_path / "journal"
    cut.write_bytes(b"".join(lines[:-3]) + lines[-3][:20])
    journal = Journal(cut, Budget())
    assert imitate(search_in(journal)) == found
    journal.close()
    assert cut.read_bytes() == path.read_bytes()


def test_the_number_of_workers_changes_nothing(imitated: tuple[Path, Run, Candidate]) -> None:
    _, one, found = imitated
    two = search_in(Journal(None, Budget()), workers=Workers(2))
    try:
        assert imitate(two) == found
    finally:
        # Other tests import what they make; processes that stand ready would not know of it.
        get_reusable_executor().shutdown(wait=True)
    assert two.recorded == one.recorded


def test_another_seed_is_another_search(imitated: tuple[Path, Run, Candidate]) -> None:
    _, run, _ = imitated
    other = search_in(Journal(None, Budget()), SHORT, replace(SETTINGS, seed=1))
    assert other.search.seeds("collect_reward", 8) != run.search.seeds("collect_reward", 8)
    assert other.search.seeds("x", 8) == other.search.seeds("x", 8)
    assert other.search.seeds("x", 8) != other.search.seeds("y", 8)


# The whole search, on episodes of a few steps.


EVERYTHING = Plan()


def whole(path: Path | None, budget: Budget, plan: Plan = EVERYTHING) -> tuple[Found | Ending, Run]:
    journal = Journal(path, budget)
    run = search_in(journal, SHORT)
    found = find_program(run.search, ByHand(), plan)
    journal.close()
    return found, run


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Found, Run]:
    path = tmp_path_factory.mktemp("whole") / "journal"
    found, run = whole(path, Budget())
    assert isinstance(found, Found)
    return path, found, run


def test_the_whole_search_finishes(finished: tuple[Path, Found, Run]) -> None:
    _, found, run = finished
    assert found.ending is Ending.FINISHED
    assert found.imitated is not None
    assert found.program.mean == 12.0
    assert found.program.returns is not None
    assert {"refine", "validate", "round"} <= {stage for stage, _ in run.recorded}
    assert all(value == float(f"{value:.3g}") for _, value in found.program.values)


def test_the_whole_search_resumes(finished: tuple[Path, Found, Run]) -> None:
    path, found, run = finished
    before = path.read_bytes()
    again, run_again = whole(path, Budget())
    assert again == found
    assert path.read_bytes() == before
    assert run_again.recorded == run.recorded
    assert run_again.search.journal.used == run.search.journal.used


def test_a_budget_always_ends_in_a_program(finished: tuple[Path, Found, Run]) -> None:
    path, found, run = finished
    used = run.search.journal.used
    assert used > 40
    # Wherever the budget ends: in tuning, in simulation, in refinement, or after it.
    for calls in (*range(FIRST, used, 5), used - 2, used - 1, used, used + 1):
        stopped, stopped_run = whole(path, Budget(calls=calls))
        assert isinstance(stopped, Found), calls
        if calls < used:
            assert stopped.ending is Ending.BUDGET
            assert stopped_run.search.journal.stopped_at is not None
        else:
            assert stopped.ending is Ending.FINISHED
            assert stopped.program == found.program


def test_a_budget_that_ends_in_tuning_gives_the_closest(finished: tuple[Path, Found, Run]) -> None:
    path, _, _ = finished
    stopped, run = whole(path, Budget(calls=SETTINGS.pool))
    assert isinstance(stopped, Found)
    assert stopped.imitated is None
    assert stopped.program.loss == min(c.loss for _, c in run.recorded)


def test_a_run_stopped_by_time_is_replayed_by_its_count(
    finished: tuple[Path, Found, Run],
) -> None:
    path, _, _ = finished
    ticks = count()
    stopped, run = whole(path, Budget(seconds=15.0, clock=lambda: float(next(ticks))))
    assert isinstance(stopped, Found)
    assert stopped.ending is Ending.BUDGET
    calls = run.search.journal.stopped_at
    assert calls is not None
    replayed, again = whole(path, Budget(calls=calls))
    assert replayed == stopped
    assert again.recorded == run.recorded


def test_no_budget_at_all_finds_nothing() -> None:
    found, _ = whole(None, Budget(calls=0))
    assert found is Ending.TIMEOUT


def test_ctrl_c_before_there_is_a_program() -> None:
    run = search_in(Journal(None, Budget()), SHORT)

    def interrupt(_: Progress) -> None:
        raise KeyboardInterrupt

    run.search.tell = interrupt
    assert find_program(run.search, ByHand(), Plan()) is Ending.INTERRUPTED


def test_without_refinement_the_program_is_that_of_algorithm_1(
    finished: tuple[Path, Found, Run],
) -> None:
    path, found, _ = finished
    plain, run = whole(path, Budget(), Plan(refine=False))
    assert isinstance(plain, Found)
    assert plain.imitated == found.imitated
    assert plain.program.expansion == plain.imitated.expansion if plain.imitated else False
    assert not {"refine", "validate"} & {stage for stage, _ in run.recorded}


def test_ctrl_c_keeps_the_best_so_far() -> None:
    journal = Journal(None, Budget())
    run = search_in(journal, SHORT)

    def interrupt(progress: Progress) -> None:
        if progress.stage.startswith("tune (iteration 1)"):
            raise KeyboardInterrupt

    run.search.tell = interrupt
    found = find_program(run.search, ByHand(), Plan())
    assert isinstance(found, Found)
    assert found.ending is Ending.INTERRUPTED
    assert found.imitated is None
    best = max(c.mean for _, c in run.recorded)
    assert found.program.mean == best > 8.0
