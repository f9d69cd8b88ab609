"""History sets: what they hold, how they join, how much memory they take."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pirlc.ir.policy import ActionSpec, Choice, Continuous, Fill, Hold, Interface, Sensor
from pirlc.semantics.histories import HistorySet, Layout, histories_of, join
from pirlc.semantics.interpreter import MISSING, OUT_OF_RANGE
from pirlc.semantics.precision import Precision

ACTIONS = (
    ActionSpec("A", Continuous(-1.0, 1.0, 0.25), 0),
    ActionSpec("B", Choice((4, 5), 5), 1),
)


def interface(window: int = 3, latency: int = 0, fill: Fill = Fill.FIRST) -> Interface:
    sensors = (Sensor("x", 0.0, 10.0, 1), Sensor("y", 0.0, 1.0, 0, Hold(1)))
    return Interface("i", None, sensors, ACTIONS, window, None, latency, fill)


def trajectory(x: list[float], y: list[float] | None = None) -> tuple[np.ndarray, np.ndarray]:
    observations = np.column_stack([y if y is not None else [0.5] * len(x), x])
    actions = np.column_stack([np.arange(len(x)) / 100, np.full(len(x), 4)])
    return observations, actions


def test_windows_are_oldest_first_and_warm_up_with_the_first_reading() -> None:
    histories = histories_of(interface(), [trajectory([1, 2, 3, 4]), trajectory([7, 8])])
    assert len(histories) == 6
    assert histories.window("x").tolist() == [
        [1, 1, 1],
        [1, 1, 2],
        [1, 2, 3],
        [2, 3, 4],
        [7, 7, 7],
        [7, 7, 8],
    ]
    assert histories.element("x", -2).tolist() == [1, 1, 2, 3, 7, 7]


def test_fill_zero_and_latency() -> None:
    zero = histories_of(interface(fill=Fill.ZERO), [trajectory([1, 2])])
    assert zero.window("x").tolist() == [[0, 0, 1], [0, 1, 2]]
    late = histories_of(interface(latency=2), [trajectory([1, 2, 3, 4])])
    assert late.window("x").tolist() == [[1, 1, 1], [1, 1, 1], [1, 1, 1], [1, 1, 2]]


def test_previous_actions_start_at_safe() -> None:
    histories = histories_of(interface(), [trajectory([1, 2, 3]), trajectory([7, 8])])
    previous = histories.of_histories(histories.previous["A"])
    assert previous.tolist() == [0.25, 0.0, 0.01, 0.25, 0.0]
    assert histories.of_histories(histories.previous["B"]).tolist() == [5, 4, 4, 5, 4]


def test_a_late_first_reading_fills_the_windows_from_there_on() -> None:
    nan = math.nan
    histories = histories_of(
        interface(), [trajectory([nan, nan, 3, nan, 5], [0.1, 0.2, 0.3, 0.4, 0.5])]
    )
    assert histories.window("x").tolist() == [
        [5, 5, 5],  # the middle of [0, 10]
        [5, 5, 5],
        [3, 3, 3],
        [3, 3, 3],
        [3, 3, 5],
    ]
    assert histories.window("y")[:, 0].tolist() == [0.1, 0.1, 0.1, 0.2, 0.3]
    assert len(histories) == 5


def test_status_and_staleness() -> None:
    nan = math.nan
    histories = histories_of(
        interface(), [trajectory([1, 11, nan, 4, 5], [0.5, nan, nan, nan, 0.5])]
    )
    both = MISSING | OUT_OF_RANGE
    assert histories.status[histories.places].tolist() == [0, both, MISSING, MISSING, 0]
    assert histories.failed[histories.places].tolist() == [False, False, True, True, False]


def test_joining_is_building_from_all_trajectories() -> None:
    trajectories = [trajectory([1, 2, 3, 4]), trajectory([7]), trajectory([math.nan, 2, 8])]
    whole = histories_of(interface(), trajectories)
    joined = join([histories_of(interface(), [t]) for t in trajectories])
    assert joined.extent == whole.extent
    for name in ("x", "y"):
        assert joined.sensors[name].tobytes() == whole.sensors[name].tobytes()
    for name in ("A", "B"):
        assert joined.previous[name].tobytes() == whole.previous[name].tobytes()
    assert joined.places.tolist() == whole.places.tolist()
    assert joined.status.tolist() == whole.status.tolist()


def test_selection_keeps_order_and_everything_about_a_history() -> None:
    whole = histories_of(interface(), [trajectory([1, 2, 3, math.nan]), trajectory([7, 80])])
    chosen = whole.select([5, 0, 3])
    assert (chosen.layout, len(chosen)) == (Layout.GATHERED, 3)
    assert chosen.window("x").tolist() == [[7, 7, 80], [1, 1, 1], [2, 3, 3]]
    assert chosen.status.tolist() == [OUT_OF_RANGE, 0, MISSING]
    assert chosen.previous["A"].tolist() == [0.0, 0.25, 0.02]
    again = chosen.select([2])
    assert again.window("x").tolist() == [[2, 3, 3]]
    assert join([chosen, again]).window("x")[-1].tolist() == [2, 3, 3]


def test_samples_are_the_same_for_the_same_seed() -> None:
    whole = histories_of(interface(), [trajectory(list(np.linspace(0, 10, 500)))])
    one, same, other = (whole.sample(50, seed).window("x").tolist() for seed in (1, 1, 2))
    assert one == same != other
    assert len({tuple(row) for row in one}) == 50, "without replacement"
    assert whole.sample(500, 1) is whole


def nbytes(window: int) -> int:
    generator = np.random.default_rng(0)
    trajectories = [
        trajectory(list(generator.uniform(0, 10, 200)), list(generator.uniform(0, 1, 200)))
        for _ in range(50)
    ]
    return histories_of(interface(window), trajectories).nbytes


def test_memory_does_not_grow_with_the_window() -> None:
    readings = 50 * 200
    assert nbytes(5) < 45 * readings
    assert nbytes(50) < 1.4 * nbytes(2)


def test_sets_cannot_be_written_to() -> None:
    histories = histories_of(interface(), [trajectory([1, 2, 3])])
    with pytest.raises(ValueError, match="read-only"):
        histories.sensors["x"][0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        histories.select([0]).status[0] = 1


def test_binary32_judges_readings_after_rounding() -> None:
    double, single = (
        histories_of(interface(), [trajectory([0.1, 1e200])], precision) for precision in Precision
    )
    assert double.status.tolist() == [0, OUT_OF_RANGE]
    assert single.status.tolist() == [0, MISSING]
    assert single.window("x")[1].tolist() == [np.float32(0.1)] * 3


@pytest.mark.parametrize("trajectories", [[], [trajectory([])]])
def test_empty(trajectories: list) -> None:
    empty: HistorySet = histories_of(interface(), trajectories)
    assert (len(empty), empty.extent) == (0, 0)
    assert len(join([empty, histories_of(interface(), [trajectory([1, 2])])])) == 2


def test_a_selection_too_large_to_gather_stays_a_view(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = histories_of(interface(), [trajectory([1, 2, 3, math.nan]), trajectory([7, 80])])
    order = [5, 0, 3, 3]
    gathered = whole.select(order)
    monkeypatch.setattr("pirlc.semantics.histories.GATHERED_BYTES", 4 * 2 * 3 * 8 - 1)
    view = whole.select(order)
    assert (view.layout, len(view), view.extent) == (Layout.FLAT, 4, whole.extent)
    assert all(view.sensors[name] is whole.sensors[name] for name in whole.sensors)
    for name in ("x", "y"):
        np.testing.assert_array_equal(view.window(name), gathered.window(name))
        np.testing.assert_array_equal(view.element(name, -2), gathered.element(name, -2))
    for name in ("A", "B"):
        np.testing.assert_array_equal(
            view.of_histories(view.previous[name]), gathered.previous[name]
        )
    np.testing.assert_array_equal(view.of_histories(view.status), gathered.status)
    assert view.select([2, 0]).window("x").tolist() == gathered.select([2, 0]).window("x").tolist()
    both = join([view, view.select(range(4))])
    assert both.window("x").tolist() == 2 * gathered.window("x").tolist()


def test_all_histories_in_another_order_are_not_taken_for_the_whole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("pirlc.semantics.histories.GATHERED_BYTES", 0)
    whole = histories_of(interface(), [trajectory([1, 2, 3, 4])])
    assert whole.dense
    assert whole.select(range(4)).dense
    turned = whole.select([3, 2, 1, 0])
    assert not turned.dense
    assert turned.element("x", -1).tolist() == [4, 3, 2, 1]
