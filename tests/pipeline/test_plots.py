"""The plot of a search: single very bad programs do not stretch its axis."""

from __future__ import annotations

import math

import pytest

from pirlc.report.plots import lowest_shown


@pytest.mark.parametrize(
    ("means", "lowest"),
    [
        ([], -math.inf),
        ([5.0], -math.inf),
        ([1.0, 2.0, 3.0, 4.0], -math.inf),
        ([-1e6, 10.0, 12.0, 14.0, 16.0], 10.0 - 0.5 * 6.0),
        ([-1e6, 7.0, 7.0, 7.0, 7.0], -math.inf),
        ([-1e6, -1e6, -1e6, 12.0], -math.inf),
    ],
)
def test_where_the_axis_ends(means, lowest):
    assert lowest_shown(means) == pytest.approx(lowest)
