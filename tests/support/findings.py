"""Findings with something of everything in them, for tests of what shows findings."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction

from pirlc.analyze.findings import (
    Analysis,
    Check,
    Crossover,
    Filter,
    FrequencyResponse,
    Leaf,
    LimitCycle,
    LoopFinding,
    Margins,
    Origin,
    PidForm,
    Plant,
    Pole,
    Recall,
    RelayFinding,
    ResponseFinding,
    StepResponse,
    SwitchingFinding,
)
from pirlc.ir.evidence import PROVED, REFUTED, Evidence, Kind, tested, unknown
from pirlc.verify.findings import (
    ActionBounds,
    ChoiceBounds,
    Difference,
    EmittedFinding,
    Extreme,
    GuardRounding,
    History,
    Matter,
    Obligation,
    PropertyFinding,
    Remark,
    Replay,
    Step,
    Verification,
)

LINEARISED = Evidence(Kind.LINEARISED)


def replay(*sensors: str) -> Replay:
    readings = {name: tuple(math.sin(i + k) for i in range(7)) for k, name in enumerate(sensors)}
    steps = tuple(
        Step({"Torque": 54.0 - 3.7 * i, "Push": 1.0}, {"Torque": 2.0, "Push": 1.0})
        for i in range(3)
    )
    return Replay(History(readings, {"Torque": 0.0, "Push": 1.0}), steps)


def extreme(value: Fraction | None, *, attained: bool = True) -> Extreme:
    return Extreme(value, attained, PROVED if value is not None else unknown("no bound in 10 s"))


def verification(name: str = "pole", sensors: tuple[str, ...] = ("Angle", "Speed")) -> Verification:
    """One of each kind of evidence, of bounds and of remarks."""
    one = extreme(Fraction(5453, 100))
    violated = replay(*sensors)
    properties = (
        PropertyFinding(
            "bounded", "property bounded = raw(Torque) < 60", 1, PROVED, PROVED, PROVED, 0.034
        ),
        PropertyFinding(
            "smooth",
            "property smooth over 7 =\n    abs(diff(Torque)) < 0.5",
            7,
            REFUTED,
            REFUTED,
            unknown("within rounding of the bound"),
            0.412,
            violated,
            (
                Obligation("while windows fill", tested(10_000)),
                Obligation("with a missing reading", REFUTED, violated),
            ),
        ),
        PropertyFinding(
            "hard", "property hard = exp(Speed) < 3", 1, unknown("time limit of 10 s"),
            unknown("time limit of 10 s"), tested(1_000_000, "binary32"), 10.0,
        ),
    )  # fmt: skip
    bounds = (
        ActionBounds(
            "Torque", extreme(Fraction(-1, 3)), one, extreme(None), extreme(Fraction(-2)),
            extreme(Fraction(2)), extreme(Fraction(4), attained=False), 1.25e-15, None,
        ),
        ChoiceBounds("Push", (0, 1), (2,), PROVED),
    )  # fmt: skip
    remarks = (
        Remark(Matter.DIVISION, "No division can be by zero.", PROVED, True),
        Remark(Matter.JUMP, "Torque jumps where the guard switches.", PROVED, False, size=one),
        Remark(Matter.NO_EFFECT, "The parameter k2 changes nothing.", tested(5_000), False),
    )
    return Verification(
        name,
        properties,
        bounds,
        remarks,
        (GuardRounding("k * peek(Angle, -1) > 0", 2.3e-16, 1.1e-7),
         GuardRounding("peek(Speed, -1) > 3", None, None)),
        (
            EmittedFinding("double", PROVED, 0.021, ("status", "Torque", "state")),
            EmittedFinding("float", REFUTED, 0.019, ("status",),
                           (Difference("Torque", "(x[0] + 1)", "(x[1] + 1)"),)),
        ),
    )  # fmt: skip


def margins() -> Margins:
    return Margins(
        math.inf, None, 0.31, 12.5, 47.25, 3.1, 5.4, 0.108, 0.84, (0.41, 2.4), 45.6, 3.3, 1.71,
        3.9, 1.42, 2.2, (Crossover("gain", 3.1, 47.25), Crossover("phase", 12.5, 0.31)),
    )  # fmt: skip


def analysis(name: str = "pole", sensor: str = "Angle") -> Analysis:
    """One of everything: a PID leaf, a plant, a stable and an unstable loop, a relay, ..."""
    pole = Pole(0.91, 0.05, 0.9114, 4.7, 0.6)
    unstable = Pole(1.02, 0.0, 1.02, 1.0, -1.0)
    pid = PidForm(
        sensor, Fraction(4), Fraction(1, 20), Fraction(25, 2), Fraction(0), 5, Fraction(17, 4),
        1.0, 0.19, "At rest 0.19 of a change of the setpoint remains as error.",
    )  # fmt: skip
    leaf = Leaf(
        "Torque 1", "Torque", (f"peek({sensor}, -1) > 0",), f"4 * peek(0 - {sensor}, -1)",
        (Filter(sensor, (Fraction(-4), Fraction(0))),), (Recall("Torque", Fraction(1, 2)),),
        Fraction(0), (pid,), False, LINEARISED, {sensor: 0.25}, "abs",
        notes=("A note on 1 leaf.",),
    )  # fmt: skip
    other = replace(leaf, name="Torque 2", pids=(), linear=True, active=False, notes=())
    plant = Plant(
        "pendulum at the top", Origin.IDENTIFIED, ((1.0, 0.05), (0.3, 1.0)), ((0.0,), (0.05,)),
        ((1.0, 0.0),), ((0.0,),), ("angle", "speed"), ("Torque",), (sensor,), 0.05,
        {"angle": 0.0}, tested(40, "rollouts"), {sensor: 97.125}, ("ARX of order 2.",),
    )  # fmt: skip
    frequencies = tuple(0.1 * 1.3**i for i in range(24))
    response = FrequencyResponse(
        frequencies,
        tuple(1.0 / (1.0 + w * w) for w in frequencies),
        tuple(-w / (1.0 + w * w) for w in frequencies),
    )
    times = tuple(0.05 * i for i in range(30))
    curve = tuple(1.0 - math.exp(-t) for t in times)
    step = StepResponse(
        f"the setpoint of {sensor}", sensor, times, {sensor: curve}, curve, 1.0, 1.15, 3.2
    )
    check = Check("gain_up", 2.4375, "eigenvalues", 2.43750001, 1e-8, 1e-6)
    loops = (
        LoopFinding("Torque", "Torque 1", {}, 0, (pole,), (pole,), True, margins(), response,
                    step, (check,), LINEARISED),
        LoopFinding("Torque", "Torque 2", {"Push": ""}, 1, (unstable,), (pole,), False, None,
                    response, None, (), LINEARISED, ("It has a pole outside the circle.",)),
    )  # fmt: skip
    relay = RelayFinding(
        "Push", f"peek({sensor}, -1) > 0", 0.0, 1.0, (Filter(sensor, (Fraction(1),)),),
        Fraction(0), (pole,), True, (LimitCycle(6.2, 20.5, 0.031, True),), LINEARISED,
        ("Describing functions are approximate.",),
    )  # fmt: skip
    switching = (
        SwitchingFinding(("Torque 1", "Torque 2"), ("angle", "speed"),
                         ((Fraction(2), Fraction(0)), (Fraction(0), Fraction(1))),
                         Fraction(19, 20), PROVED),
        SwitchingFinding(("Torque 1", "Torque 4"), ("angle",), None, Fraction(99, 100), PROVED,
                         pieces={"Torque 1": ((Fraction(1, 3),),)}),
        SwitchingFinding(("Torque 3",), (), None, None, unknown("no such function found"),
                         ("a quadratic function", "one with 12 terms")),
    )  # fmt: skip
    responses = (
        ResponseFinding("Torque", "Torque 1", f"the setpoint of {sensor}", times,
                        {sensor: curve}, {sensor: curve}, {sensor: 0.031}, tested(1, "step"),
                        fit={sensor: 96.5}),
    )  # fmt: skip
    return Analysis(
        name, 0.05, 0, (leaf, other), plant, loops, (relay,), switching, responses, ("In 1 plane.",)
    )
