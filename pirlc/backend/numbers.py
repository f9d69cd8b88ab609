"""Constants of emitted code: the shortest decimal that reads back to the same number."""

from __future__ import annotations

import math
from typing import Literal

from pirlc.semantics.precision import BINARY32, BINARY64, Precision

RealType = Literal["double", "float"]
"""The C type that a controller computes in."""

PRECISIONS: dict[RealType, Precision] = {"double": BINARY64, "float": BINARY32}

LARGEST: dict[RealType, float] = {
    "double": 1.7976931348623157e308,
    "float": 3.4028234663852886e38,
}


def shortest(value: float, real: RealType) -> str:
    """The text of a finite number of the type, with a point or an exponent in it.

    >>> shortest(0.1, "double"), shortest(0.1, "float"), shortest(-0.0, "double")
    ('0.1', '0.1', '-0.0')
    >>> shortest(1e300, "double"), shortest(1e-45, "float"), shortest(3.0, "float")
    ('1e+300', '1e-45', '3.0')
    """
    rounded = PRECISIONS[real].round(value)
    assert math.isfinite(rounded), "infinities have no decimal"
    if real == "double" or rounded == 0.0:
        return repr(rounded)
    return _shortest_binary32(rounded)


def _shortest_binary32(value: float) -> str:
    """Fewest digits that lie nearer to `value` than to its neighbours, in exact arithmetic.

    Reading a decimal into binary64 and rounding that would round twice; a C compiler rounds once.
    """
    from fractions import Fraction  # binary64, the usual choice, starts without it

    exact = abs(Fraction(value))
    exponent = max(math.frexp(value)[1] - 24, -149)
    gap = Fraction(2) ** exponent
    is_power = exact == gap * 2**23 and exponent > -149
    below, above = exact - gap / (4 if is_power else 2), exact + gap / 2
    for digits in range(1, 10):
        text = f"{abs(value):.{digits - 1}e}"
        if Fraction(text) <= below:
            # Numbers below a power of two lie closer: the next decimal above may still be near it.
            unit = Fraction(10) ** (int(text.partition("e")[2]) + 1 - digits)
            text = f"{float(Fraction(text) + unit):.{digits - 1}e}"
        if below < Fraction(text) < above:
            break
    plain = repr(float(text))
    return f"-{plain}" if value < 0.0 else plain
