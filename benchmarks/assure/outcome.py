"""What checks find."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Outcome:
    """Of one check of one subject: `findings` are faults, each a line or more of text.

    `accepted` counts what a deviation in the table of `deviations` allows, by its identifier;
    `counts` are sizes of what was done (steps, say), which are added up.
    """

    findings: tuple[str, ...] = ()
    accepted: Counter[str] = field(default_factory=Counter)
    counts: Counter[str] = field(default_factory=Counter)
