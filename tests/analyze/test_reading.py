"""Reading programs: branches, regions, gains, limits, in the structure and in the words."""

from __future__ import annotations

from pathlib import Path

import pytest

from pirlc.analyze.analysis import analyze
from pirlc.analyze.reading.findings import Branch, Kind, ProgramReading
from pirlc.analyze.reading.known import known_plant
from pirlc.analyze.reading.program import read_program
from pirlc.frontend import parse_sketch
from pirlc.ir.expansion import close
from pirlc.ir.policy import Program
from pirlc.source import SourceText
from tests.support.command_line import ROOT

EXAMPLES = ROOT / "examples"
CLOSED = sorted(
    path
    for pattern in ("*/*-0.pirl", "torcs/printed/*.pirl", "torcs/synthesised/*.pirl")
    for path in EXAMPLES.glob(pattern)
)

HEAD = """policy p
environment "{environment}"
sensor X : [-1, 1] = 0
sensor Y : [0, 4]  = 1
window {window}
"""


def closed(text: str) -> Program:
    program = close(parse_sketch(SourceText("p.pirl", text)))
    assert program is not None
    return program


def example(name: str) -> Program:
    return closed((EXAMPLES / name).read_text(encoding="utf-8"))


def reading(program: Program) -> ProgramReading:
    return read_program(program, analyze(program))


def law(text: str, window: int = 1, action: str = "action A : [-1, 1] safe 0") -> Branch:
    """The only branch of a program of one action."""
    (found,) = branches(text, window, action)
    return found


def branches(
    text: str, window: int = 1, action: str = "action A : [-1, 1] safe 0"
) -> tuple[Branch, ...]:
    head = HEAD.format(environment="Hardware-v0", window=window)
    (found,) = reading(closed(f"{head}{action} = {text}\n")).actions
    return found.branches


# Every example


def test_there_are_programs_of_every_example() -> None:
    assert len(CLOSED) >= 20


@pytest.mark.parametrize("path", CLOSED, ids=lambda path: path.stem)
def test_every_example_can_be_read(path: Path) -> None:
    program = closed(path.read_text(encoding="utf-8"))
    found = reading(program)
    assert [action.name for action in found.actions] == [a.name for a in program.interface.actions]
    for action in found.actions:
        assert [b.number for b in action.branches] == list(range(1, len(action.branches) + 1))
        assert any(not branch.never for branch in action.branches)
        for branch in action.branches:
            assert branch.never == "" or branch.when == ()
            if branch.law.kind is Kind.CONSTANT:
                assert branch.law.value is not None and not branch.law.gains
            else:
                assert branch.law.gains
                low, high = branch.law.range
                assert low < high
    assert found.needed <= found.window
    assert found.notes == ()


def test_a_pid_as_printed_in_the_paper() -> None:
    steer, accel = reading(example("torcs/printed/aalborg.pirl")).actions
    (only,) = steer.branches
    assert (only.when, only.law.kind, only.law.setpoint) == ((), Kind.PID, 0.0)
    (gain,) = only.law.gains
    assert (gain.kp, gain.ki, gain.kd, gain.window) == (0.97, 0.05, 49.98, 5)
    assert gain.at_rest == pytest.approx(0.97 + 5 * 0.05)
    assert only.law.range == pytest.approx((-101.08, 101.08))
    proportional, integral, change = only.law.limits
    assert proportional.upper == pytest.approx(1 / 0.97) and not proportional.reachable
    assert integral.upper == pytest.approx(1 / (5 * 0.05)) and not integral.reachable
    assert change.upper == pytest.approx(1 / 49.98) and change.reachable
    near, far = accel.branches
    assert near.when == ("-0.001 < trackPos < 0.001",)
    assert far.when == ("trackPos >= 0.001 or trackPos <= -0.001",)
    assert (near.law.setpoint, far.law.setpoint) == (0.44, 0.4)
    assert near.law.limits[0].lower is None  # 0 is the lower limit already
    assert near.settling is not None
    assert (near.settling.memory, near.settling.seconds) == (5, pytest.approx(0.1))
    assert near.settling.why == "no plant is known here"


def test_a_branch_that_no_reading_reaches() -> None:
    *_, accel = reading(example("torcs/synthesised/paper-aalborg-0.pirl")).actions
    assert [branch.when for branch in accel.branches] == [
        ("TrackPos > -0.333333",), (), ("TrackPos <= -0.333333",)
    ]  # fmt: skip
    assert accel.branches[1].never == (
        "TrackPos <= -0.333333 and TrackPos > -0.1 exclude each other"
    )


def test_a_setpoint_that_moves_and_a_law_the_other_way_round() -> None:
    steer, accel, brake = reading(example("torcs/synthesised/racer-aalborg-1.pirl")).actions
    swerve, straight = steer.branches
    assert swerve.when == ("0.47 < Speed < 0.53", "Ahead > 0.4", "-0.3 < TrackPos < 0.3")
    assert straight.law.text == (
        "0.4 Angle + 1.5 TrackPos + 5 (Left12 - Right12) + 5.8 (Left19 - Right19)"
        " + 2.6 (Left45 - Right45) - 0.3 Drift"
    )
    assert straight.law.kind is Kind.FEEDBACK
    (gas,) = accel.branches
    assert gas.law.kind is Kind.GENERAL and gas.law.setpoint is None
    assert gas.law.setpoint_text == "sqrt(max(0, 0.73 max(Ahead, Left4, Right4) + 0.01))"
    assert gas.law.gains[0].kp == 13.0
    (hold,) = brake.branches
    assert hold.law.gains[0].kp == -23.0
    assert hold.law.setpoint_text.endswith("+ 0.01)) - 0.02")


def test_a_decision_and_its_boundary() -> None:
    (push,) = reading(example("cartpole/cartpole-0.pirl")).actions
    assert [(c.value, c.meaning, c.when) for c in push.choices] == [
        (0, "push left", "otherwise"),
        (1, "push right", "70 Angle + 10 AngularVelocity > 0"),
    ]
    assert push.branches[0].boundaries == (
        ("70 Angle + 10 AngularVelocity > 0", "AngularVelocity > -7 Angle"),
    )


def test_conditions_with_and_and_or() -> None:
    (push,) = reading(example("mountain_car/mountain_car-0.pirl")).actions
    assert push.choices[1].when == (
        "27 Position + 48 Velocity > -8.5 or (-1.55 Position + 89 Velocity > 0.72"
        " and -13.4 Position + 15 Velocity > 5.9)"
    )
    assert [solved for _, solved in push.branches[0].boundaries] == [
        "Velocity > -0.5625 Position - 0.177083",
        "Velocity > 0.0174157 Position + 0.00808989",
        "Velocity > 0.893333 Position + 0.393333",
    ]


def test_sensors_that_are_used_and_that_are_idle() -> None:
    found = reading(example("cartpole/cartpole-0.pirl"))
    assert [(s.name, s.readings, s.guards) for s in found.sensors] == [
        ("Position", (), ()),
        ("Velocity", (), ()),
        ("Angle", (0,), ("Push",)),
        ("AngularVelocity", (0,), ("Push",)),
    ]
    assert (found.window, found.needed, found.sample_time) == (5, 1, 0.02)


def test_how_loops_settle_with_a_plant() -> None:
    program = example("pendulum/pendulum-0.pirl")
    found = read_program(program, analyze(program, known_plant(program)))
    assert found.plant == "Pendulum-v1 (upright)"
    ((balance, swing),) = [action.branches for action in found.actions]
    assert balance.settling is not None and swing.settling is not None
    assert balance.settling.stable and not swing.settling.stable
    assert balance.settling.slowest_pole == pytest.approx(0.79, abs=0.01)
    assert balance.settling.settling_time == pytest.approx(0.9, abs=0.06)
    assert balance.settling.gain_margin == pytest.approx(2.4, abs=0.01)
    assert swing.settling.slowest_pole is not None and swing.settling.slowest_pole > 1.0


def test_a_switching_line_in_the_plant() -> None:
    program = example("cartpole/cartpole-0.pirl")
    (push,) = read_program(program, analyze(program, known_plant(program))).actions
    assert push.notes == (
        "held on the line 70 Angle + 10 AngularVelocity = 0, the linearised plant: it does not "
        "come to rest along it (a pole of magnitude 1): what the line leaves out drifts",
        "around the line 70 Angle + 10 AngularVelocity = 0 the linearised plant has a limit cycle "
        "of 2 steps (0.04 s)",
    )


def test_an_environment_whose_plant_is_not_known() -> None:
    assert known_plant(example("torcs/printed/aalborg.pirl")) is None
    text = HEAD.format(environment="Hardware-v0", window=1).replace(
        'environment "Hardware-v0"\n', ""
    )
    program = closed(f"{text}action A : [-1, 1] = peek(X, -1)\n")
    assert known_plant(program) is None
    assert reading(program).environment == ""


# Laws


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("2 * peek(X, -1) - peek(Y, -1) + 0.5", "2 X - Y + 0.5"),
        ("0.5 - peek(X, -1)", "0.5 - X"),
        ("-(2 * (peek(X, -1) - 3)) / 4", "1.5 - 0.5 X"),
        ("peek(X, -1) - peek(X, -1) + 2", "2"),
        ("peek(X, -1) * peek(Y, -1)", "X * Y"),
        ("peek(X, -1) / (peek(Y, -1) + 1)", "X / (Y + 1)"),
        ("abs(0 - peek(X, -1))", "|X|"),
        ("min(peek(X, -1), min(peek(Y, -1), 2))", "min(X, Y, 2)"),
        ("min(1, 2) * peek(X, -1)", "X"),
        ("let e = 1 - X in peek(e, -1)", "1 - X"),
        ("0.3 * previous(A) + peek(X, -1)", "0.3 previous A + X"),
        ("clip(peek(X, -1), 0 - 1, 1)", "clip(X, -1, 1)"),
    ],
)
def test_laws_as_text(text: str, shown: str) -> None:
    assert law(text).law.text == shown


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("fold(+, X)", "(sum of the last 4 X)"),
        ("2 * peek(X, -1) + 3 * (peek(X, -1) - peek(X, -2))", "2 X + 3 (change of X)"),
        ("peek(X, -1) - 3 * peek(X, -3)", "X - 3 X(k-2)"),
        ("peek(X, -2)", "X(k-1)"),
    ],
)
def test_windows_as_text(text: str, shown: str) -> None:
    assert law(text, window=4).law.text == shown


def test_kinds_of_laws() -> None:
    assert law("0.25").law.kind is Kind.CONSTANT
    assert law("0.25 - peek(X, -1)").law.kind is Kind.PID
    assert law("peek(X, -1) + peek(Y, -1)").law.kind is Kind.FEEDBACK
    assert law("peek(X, -1) * peek(Y, -1)").law.kind is Kind.GENERAL


def test_no_setpoint_where_the_sensor_itself_bends_the_law() -> None:
    assert law("abs(peek(X, -1)) - 2 * peek(X, -1)").law.setpoint_text == ""
    assert law("abs(peek(Y, -1)) - 2 * peek(X, -1)").law.setpoint_text == "0.5 |Y|"


def test_ranges_tell_whether_the_clip_matters() -> None:
    assert law("0.2 * peek(Y, -1)").law.range == pytest.approx((0.0, 0.8))
    assert not law("0.2 * peek(Y, -1)").law.clipped
    assert law("0.3 * peek(Y, -1)").law.clipped
    assert law("peek(X, -1) * peek(Y, -1)").law.range == (-4.0, 4.0)
    assert law("sqrt(peek(Y, -1))").law.range == (0.0, 2.0)
    assert law("max(peek(X, -1), 0.5) - tanh(0)").law.range == (0.5, 1.0)


def test_an_integrator_through_the_last_action() -> None:
    found = law("previous(A) + 0.1 * (0.5 - peek(X, -1))")
    assert found.law.notes == (
        "adds to the last A (velocity form): an integrator; what is added to is the clipped value, "
        "so it does not wind up",
    )
    assert found.law.at_rest == (
        "it adds to its own last value: true integral action, no error remains at rest"
    )
    assert found.settling is not None and found.settling.kept == 1.0


def test_a_lag_through_the_last_action() -> None:
    found = law("0.9 * previous(A) + 0.1 * peek(X, -1)")
    assert found.law.notes == ("keeps 0.9 of the last A: a lag of 9.49 steps",)


def test_rate_limits_and_hysteresis() -> None:
    head = HEAD.format(environment="Hardware-v0", window=1)
    limited = reading(
        closed(
            f"{head}action A : [-1, 1] safe 0 = "
            "clip(peek(X, -1), previous(A) - 0.1, previous(A) + 0.2)\n"
        )
    )
    assert limited.actions[0].previous == (
        "rate limit: changes by -0.1 to 0.2 of the last A in a step",
    )
    slow = closed(f"{head}action A : [-1, 1] safe 0 = min(peek(X, -1), previous(A) + 0.2)\n")
    assert reading(slow).actions[0].previous == (
        "rate limit: rises by at most 0.2 from the last A",
    )
    relay = closed(
        f"{head}action A : {{0, 1}} = if peek(X, -1) > 0.1 or previous(A) == 1 and "
        "peek(X, -1) > 0 then 1 else 0\n"
    )
    (found,) = reading(relay).actions
    assert found.previous == (
        "hysteresis: its own last value decides with the readings on branches 1, 2",
    )
    assert found.choices[1].when == "X > 0.1 or (previous A = 1 and X > 0)"


# Regions


@pytest.mark.parametrize(
    ("condition", "yes", "no"),
    [
        ("peek(X, -1) > 0.5", ("X > 0.5",), ("X <= 0.5",)),
        ("0 - 2 * peek(X, -1) >= 1", ("X <= -0.5",), ("X > -0.5",)),
        ("abs(peek(X, -1) - 0.5) < 0.2", ("0.3 < X < 0.7",), ("|X - 0.5| >= 0.2",)),
        ("not (peek(X, -1) < 0)", ("X >= 0",), ("X < 0",)),
        (
            "peek(X, -1) > 0 and peek(Y, -1) < 1",
            ("X > 0", "Y < 1"),
            ("X <= 0 or Y >= 1",),
        ),
        ("peek(X, -1) > 0 implies peek(Y, -1) < 1", ("X <= 0 or Y < 1",), ("X > 0", "Y >= 1")),
        ("peek(X, -1) > peek(Y, -1)", ("X - Y > 0",), ("X - Y <= 0",)),
        # What readings in their ranges always satisfy is left out.
        ("peek(X, -1) > 0 and peek(Y, -1) >= 0", ("X > 0",), ("X <= 0",)),
        ("peek(X, -1) > 0 or peek(Y, -1) > 5", ("X > 0",), ("X <= 0",)),
    ],
)
def test_regions(condition: str, yes: tuple[str, ...], no: tuple[str, ...]) -> None:
    first, second = branches(f"if {condition} then 1 else 0")
    assert (first.when, second.when) == (yes, no)
    assert first.never == second.never == ""


@pytest.mark.parametrize(
    ("condition", "why"),
    [
        ("peek(X, -1) > 1", "X > 1 is outside the range [-1, 1]"),
        ("peek(X, -1) > 0.5 and peek(X, -1) < 0.25", "X > 0.5 and X < 0.25 exclude each other"),
        ("peek(X, -1) - peek(Y, -1) > 1", "X - Y > 1 cannot be"),
        (
            "peek(X, -1) < 0 and peek(X, -1) - peek(Y, -1) > 0",
            "X - Y > 0 cannot be where X < 0",
        ),
    ],
)
def test_regions_that_no_reading_is_in(condition: str, why: str) -> None:
    first, second = branches(f"if {condition} then 1 else 0")
    assert (first.when, first.never) == ((), why)
    assert second.never == ""


def test_nested_conditions_become_one_interval() -> None:
    text = "if peek(X, -1) > 0 then (if peek(X, -1) < 0.5 then 1 else 0.5) else 0"
    assert [branch.when for branch in branches(text)] == [
        ("0 < X < 0.5",), ("X >= 0.5",), ("X <= 0",)
    ]  # fmt: skip
