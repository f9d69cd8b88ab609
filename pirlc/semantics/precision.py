"""The two working precisions, and how binary64 numbers become binary32 ones.

Python computes in binary64. Rounding each `+ - * /` and square root of two binary32 numbers once
more, to binary32, gives the very binary32 result: 53 >= 2 * 24 + 2 bits make the double rounding
innocuous (S. Figueroa, "When is double rounding innocuous?", SIGNUM Newsletter 30(3), 1995).
"""

from __future__ import annotations

import math
import struct
from enum import Enum
from functools import lru_cache

_PACK = struct.Struct("<f")
_BITS = struct.Struct("<i")


def to_binary32(x: float) -> float:
    """The binary32 number nearest to `x` (ties to even), infinite where `x` is too large."""
    try:
        rounded: float = _PACK.unpack(_PACK.pack(x))[0]
    except OverflowError:
        return math.copysign(math.inf, x)
    return rounded


class Precision(Enum):
    """The numbers that every operation's result is rounded to."""

    BINARY64 = "binary64"
    BINARY32 = "binary32"

    def round(self, x: float) -> float:
        return x if self is Precision.BINARY64 else to_binary32(x)


BINARY64 = Precision.BINARY64
BINARY32 = Precision.BINARY32


def _next_binary32(x: float, up: bool) -> float:
    """The neighbour of a finite or infinite binary32 number."""
    if x == 0.0:
        step: float = _PACK.unpack(_BITS.pack(1))[0]
        return step if up else -step
    (bits,) = _BITS.unpack(_PACK.pack(x))
    away = (x > 0.0) == up
    neighbour: float = _PACK.unpack(_BITS.pack(bits + (1 if away else -1)))[0]
    return neighbour


@lru_cache(maxsize=4096)
def widened(lower: float, upper: float) -> tuple[float, float]:
    """The range [lower, upper] widened outward to the nearest binary32 numbers.

    Environments often round their readings to binary32, so a reading at the very bound of a range
    may lie a hair outside it.
    """
    low, high = to_binary32(lower), to_binary32(upper)
    if low > lower:
        low = _next_binary32(low, up=False)
    if high < upper:
        high = _next_binary32(high, up=True)
    return low, high


def middle(lower: float, upper: float) -> float:
    """The middle of a range, where windows stand before any reading; in binary64."""
    return lower * 0.5 + upper * 0.5
