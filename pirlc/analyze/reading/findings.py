"""What a program says, as plain values: for the command line, the page and their JSON.

Numbers are those of the program text, as floats; texts name readings by their sensors: `X` is the
newest that the program sees, `X(k-1)` the one before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum


class Kind(Enum):
    """Of a branch's law."""

    CONSTANT = "constant"
    PID = "PID"
    FEEDBACK = "linear in several sensors"
    GENERAL = "not linear"


@dataclass(frozen=True)
class Gain:
    """What a law makes of one sensor: kp e + ki (sum of the last `window` e) + kd (change of e).

    e is setpoint - reading, so that a positive gain raises the action while the reading is too low.
    `weights` are those of the readings themselves, the newest first; a sensor whose weights make no
    PID has no kp, ki and kd. `at_rest` is minus their sum: kp + window ki.
    """

    sensor: str
    kp: float | None
    ki: float | None
    kd: float | None
    window: int
    at_rest: float
    weights: tuple[float, ...]


@dataclass(frozen=True)
class Limit:
    """What alone takes the action from 0 to its limits: `what` at `lower` and at `upper` (None: it
    never does). `reachable`: whether readings in range get there."""

    what: str
    lower: float | None
    upper: float | None
    reachable: bool


@dataclass(frozen=True)
class Settling:
    """Of a branch by itself, and of its loop where a plant is known.

    `memory` (steps): the action answers to so many readings and forgets what is older, but for
    `kept`: the share of its own last value that it adds (None: nothing). `seconds` is `memory` in
    time. Loop figures are of `pirlc analyze`: times in seconds, in steps without a sample time.
    `why` says why there are none.
    """

    memory: int
    seconds: float | None
    kept: float | None
    stable: bool | None = None
    slowest_pole: float | None = None
    settling_time: float | None = None
    overshoot: float | None = None
    gain_margin: float | None = None
    phase_margin: float | None = None
    delay_margin: float | None = None
    why: str = ""


@dataclass(frozen=True)
class Law:
    """What an action is on a branch. `range` is what comes out before clipping while readings are
    in their ranges. `setpoint` is the value of a PID's, or None where it moves (`setpoint_text`
    says with what) or there is none. `rest` is the part that is not linear, in words."""

    kind: Kind
    text: str
    value: float | None
    gains: tuple[Gain, ...]
    setpoint: float | None
    setpoint_text: str
    offset: float
    rest: str
    range: tuple[float, float]
    clipped: bool
    limits: tuple[Limit, ...]
    at_rest: str
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Branch:
    """A numbered leaf. `when` must all hold (nothing: always); `boundaries` are comparisons of
    several readings with what each is when solved for one. `never` says why readings in range do
    not get here. `taken` is the share of simulated steps, where there were any."""

    number: int
    when: tuple[str, ...]
    boundaries: tuple[tuple[str, str], ...]
    never: str
    law: Law
    settling: Settling | None
    taken: float | None = None


@dataclass(frozen=True)
class Choice:
    """One value of a discrete action, and the branches that take it."""

    value: int
    meaning: str
    branches: tuple[int, ...]
    when: str


@dataclass(frozen=True)
class ActionReading:
    """`domain` as program text. `choices`: of a discrete action. `previous`: what the action makes
    of actions before it (rate limits, hysteresis). `switches`: changes of branch a second (a step
    without a sample time), where there was a simulation. `notes`: a switching line's sliding motion
    and limit cycle, where a plant is known."""

    name: str
    domain: str
    discrete: bool
    safe: float
    branches: tuple[Branch, ...]
    choices: tuple[Choice, ...]
    previous: tuple[str, ...]
    switches: float | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class SensorUse:
    """`readings`: which are used, 0 being the newest (nothing: the sensor is idle). `guards` and
    `laws`: the actions whose conditions, and whose values, it is in. `missing`: in words."""

    name: str
    lower: float
    upper: float
    index: int
    readings: tuple[int, ...]
    guards: tuple[str, ...]
    laws: tuple[str, ...]
    missing: str


@dataclass(frozen=True)
class Simulated:
    """What shares of steps are from."""

    environment: str
    episodes: int
    first_seed: int
    steps: int
    seconds: float | None


@dataclass(frozen=True)
class ProgramReading:
    """All of it. `plant` names the plant of loop figures ("": none). `warm_up` says what the
    program sees before its windows are full."""

    program: str
    environment: str
    size: int
    window: int
    needed: int
    latency: int
    sample_time: float | None
    warm_up: str
    sensors: tuple[SensorUse, ...]
    actions: tuple[ActionReading, ...]
    plant: str
    simulated: Simulated | None
    notes: tuple[str, ...]


Meanings = Mapping[int, str]
