"""What verification finds: plain values, for the command line, the report and their JSON.

Reals are exact (`Fraction`) where they were proved, floats where an evaluator computed them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from fractions import Fraction

from pirlc.ir.evidence import Evidence
from pirlc.source import NOWHERE, Span


@dataclass(frozen=True)
class History:
    """Good readings of each sensor, oldest first: steps + window - 1 of them.

    `previous` holds each action's applied value before the first step.
    """

    readings: Mapping[str, tuple[float, ...]]
    previous: Mapping[str, float]


@dataclass(frozen=True)
class Step:
    """What the interpreter answered in one step, by action."""

    raw: Mapping[str, float]
    applied: Mapping[str, float]


@dataclass(frozen=True)
class Replay:
    """A history and the interpreter's steps on it, oldest first."""

    history: History
    steps: tuple[Step, ...]


@dataclass(frozen=True)
class Obligation:
    """A property where windows hold something else than good readings: at warm-up, under
    `missing zero`, with `safe` values."""

    name: str
    evidence: Evidence
    counterexample: Replay | None = None


@dataclass(frozen=True)
class Extreme:
    """A supremum or infimum over all histories. `value` is None where it is infinite or not found
    (`evidence` tells); `witness` attains it, or comes within 1e-9 if it is not attained."""

    value: Fraction | None
    attained: bool
    evidence: Evidence
    witness: Replay | None = None


@dataclass(frozen=True)
class Tightest:
    """A comparison of a property, `text` against a number: how far `text` really goes, upward or
    downward, where the premises before it hold."""

    text: str
    claimed: Fraction
    upward: bool
    extreme: Extreme


@dataclass(frozen=True)
class PropertyFinding:
    """`evidence` is for real arithmetic, the other two for what runs; `counterexample` is a
    history that the interpreter was seen to violate the property on."""

    name: str
    text: str
    steps: int
    evidence: Evidence
    binary64: Evidence
    binary32: Evidence
    seconds: float
    counterexample: Replay | None = None
    obligations: tuple[Obligation, ...] = ()
    tightest: tuple[Tightest, ...] = ()
    span: Span = NOWHERE


@dataclass(frozen=True)
class AsComputed:
    """Sound bounds, not the tightest, of what a precision computes, on all histories: the raw
    result, its change in one step, and that of what is applied. None: none was found."""

    raw_lower: float | None
    raw_upper: float | None
    raw_change: float | None
    applied_change: float | None


@dataclass(frozen=True)
class ActionBounds:
    """Of one continuous action: its range before and after clipping, and the most that it changes
    in one step. `rounding64` and `rounding32` bound the distance of what runs from real arithmetic
    (None: no finite bound found), on histories where no guard's sign is in doubt; `binary64` and
    `binary32` bound it on all of them."""

    action: str
    raw_lower: Extreme
    raw_upper: Extreme
    raw_change: Extreme
    applied_lower: Extreme
    applied_upper: Extreme
    applied_change: Extreme
    rounding64: float | None
    rounding32: float | None
    binary64: AsComputed | None = None
    binary32: AsComputed | None = None


@dataclass(frozen=True)
class ChoiceBounds:
    """Of one discrete action: the values that some history makes it take."""

    action: str
    values: tuple[int, ...]
    unreachable: tuple[int, ...]
    evidence: Evidence


class Matter(Enum):
    """What is looked for without being asked."""

    DEAD_BRANCH = "branch that no history reaches"
    CONSTANT_GUARD = "guard that is always the same"
    JUMP = "largest jump across a switch"
    DIVISION = "division by zero"
    SQUARE_ROOT = "square root of a negative number"
    OVERFLOW = "overflow"
    NO_EFFECT = "parameter without effect"


@dataclass(frozen=True)
class Remark:
    """`text` says it in a sentence; `size` is a jump's; `clear` that nothing is wrong here (the
    division cannot be by zero, ...)."""

    matter: Matter
    text: str
    evidence: Evidence
    clear: bool
    span: Span = NOWHERE
    size: Extreme | None = None
    witness: Replay | None = None


@dataclass(frozen=True)
class GuardRounding:
    """Rounding can flip the comparison only where its sides are closer than this (None: no bound
    found)."""

    text: str
    margin64: float | None
    margin32: float | None
    span: Span = NOWHERE


@dataclass(frozen=True)
class Difference:
    """A part of the step (an output, a member of the state, the status) where emitted C and program
    are not shown to be equal."""

    part: str
    emitted: str
    program: str


@dataclass(frozen=True)
class EmittedFinding:
    """Whether the C made from a program is that program, for all inputs and states."""

    real: str
    evidence: Evidence
    seconds: float
    compared: tuple[str, ...]
    differences: tuple[Difference, ...] = ()


@dataclass(frozen=True)
class Verification:
    """Everything `pirlc verify` can tell about a program."""

    program: str
    properties: tuple[PropertyFinding, ...] = ()
    bounds: tuple[ActionBounds | ChoiceBounds, ...] = ()
    remarks: tuple[Remark, ...] = ()
    guards: tuple[GuardRounding, ...] = ()
    emitted: tuple[EmittedFinding, ...] = ()
