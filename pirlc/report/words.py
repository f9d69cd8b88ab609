"""Numbers in words, for the page's sentences."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def number(value: float) -> str:
    """A return with as many decimals as are worth reading."""
    return f"{value:.2f}" if abs(value) < 10_000 else f"{value:,.0f}"


def interval(estimate: Mapping[str, Any]) -> str:
    """What is known of a mean return: `mean`, `low` and `high`, `episodes`."""
    low, high = estimate["low"], estimate["high"]
    if estimate["episodes"] > 1:
        return f"[{number(low)}, {number(high)}]"
    exact = low == high
    return "exact: the environment is deterministic" if exact else "one episode, no interval"


def in_interval(subject: Mapping[str, Any]) -> str:
    """The mean with its interval, for a sentence."""
    sure = subject["interval"]
    words = f"95 % interval {sure}" if sure.startswith("[") else sure
    return f"{number(subject['mean'])} ({words})"


def counted(count: int, one: str, many: str | None = None) -> str:
    """``1 proof``, ``2 proofs``."""
    return f"{count:,} {one if count == 1 else many or one + 's'}"
