"""Symbolic forms over many histories: a block at a time gives what all at once gives."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.growth import workloads as given
from pirlc.semantics.histories import HistorySet, histories_of
from pirlc.semantics.precision import Precision
from pirlc.symbolic import blocks, smooth
from pirlc.symbolic.affine import DesignMatrices, affine_split
from pirlc.symbolic.blocks import blocks_of
from pirlc.symbolic.casadi_form import Element, casadi_form
from pirlc.symbolic.smooth import SmoothedObjective

COUNT = 1_003
TEMPLATE = given.every_sensor(3, 4)
THETA = np.array(list(given.values_of(TEMPLATE).values()))
LARGE = 10**9


def objective(
    patch: pytest.MonkeyPatch, histories: HistorySet, block: int, kept: int = LARGE
) -> SmoothedObjective:
    patch.setattr(blocks, "BLOCK", block)
    patch.setattr(blocks, "KEPT", kept)
    labels = given.labels_for(histories)
    weights = np.random.default_rng(2).uniform(0.0, 1.0, len(histories))
    return SmoothedObjective(TEMPLATE, histories, labels, weights)


@pytest.mark.parametrize(("count", "most"), [(0, 10), (1, 10), (10, 10), (11, 10), (1_003, 100)])
def test_every_history_counts_in_one_block(
    count: int, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(blocks, "BLOCK", most)
    made = blocks_of(count)
    assert made.size <= most
    numbers, weights = np.arange(count, dtype=np.float64), np.ones(count)
    counted = np.zeros(count)
    for piece, share in zip(made.cut(numbers), made.shares(weights), strict=True):
        assert piece.shape == share.shape == (made.size,)
        counted[piece.astype(np.intp)] += share
    assert (counted == 1.0).all()
    assert (weights == 1.0).all()


@pytest.mark.parametrize("gathered", [False, True])
@pytest.mark.parametrize("precision", list(Precision))
def test_blocks_change_no_objective(
    gathered: bool, precision: Precision, monkeypatch: pytest.MonkeyPatch
) -> None:
    histories = histories_of(TEMPLATE.interface, given.trajectories(COUNT, 3), precision)
    if gathered:
        histories = histories.select(np.random.default_rng(0).permutation(COUNT))
    whole = objective(monkeypatch, histories, LARGE)
    value, gradient = whole(THETA, 0.3)
    for block, kept in ((100, LARGE), (100, 0), (COUNT - 1, 0)):
        other = objective(monkeypatch, histories, block, kept)
        np.testing.assert_array_equal(other.margins(THETA), whole.margins(THETA))
        for _ in range(2):
            other_value, other_gradient = other(THETA, 0.3)
            assert other_value == pytest.approx(value, rel=1e-12)
            np.testing.assert_allclose(other_gradient, gradient, rtol=1e-9, atol=1e-13)


def test_rows_are_the_same_kept_or_gathered(monkeypatch: pytest.MonkeyPatch) -> None:
    histories = given.history_set(TEMPLATE, COUNT)
    kept, kept_slope = objective(monkeypatch, histories, 100, LARGE)(THETA, 0.3)
    gathered, gathered_slope = objective(monkeypatch, histories, 100, 0)(THETA, 0.3)
    assert kept == gathered
    np.testing.assert_array_equal(kept_slope, gathered_slope)


def test_guards_of_many_histories_are_looked_at_evenly(monkeypatch: pytest.MonkeyPatch) -> None:
    histories = given.history_set(TEMPLATE, COUNT)
    all_of_them = objective(monkeypatch, histories, 50).margins(THETA)
    assert all_of_them.shape == (1, COUNT)
    monkeypatch.setattr(smooth, "MARGINS", 240)
    looked_at = objective(monkeypatch, histories, 50).margins(THETA)
    size = blocks_of(COUNT).size
    assert looked_at.shape == (1, 240 // size * size)
    places = np.arange(looked_at.shape[1]) * COUNT // looked_at.shape[1]
    np.testing.assert_array_equal(looked_at, all_of_them[:, places])
    assert places[-1] > 0.99 * COUNT


def test_a_form_asks_for_what_it_peeks_at_alone() -> None:
    template = given.only_template(given.sketch(3, 64, "?k * peek(s2, -1) + ?d * peek(s0, -64)"))
    form = casadi_form(template, 5)
    assert set(form.inputs) == {Element("s2", -1), Element("s0", -64)}


def test_a_design_comes_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    histories = given.history_set(TEMPLATE, COUNT)
    split = affine_split(TEMPLATE)
    others = dict.fromkeys(split.others, 0.3)
    [whole] = DesignMatrices(TEMPLATE, split, histories)(others)
    monkeypatch.setattr(blocks, "BLOCK", 100)
    many = DesignMatrices(TEMPLATE, split, histories)
    [again] = many(others)
    np.testing.assert_array_equal(again.matrix, whole.matrix)
    np.testing.assert_array_equal(again.offset, whole.offset)
    pieces = list(many.in_blocks(others))
    assert len(pieces) == many.pieces == 11
    assert [begin for begin, _ in pieces][:3] == [0, 92, 184]
    matrices = np.concatenate([design.matrix for _, [design] in pieces])
    offsets = np.concatenate([design.offset for _, [design] in pieces])
    np.testing.assert_array_equal(matrices, whole.matrix)
    np.testing.assert_array_equal(offsets, whole.offset)
