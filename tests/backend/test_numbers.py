"""Constants read back to the number they stand for, in as few digits as that takes."""

from __future__ import annotations

import math
import random
import struct
from fractions import Fraction

import numpy as np

from pirlc.backend.c_expressions import constant
from pirlc.backend.numbers import shortest
from pirlc.backend.python_expressions import constant as python_constant


def binary32(bits: int) -> float:
    return struct.unpack("<f", struct.pack("<I", bits))[0]


def digits(text: str) -> int:
    return len(text.split("e")[0].replace(".", "").strip("-0"))


def is_tie(value: float, text: str) -> bool:
    """Whether the decimal lies just between two binary32 numbers: we print one digit more."""
    with np.errstate(over="ignore"):
        neighbours = [np.nextafter(np.float32(value), np.float32(to)) for to in (-np.inf, np.inf)]
    middles = [(Fraction(value) + Fraction(float(n))) / 2 for n in neighbours if np.isfinite(n)]
    return Fraction(text) in middles


def test_binary32_constants_are_numpys_shortest():
    rng = random.Random(0)
    edges = [0, 1, 2, 0x007FFFFF, 0x00800000, 0x7F7FFFFF, 0x3F800000, 0x4B800000, 0x33800000]
    powers = [exponent << 23 for exponent in range(1, 255)]
    subnormal = [*range(300), *(rng.randrange(1 << 23) for _ in range(300))]
    for bits in [*edges, *powers, *subnormal, *(rng.randrange(0x7F800000) for _ in range(2000))]:
        for sign in (0, 1 << 31):
            value = binary32(bits | sign)
            text = shortest(value, "float")
            assert struct.pack("<f", np.float32(text)) == struct.pack("<f", value)
            unique = np.format_float_scientific(np.float32(value), unique=True)
            assert digits(text) <= digits(unique) + is_tie(value, unique)


def test_binary64_constants():
    values = [1e-7, 0.1, 1e300, 5e-324, 1e16, 123456789012345680.0, -0.0]
    texts = ["1e-07", "0.1", "1e+300", "5e-324", "1e+16", "1.2345678901234568e+17", "-0.0"]
    assert [shortest(value, "double") for value in values] == texts


def test_infinities_and_suffixes():
    assert constant(1e300, "float").code == "HUGE_VALF"
    assert constant(-math.inf, "double").code == "-HUGE_VAL"
    assert constant(-1e300, "float").code == "-HUGE_VALF"
    assert constant(0.1, "float").code == "0.1f"
    assert constant(1e-50, "float").code == "0.0f"
    assert python_constant(-1e300, "float").code == "-INFINITY"
    assert python_constant(0.1, "float").code == "0.10000000149011612"


def test_a_decimal_halfway_between_two_numbers_is_not_trusted():
    """5.368712e8 lies just between them: which one it reads as is the reader's rounding."""
    assert shortest(536871168.0, "float") == "536871170.0"
    assert shortest(536871232.0, "float") == "536871230.0"
    assert shortest(-536871232.0, "float") == "-536871230.0"


def test_zeros_keep_their_sign():
    assert [shortest(zero, "float") for zero in (0.0, -0.0, 1e-50, -1e-50)] == [
        "0.0",
        "-0.0",
        "0.0",
        "-0.0",
    ]
