"""Findings as plain data that survives JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from fractions import Fraction
from typing import Any

from pirlc.ir.evidence import Evidence
from pirlc.source import Span


def as_data(value: Any) -> Any:
    """Dataclasses become objects (spans left out), enums their values, exact rationals an object
    of `exact` and `decimal`, numbers that JSON has no word for text, evidence an object with its
    `words`."""
    match value:
        case Evidence():
            return {"kind": value.kind.value, "words": str(value), "cases": value.cases}
        case Enum():
            return value.value
        case Fraction():
            return {"exact": str(value), "decimal": _decimal(value)}
        case Mapping():
            return {str(key): as_data(item) for key, item in value.items()}
        case tuple() | list():
            return [as_data(item) for item in value]
        case float() if not math.isfinite(value):
            return str(value)
        case _ if is_dataclass(value):
            members = ((f.name, getattr(value, f.name)) for f in fields(value))
            return {name: as_data(item) for name, item in members if not isinstance(item, Span)}
        case _:
            return value


def _decimal(value: Fraction) -> float | str:
    try:
        return float(value)
    except OverflowError:
        return "inf" if value > 0 else "-inf"
