"""The comparison of the optimisers: which templates, and what is made of the measurements."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.optimizers import Row, as_markdown, compare, spread, summaries, write
from pirlc.tune import Optimizer, Tuning
from tests.tune.test_tune import problem_of

ROWS = [
    Row(
        "A",
        1,
        16,
        2,
        {"casadi": 0.1, "bayes": 0.2, "smt": 0.1},
        {"casadi": 1, "bayes": 20, "smt": 4},
    ),
    Row("A", 9, 40, 8, {"casadi": 0.3, "bayes": 0.2}, {"casadi": 1, "bayes": 40}),
    Row("B", 1, 11, 3, {"casadi": 0.0, "bayes": 0.5}, {"casadi": 2, "bayes": 100}),
]


@pytest.mark.parametrize(
    ("total", "count", "places"),
    [(3, 12, [0, 1, 2]), (160, 1, [80]), (160, 2, [0, 159]), (10, 4, [0, 3, 6, 9])],
)
def test_templates_are_spread_over_the_pool(total: int, count: int, places: list[int]) -> None:
    assert spread(total, count) == places


def test_pairs_are_compared_where_both_can_take_the_template() -> None:
    found = {(s.environment, s.optimizers[1]): s for s in summaries(ROWS)}
    assert set(found) == {
        ("A", "bayes"), ("B", "bayes"), ("all", "bayes"), ("A", "smt"), ("all", "smt"),
    }  # fmt: skip
    a = found["A", "bayes"]
    assert a.templates == 2
    assert a.means == pytest.approx((0.2, 0.2))
    assert a.largest_excess == pytest.approx(0.1)
    assert a.ratio == pytest.approx(2 / 60)
    assert found["all", "bayes"].ratio == pytest.approx(4 / 160)
    assert found["all", "smt"].templates == 1
    assert found["B", "bayes"].largest_excess == -0.5


def test_tables_and_data(tmp_path: Path) -> None:
    write(ROWS, 200, 0, tmp_path)
    text = (tmp_path / "optimizers.md").read_text()
    assert text == as_markdown(ROWS, 200)
    assert "| A | bayes | 2 | 0.2000 | 0.2000 | +0.1000 | 2.0 | 60.0 | 1/30 |" in text
    assert "| A | 9 | 40 | 8 | 0.3000 | 1.0 | 0.2000 | 40.0 | - | - |" in text
    data = json.loads((tmp_path / "optimizers.json").read_text())
    assert len(data["rows"]) == 3 and data["trials"] == 200
    assert {"environment": "all", "templates": 3}.items() <= data["summary"][2].items()


def test_every_optimiser_that_can_takes_its_turn() -> None:
    text = "action A : {0, 1} = if exp(?a * peek(S, -1)) > 1.2 then 1 else 0"
    problem = problem_of(text, {"A_a": 0.8})
    hows = [Tuning(optimizer, trials=11) for optimizer in Optimizer]
    row = compare("E", 5, problem, 0, hows)
    assert set(row.distances) == set(row.seconds) == {"casadi", "bayes"}
    assert (row.template, row.size, row.parameters) == (5, problem.template.size, 1)
    assert all(seconds > 0.0 for seconds in row.seconds.values())
    assert np.isfinite(list(row.distances.values())).all() and row.distances["casadi"] < 0.05
