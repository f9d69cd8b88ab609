"""The journal answers what it knows, survives being cut off, and keeps to its budget."""

from __future__ import annotations

import json
import resource
import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

from pirlc.diagnostics import PirlcError
from pirlc.search.journal import Budget, BudgetExhausted, Journal


class Squares:
    """Squares numbers, and remembers which."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    def __call__(self, numbers: Sequence[int]) -> Iterator[dict[str, float]]:
        for number in numbers:
            self.asked.append(number)
            yield {"square": float(number * number)}

    def through(self, journal: Journal, *numbers: int) -> list[float]:
        keys = [f"square of {n}" for n in numbers]
        return [r["square"] for r in journal.each("square", numbers, keys, self)]


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_each_call_is_run_once(tmp_path: Path) -> None:
    journal, run = Journal(tmp_path / "journal", Budget()), Squares()
    assert run.through(journal, 3, 4, 3) == [9.0, 16.0, 9.0]
    assert run.through(journal, 4, 5) == [16.0, 25.0]
    assert run.asked == [3, 4, 5]
    assert journal.used == 5


def test_a_second_run_answers_from_the_file(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    first = Journal(path, Budget())
    Squares().through(first, 3, 4)
    first.close()
    again, run = Journal(path, Budget()), Squares()
    assert run.through(again, 4, 3) == [16.0, 9.0]
    assert run.asked == []
    assert again.used == 2
    assert run.through(again, 7) == [49.0]
    assert run.asked == [7]
    again.close()
    assert len(path.read_text(encoding="utf-8").splitlines()) == 3


def test_kinds_of_calls_are_kept_apart(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "journal", Budget())
    journal.each("one", [1], ["key"], lambda _: [1])
    assert journal.each("other", [1], ["key"], lambda _: [2]) == [2]
    assert journal.each("one", [1], ["key"], lambda _: [3]) == [1]


@pytest.mark.parametrize("number", [0.1, 1e-300, -0.0, float("inf"), 1.7976931348623157e308])
def test_numbers_come_back_to_the_bit(tmp_path: Path, number: float) -> None:
    path = tmp_path / "journal"
    first = Journal(path, Budget())
    first.each("number", [0], ["key"], lambda _: [[number]])
    first.close()
    (found,) = Journal(path, Budget()).each("number", [0], ["key"], lambda _: [])
    assert str(found) == str([number])


def test_a_result_is_in_the_file_before_the_next_is_computed(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    journal = Journal(path, Budget())
    lines: list[int] = []

    def run(numbers: Sequence[int]) -> Iterator[int]:
        for number in numbers:
            lines.append(len(path.read_text(encoding="utf-8").splitlines()))
            yield number

    journal.each("number", [1, 2, 3], ["a", "b", "c"], run)
    assert lines == [0, 1, 2]


@pytest.mark.parametrize("kept", range(1, 40, 7))
def test_a_line_that_was_cut_off_is_dropped(tmp_path: Path, kept: int) -> None:
    path = tmp_path / "journal"
    first = Journal(path, Budget())
    Squares().through(first, 3, 4, 5)
    first.close()
    whole = path.read_bytes()
    lines = whole.splitlines(keepends=True)
    path.write_bytes(b"".join(lines[:2]) + lines[2][:kept])
    again, run = Journal(path, Budget()), Squares()
    assert path.read_bytes() == b"".join(lines[:2])
    assert run.through(again, 3, 4, 5) == [9.0, 16.0, 25.0]
    assert run.asked == [5]
    again.close()
    assert path.read_bytes() == whole


def test_a_line_without_its_end_is_dropped(tmp_path: Path) -> None:
    # It may be whole or not: `1` could have been going to be `12`.
    path = tmp_path / "journal"
    first = Journal(path, Budget())
    Squares().through(first, 3, 4)
    first.close()
    path.write_bytes(path.read_bytes()[:-1])
    run = Squares()
    run.through(Journal(path, Budget()), 3, 4)
    assert run.asked == [4]


def test_a_budget_of_calls() -> None:
    journal, run = Journal(None, Budget(calls=3)), Squares()
    run.through(journal, 1, 2)
    # A batch is begun as long as something is left, and then finished.
    assert run.through(journal, 3, 4) == [9.0, 16.0]
    with pytest.raises(BudgetExhausted):
        run.through(journal, 5)
    assert run.asked == [1, 2, 3, 4]
    assert journal.used == 4


def test_known_calls_count_too(tmp_path: Path) -> None:
    # So that a search that is resumed stops where it would have stopped.
    path = tmp_path / "journal"
    first = Journal(path, Budget())
    Squares().through(first, 1, 2, 3)
    first.close()
    journal, run = Journal(path, Budget(calls=2)), Squares()
    run.through(journal, 1)
    run.through(journal, 2)
    with pytest.raises(BudgetExhausted):
        run.through(journal, 3)
    assert run.asked == []


def test_a_budget_of_seconds() -> None:
    clock = Clock()
    journal, run = Journal(None, Budget(seconds=10.0, clock=clock)), Squares()
    run.through(journal, 1)
    clock.now += 9.9
    run.through(journal, 2)
    clock.now += 0.1
    with pytest.raises(BudgetExhausted):
        run.through(journal, 3)
    assert journal.budget.elapsed == pytest.approx(10.0)


def test_a_search_stopped_by_time_can_be_replayed_by_its_count() -> None:
    def search(budget: Budget, clock: Clock) -> tuple[list[int], int]:
        journal, run = Journal(None, budget), Squares()
        with pytest.raises(BudgetExhausted):
            for n in range(100):
                run.through(journal, 2 * n, 2 * n + 1)
                clock.now += 3.0
        return run.asked, journal.used

    clock = Clock()
    asked, used = search(Budget(seconds=10.0, clock=clock), clock)
    assert used == 8
    assert search(Budget(calls=used), Clock()) == (asked, used)


def test_the_last_calls_are_allowed() -> None:
    journal, run = Journal(None, Budget(calls=1)), Squares()
    run.through(journal, 1)
    with pytest.raises(BudgetExhausted):
        run.through(journal, 2)
    journal.lift_budget()
    assert run.through(journal, 2) == [4.0]


def test_an_interrupted_batch_keeps_what_it_had(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    journal = Journal(path, Budget())

    def run(numbers: Sequence[int]) -> Iterator[int]:
        yield numbers[0]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        journal.each("number", [1, 2], ["a", "b"], run)
    journal.close()
    assert len(path.read_text(encoding="utf-8").splitlines()) == 1
    found = Journal(path, Budget()).each("number", [1, 2], ["a", "b"], lambda items: items)
    assert found == [1, 2]


@contextmanager
def limited_files(size: int) -> Iterator[None]:
    """Files of this process cannot grow beyond `size` bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, handler)


def test_a_full_disk_loses_nothing_that_was_written(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    journal = Journal(path, Budget())
    run = Squares()
    run.through(journal, 1, 2, 3)
    written = path.read_bytes()
    with limited_files(len(written) + 10), pytest.raises(PirlcError, match="journal"):
        run.through(journal, 4)
    left = tmp_path / "what is left"
    left.write_bytes(path.read_bytes())
    assert left.stat().st_size == len(written) + 10
    again, run = Journal(left, Budget()), Squares()
    assert run.through(again, 1, 2, 3, 4) == [1.0, 4.0, 9.0, 16.0]
    assert run.asked == [4]
    again.close()
    lines = [json.loads(line) for line in left.read_text(encoding="utf-8").splitlines()]
    assert [line["result"]["square"] for line in lines] == [1.0, 4.0, 9.0, 16.0]
