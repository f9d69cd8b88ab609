"""Exact arithmetic on the two formats' numbers: neighbours, and decimals rounded once."""

from __future__ import annotations

import math
import struct

from pirlc.semantics.precision import BINARY64, Precision, to_binary32

LARGEST = {Precision.BINARY64: 1.7976931348623157e308, Precision.BINARY32: 3.4028234663852886e38}
"""The largest finite number of each format."""

_REAL, _BITS = struct.Struct("<f"), struct.Struct("<I")


def below(x: float, precision: Precision) -> float:
    """The largest number of the format under `x`, which is one of them and not minus infinity.

    >>> below(0.0, Precision.BINARY64), below(float("inf"), Precision.BINARY32)
    (-5e-324, 3.4028234663852886e+38)
    """
    if precision is BINARY64:
        return math.nextafter(x, -math.inf)
    if x == 0.0:
        bits = 0x80000001
    else:
        (bits,) = _BITS.unpack(_REAL.pack(x))
        bits += -1 if x > 0.0 else 1
    result: float = _REAL.unpack(_BITS.pack(bits))[0]
    return result


def decimal(text: str, precision: Precision) -> float:
    """The number of the format nearest to a decimal, rounded once, as C99's annex F has it.

    >>> decimal("0.1", Precision.BINARY32), decimal("1e-46", Precision.BINARY32)
    (0.10000000149011612, 0.0)
    """
    nearest = float(text)
    if precision is BINARY64:
        return nearest
    from fractions import Fraction  # binary64, the usual choice, starts without it

    exact = Fraction(text)
    # Rounding twice is at most one neighbour off: the nearest of three is right, ties to even.
    near = to_binary32(nearest)
    if math.isinf(near) or exact == 0:
        return near
    candidates = [near, below(near, precision), -below(-near, precision)]
    finite = [c for c in candidates if math.isfinite(c)]
    return min(finite, key=lambda c: (abs(Fraction(c) - exact), _is_odd(c)))


def _is_odd(x: float) -> int:
    (bits,) = _BITS.unpack(_REAL.pack(x))
    return int(bits) & 1
