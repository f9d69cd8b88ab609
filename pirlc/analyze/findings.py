"""What analysis finds: plain values, for the command line, the report and their JSON.

Signs and times: a program's readings y(k) are taken before its action u(k), so a plant is
x(k+1) = A x(k) + B u(k), y(k) = C x(k) + D u(k), with D zero wherever it was found here. All are
deviations from the plant's operating point. A leaf is u(k) = sum of c[s][j] y_s(k - latency - j).
The loop of an action is L(z) = -(leaf)(plant): the characteristic equation is 1 + L(z) = 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from fractions import Fraction

from pirlc.ir.evidence import Evidence

Matrix = tuple[tuple[float, ...], ...]
"""Rows."""


# Leaves


@dataclass(frozen=True)
class Filter:
    """A finite impulse response: `coefficients[j]` weighs the reading j steps older than the newest
    that the program sees."""

    sensor: str
    coefficients: tuple[Fraction, ...]

    @property
    def dc_gain(self) -> Fraction:
        return sum(self.coefficients, Fraction(0))


@dataclass(frozen=True)
class Recall:
    """What a leaf adds of `previous(action)`: its own makes the leaf recursive."""

    action: str
    coefficient: Fraction


@dataclass(frozen=True)
class PidForm:
    """kp e(k) + ki (e(k) + ... + e(k - n + 1)) + kd (e(k) - e(k - 1)), e = setpoint - reading.

    The integral is a sum over `window` = n readings only, so the gain at rest is the finite
    `dc_gain` = kp + n ki. `setpoint` is None where the offset does not tell it (no gain at rest, or
    another sensor in the leaf). `error_share` is what remains at rest of a setpoint change, as a
    share of it, with a plant whose gain at rest is `plant_gain` (1 where no plant is given; None:
    unknown); `steady_state` says it in words.
    """

    sensor: str
    kp: Fraction
    ki: Fraction
    kd: Fraction
    setpoint: Fraction | None
    window: int
    dc_gain: Fraction
    plant_gain: float | None
    error_share: float | None
    steady_state: str


@dataclass(frozen=True)
class Leaf:
    """What an action is on one path through its `if`s, as an affine law.

    `name` is unique in the program ("Steer 2"); `path` are the conditions that lead here, in the
    order in which they are met, as program text. `linear` where the law is exact, else it is the
    tangent at `operating` (sensor -> reading), and `remainder` names what was linearised.
    `active`: whether the path is the one taken at the operating point. Without a tangent (a square
    root of 0, ...) `evidence` is unknown and there are no filters.
    """

    name: str
    action: str
    path: tuple[str, ...]
    text: str
    filters: tuple[Filter, ...]
    recalls: tuple[Recall, ...]
    offset: Fraction
    pids: tuple[PidForm, ...]
    linear: bool
    evidence: Evidence
    operating: Mapping[str, float] = field(default_factory=dict)
    remainder: str = ""
    active: bool = True
    notes: tuple[str, ...] = ()


# Plants

WEAK = 50.0
"""Percent: an identified model that explains less of a reading's variation in free runs says little
about the plant itself."""


class Origin(Enum):
    EQUATIONS = "linearised equations"
    SIMULATOR = "differences in the simulator"
    IDENTIFIED = "identified from rollouts"
    GIVEN = "given in a file"


@dataclass(frozen=True)
class Plant:
    """A discrete state space at the sample time (seconds, None: unknown; then times are in steps).

    `inputs` are actions, `outputs` sensors, in the order of the columns of `b` and the rows of
    `c`. `operating` holds the state's names, the actions and the sensors at the operating point.
    `fit` is the share of each output's variation that the model explains on rollouts it was not
    made from, in percent (`identified` only).
    """

    name: str
    origin: Origin
    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    sample_time: float | None
    operating: Mapping[str, float]
    evidence: Evidence
    fit: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


# Loops


@dataclass(frozen=True)
class Pole:
    """An eigenvalue z = real + i imaginary; `frequency` (rad/s, or rad/step) and `damping` are
    those of the continuous pole log(z)/T (None at z = 0)."""

    real: float
    imaginary: float
    magnitude: float
    frequency: float | None
    damping: float | None


@dataclass(frozen=True)
class Crossover:
    """`kind` is "gain" where |L| = 1: `margin` is then the phase margin in degrees; or "phase"
    where L is real and negative: `margin` is then the factor of gain that brings L to -1.
    `frequency` is in rad/s (rad/step without a sample time)."""

    kind: str
    frequency: float
    margin: float


@dataclass(frozen=True)
class Margins:
    """How far the loop is from instability; only of stable loops.

    `gain_up` >= 1 and `gain_down` <= 1 are the factors of gain at which it becomes unstable (inf
    and 0: at none); `phase` in degrees (inf: no gain crossover); `delay_samples` is the further
    delay, in samples, not whole; `delay_seconds` the same in seconds (None without a sample time).
    `disk` is the symmetric disk margin alpha (skew 0): all gain factors between the two
    of `disk_gain` and all phases up to `disk_phase` degrees, together along the disk's rim, are
    tolerated. `sensitivity_peak` is max |1/(1+L)|, `complementary_peak` max |L/(1+L)|; frequencies
    in rad/s (rad/step without a sample time), None where there is none.
    """

    gain_up: float
    gain_up_frequency: float | None
    gain_down: float
    gain_down_frequency: float | None
    phase: float
    phase_frequency: float | None
    delay_samples: float
    delay_seconds: float | None
    disk: float
    disk_gain: tuple[float, float]
    disk_phase: float
    disk_frequency: float
    sensitivity_peak: float
    sensitivity_frequency: float
    complementary_peak: float
    complementary_frequency: float
    crossovers: tuple[Crossover, ...]


@dataclass(frozen=True)
class Check:
    """A figure found in two ways that share no formula; they agree to `tolerance`."""

    figure: str
    value: float
    by: str
    again: float
    difference: float
    tolerance: float


@dataclass(frozen=True)
class FrequencyResponse:
    """Samples of L on the upper half of the unit circle; `frequencies` in rad/s (rad/step without a
    sample time), ascending up to the Nyquist frequency."""

    frequencies: tuple[float, ...]
    real: tuple[float, ...]
    imaginary: tuple[float, ...]


@dataclass(frozen=True)
class StepResponse:
    """After a step of `what` ("the setpoint of rpm", "a disturbance at Steer") at time 0.

    Deviations from rest: of each output and of the action itself, at `times` (seconds, or steps).
    Figures of `sensor`'s response (None where they do not exist): its final value, the time until
    it stays within 2 % of it, the overshoot in percent.
    """

    what: str
    sensor: str
    times: tuple[float, ...]
    outputs: Mapping[str, tuple[float, ...]]
    action: tuple[float, ...]
    final: float | None
    settling_time: float | None
    overshoot: float | None


@dataclass(frozen=True)
class LoopFinding:
    """The loop broken at `action` with one leaf in it. `others` says what the other actions do
    meanwhile, by action: the name of the leaf that stays closed, or "" for held."""

    action: str
    leaf: str
    others: Mapping[str, str]
    latency: int
    poles: tuple[Pole, ...]
    open_poles: tuple[Pole, ...]
    stable: bool
    margins: Margins | None
    response: FrequencyResponse
    step: StepResponse | None
    checks: tuple[Check, ...]
    evidence: Evidence
    notes: tuple[str, ...] = ()


# Actions that switch between values


@dataclass(frozen=True)
class LimitCycle:
    """What the describing function of a relay predicts. `amplitude` is of the switching function;
    `frequency` in rad/s (rad/step), `period` in steps."""

    frequency: float
    period: float
    amplitude: float
    stable: bool


@dataclass(frozen=True)
class RelayFinding:
    """A discrete action as a relay: `high` where `text` (s > 0) holds, `low` elsewhere; s is the
    sum of `filters` on the readings, plus `offset`.

    `sliding_poles` are those of the plant held on s = 0 by the equivalent control (empty without a
    plant, None where s is not reached in one step: `notes` says so).
    """

    action: str
    text: str
    low: float
    high: float
    filters: tuple[Filter, ...]
    offset: Fraction
    sliding_poles: tuple[Pole, ...] | None
    sliding_stable: bool | None
    cycles: tuple[LimitCycle, ...]
    evidence: Evidence
    notes: tuple[str, ...] = ()


# Switching and simulation


@dataclass(frozen=True)
class SwitchingFinding:
    """Whether leaves may alternate in any order: V = z' P z falls along every closed loop.

    `modes` are the names of the leaves (several actions joined by " + "), `lyapunov` is P, exact,
    where one was found and confirmed in exact rationals; `tried` says what was tried, in order.
    `decay` (below 1): V(k+1) < decay V(k). `pieces`, where no one P serves: one for each mode,
    or for each few modes in turn, exact too; V is then that of the modes in force and to come.
    """

    modes: tuple[str, ...]
    states: tuple[str, ...]
    lyapunov: tuple[tuple[Fraction, ...], ...] | None
    decay: Fraction | None
    evidence: Evidence
    tried: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    pieces: Mapping[str, tuple[tuple[Fraction, ...], ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class ResponseFinding:
    """A step of a setpoint in the simulator, beside what the linear loop predicts.

    Deviations from the operating point at `times` (seconds, or steps); `error` is, by output, the
    largest difference as a share of the largest predicted deviation; `fit`, in percent, is
    100 (1 - |simulated - predicted| / |simulated|), Euclidean norms over the times.
    """

    action: str
    leaf: str
    what: str
    times: tuple[float, ...]
    predicted: Mapping[str, tuple[float, ...]]
    simulated: Mapping[str, tuple[float, ...]]
    error: Mapping[str, float]
    evidence: Evidence
    notes: tuple[str, ...] = ()
    fit: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Analysis:
    """Everything `pirlc analyze` can tell about a program."""

    program: str
    sample_time: float | None
    latency: int
    leaves: tuple[Leaf, ...]
    plant: Plant | None = None
    loops: tuple[LoopFinding, ...] = ()
    relays: tuple[RelayFinding, ...] = ()
    switching: tuple[SwitchingFinding, ...] = ()
    responses: tuple[ResponseFinding, ...] = ()
    notes: tuple[str, ...] = ()
