"""Exponents: the slope of a straight line through points in logarithms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Exponent:
    """`cost ~ size ** value`; the 95 % interval (Student's t) is `value` plus and minus `half`."""

    value: float
    half: float

    def __str__(self) -> str:
        return f"{self.value:.2f} ± {self.half:.2f}"


def exponent(sizes: Sequence[float], costs: Sequence[float]) -> Exponent:
    """Least squares through the logarithms; several costs may stand at one size.

    Of fewer than three points nothing can be told about the uncertainty: it is infinite.
    """
    x, y = np.log(sizes), np.log(costs)
    spread = float(((x - x.mean()) ** 2).sum())
    slope = float(((x - x.mean()) * (y - y.mean())).sum()) / spread
    freedom = len(x) - 2
    if freedom < 1:
        return Exponent(slope, math.inf)
    from scipy.special import stdtrit

    residual = y - y.mean() - slope * (x - x.mean())
    error = math.sqrt(float((residual**2).sum()) / freedom / spread)
    return Exponent(slope, float(stdtrit(freedom, 0.975)) * error)


def upper_half(sizes: Sequence[float]) -> list[float]:
    """The sizes above the middle of their range in logarithms, three at least.

    What a stage costs at any size hides its growth at the small ones.
    """
    different = sorted(set(sizes))
    middle = math.sqrt(different[0] * different[-1])
    above = [size for size in different if size >= middle * 0.999]
    return above if len(above) >= 3 else different[-3:]
