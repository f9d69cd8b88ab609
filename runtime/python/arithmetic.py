"""IEEE 754 arithmetic where Python raises instead. Emitted Python copies what it needs of this."""

import ctypes
import math

NAN = math.nan
INFINITY = math.inf


def _round(x):
    """The binary32 number nearest to x."""
    return ctypes.c_float(x).value


def _divide(x, y):
    """IEEE division: never raises."""
    if y != 0.0:
        return x / y
    if x == 0.0 or x != x:
        return NAN
    return math.copysign(INFINITY, x) * math.copysign(1.0, y)


def _sqrt(x):
    """IEEE square root: NaN below zero."""
    return math.sqrt(x) if x >= 0.0 else NAN


def _exp(x):
    """Infinite where math.exp would raise."""
    try:
        return math.exp(x)
    except OverflowError:
        return INFINITY


def _tanh(x):
    """As in math."""
    return math.tanh(x)
