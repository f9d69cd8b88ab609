"""Rounding to binary32, against the processor's own binary32."""

from __future__ import annotations

import math
import operator
import random

import numpy as np
import pytest

from pirlc.semantics.precision import BINARY32, BINARY64, middle, to_binary32, widened
from tests.support.programs import ODD_NUMBERS


def some_numbers(rng: random.Random, count: int) -> list[float]:
    """Of every size that binary64 has."""
    return [
        *ODD_NUMBERS,
        math.inf,
        -math.inf,
        *(rng.uniform(-1, 1) * 2.0 ** rng.randint(-170, 140) for _ in range(count)),
        *(rng.uniform(-4, 4) for _ in range(count)),
    ]


def test_rounding_is_the_processors() -> None:
    numbers = some_numbers(random.Random(1), 20_000)
    with np.errstate(over="ignore"):
        theirs = np.array(numbers).astype(np.float32).astype(np.float64)
    ours = np.array([to_binary32(x) for x in numbers])
    assert (ours.view(np.int64) == theirs.view(np.int64)).all()
    assert math.isnan(to_binary32(math.nan))
    assert BINARY64.round(0.1) == 0.1
    assert BINARY32.round(0.1) != 0.1


@pytest.mark.parametrize("operation", [operator.add, operator.sub, operator.mul, operator.truediv])
def test_rounding_twice_is_innocuous(operation) -> None:
    rng = random.Random(2)
    with np.errstate(all="ignore"):
        a = np.array(some_numbers(rng, 100_000)).astype(np.float32)
        b = a.copy()
        np.random.default_rng(2).shuffle(b)
        single = operation(a, b)
        double = operation(a.astype(np.float64), b.astype(np.float64)).astype(np.float32)
    same = (single.view(np.int32) == double.view(np.int32)) | (np.isnan(single) & np.isnan(double))
    assert same.all()


def test_square_roots_too() -> None:
    with np.errstate(over="ignore"):
        a = np.abs(np.array(some_numbers(random.Random(3), 100_000))).astype(np.float32)
    double = np.sqrt(a.astype(np.float64)).astype(np.float32)
    assert (np.sqrt(a).view(np.int32) == double.view(np.int32)).all()


def test_ranges_widen_to_the_nearest_binary32() -> None:
    for bound in some_numbers(random.Random(4), 2_000):
        low, high = widened(bound, bound)
        assert low <= bound <= high
        with np.errstate(over="ignore"):
            assert low == high or float(np.nextafter(np.float32(low), np.float32(np.inf))) == high
        assert to_binary32(low) == low
        assert to_binary32(high) == high


def test_middle() -> None:
    assert middle(-1.0, 3.0) == 1.0
    assert middle(-1.7e308, 1.7e308) == 0.0
    assert middle(1.7e308, 1.79e308) < math.inf
