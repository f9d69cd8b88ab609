"""What emitted controllers promise, with the answers worked out by hand."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest

from pirlc.backend.policies import python_controller
from pirlc.diagnostics import PirlcError
from tests.backend.helpers import COMPILERS, FORMS, Run, compiled, program_of

NAN, INF = math.nan, math.inf

MISSING, OUT_OF_RANGE, SAFE_USED = 1, 2, 4


@pytest.fixture(params=FORMS)
def start(request, tmp_path):
    """Makes a run of a program's text in one form."""
    return lambda text, real="double": Run(program_of(text), request.param, real, tmp_path)


def trace(run: Run, readings: Sequence[float]) -> list[tuple[float, int]]:
    """First action and status for a series of readings of one sensor."""
    answers = [run.step([reading]) for reading in readings]
    return [(actions[0], status) for actions, status, _ in answers]


def policy(sensor: str = "", action: str = "peek(x, -1)", **settings: object) -> str:
    """A policy of one sensor and one action, in a range far wider than the sensor's."""
    lines = [f"{key} {value}" for key, value in settings.items()]
    return "\n".join(
        [
            "policy small",
            f"sensor x : [0, 10] = 0 {sensor}",
            *lines,
            f"action u : [-1000, 1000] safe -7 = {action}",
        ]
    )


def test_missing_hold_keeps_the_last_good_reading(start):
    run = start(policy())
    assert trace(run, [3.0, NAN, INF, 4.0, -INF]) == [(3, 0), (3, 1), (3, 1), (4, 0), (4, 1)]


def test_missing_hold_before_any_reading_is_the_middle_of_the_range(start):
    assert trace(start(policy()), [NAN, 2.0]) == [(5, 1), (2, 0)]
    assert trace(start(policy(fill="zero")), [NAN, 2.0]) == [(0, 1), (2, 0)]


def test_missing_zero(start):
    run = start(policy("missing zero"))
    assert trace(run, [NAN, 3.0, NAN, 4.0]) == [(5, 1), (3, 0), (0, 1), (4, 0)]
    run = start(policy("missing zero", fill="zero"))
    assert trace(run, [NAN, 3.0, NAN, 4.0]) == [(0, 1), (3, 0), (0, 1), (4, 0)]


def test_missing_fail_takes_the_safe_value_at_once_and_recovers(start):
    run = start(policy("missing fail", "fold(+, x)", window=2))
    safe = MISSING | SAFE_USED
    assert trace(run, [NAN, 3.0, NAN, 4.0]) == [(-7, safe), (6, 0), (-7, safe), (7, 0)]


def test_missing_hold_then_fail_counts_missing_readings_in_a_row(start):
    run = start(policy("missing hold 2 then fail"))
    safe = (-7, MISSING | SAFE_USED)
    found = trace(run, [1.0, NAN, NAN, NAN, NAN, 2.0, NAN, 20.0, NAN, NAN, NAN])
    held, far = (1, MISSING), (20, MISSING)
    assert found == [(1, 0), held, held, safe, safe, (2, 0), (2, 1), (20, 2), far, far, safe]


def test_every_action_takes_its_safe_value_where_any_sensor_fails(start):
    run = start(
        """
        policy two
        sensor a : [0, 1] = 0
        sensor b : [0, 1] = 1 missing fail
        action u : [0, 1] safe 0.25 = peek(a, -1)
        action v : {3, 4} safe 4 = 3
        """
    )
    assert run.step([0.5, 0.5]) == ((0.5, 3), 0, (0, 0))
    assert run.step([0.5, NAN]) == ((0.25, 4), MISSING | SAFE_USED, (0, MISSING))


def test_the_first_good_reading_fills_the_window(start):
    run = start(policy(action="fold(+, x)", window=3))
    assert trace(run, [NAN, 2.0, 3.0, 4.0, 5.0]) == [(15, 1), (6, 0), (7, 0), (9, 0), (12, 0)]
    run = start(policy(action="fold(+, x)", window=3, fill="zero"))
    assert trace(run, [NAN, 2.0, 3.0, 4.0, 5.0]) == [(0, 1), (2, 0), (5, 0), (9, 0), (12, 0)]


def test_latency_delays_what_the_program_sees_and_not_the_judgement(start):
    run = start(policy(latency=2))
    assert trace(run, [1.0, 2.0, NAN, 30.0, 5.0]) == [(1, 0), (1, 0), (1, 1), (2, 2), (2, 0)]
    run = start(policy("missing fail", latency=1))
    assert trace(run, [1.0, NAN, 2.0]) == [(1, 0), (-7, 5), (1, 0)]


def test_status_names_each_sensor_and_lasts_one_step(start):
    run = start(
        """
        policy flags
        sensor a : [0, 1] = 1
        sensor b : [-1, 1] = 0
        action u : [0, 1] = peek(a, -1)
        """
    )
    assert run.step([2.0, NAN])[1:] == (3, (MISSING, OUT_OF_RANGE))
    assert run.step([-1.0, 1.0])[1:] == (0, (0, 0))


def test_ranges_are_widened_to_binary32(start):
    text = policy().replace("[0, 10]", "[0.1, 0.7]")
    low, high = 0.09999999403953552, 0.7000000476837158
    readings = [low, high, math.nextafter(low, 0), math.nextafter(high, 1)]
    assert [status for _, status in trace(start(text), readings)] == [0, 0, 2, 2]


def test_previous_is_the_applied_action_of_the_step_before(start):
    run = start(
        """
        policy integrator
        sensor x : [-10, 10] = 0
        action u : [-3, 5] safe 1 = previous(u) + peek(x, -1)
        action v : [-100, 100] safe 7 = previous(u) * 10 + previous(v)
        """
    )
    answers = [run.step([x])[0] for x in (2.0, 9.0, 0.0, -50.0)]
    assert answers == [(3.0, 17.0), (5.0, 47.0), (5.0, 97.0), (-3.0, 100.0)]
    run.reset()
    assert run.step([2.0])[0] == (3.0, 17.0)


def test_results_are_clipped_and_nan_takes_the_safe_value(start):
    run = start(
        """
        policy quotient
        sensor a : [-1, 1] = 0
        sensor b : [-1, 1] = 1
        action u : [-2, 3] safe 0.5 = peek(a, -1) / peek(b, -1)
        """
    )
    for a, b, action, status in [
        (1.0, 0.0, 3.0, 0),
        (-1.0, 0.0, -2.0, 0),
        (1.0, -0.0, -2.0, 0),
        (0.0, 0.0, 0.5, SAFE_USED),
        (1.0, 0.5, 2.0, 0),
        (1.0, -1e-9, -2.0, 0),
    ]:
        assert run.step((a, b))[:2] == ((action,), status), (a, b)


def test_binary32_rounds_every_operation(start):
    text = policy(action="peek(x, -1) * 0.1 + 1")
    assert trace(start(text), [0.1]) == [(1.01, 0)]
    assert trace(start(text, "float"), [0.1]) == [(1.0099999904632568, 0)]


def test_a_reading_that_overflows_binary32_is_missing_there(start):
    assert trace(start(policy()), [1.0, 1e39]) == [(1, 0), (1000, OUT_OF_RANGE)]
    assert trace(start(policy(), "float"), [1.0, 1e39]) == [(1, 0), (1, MISSING)]


PARAMETERS = """
    policy tuned
    sensor x : [-10, 10] = 0
    window 2
    param gain = 2
    param bias = 0.5
    action u : [-100, 100] = gain * fold(+, x) + bias
"""


def test_parameters_of_emitted_python():
    made = python_controller(program_of(PARAMETERS))
    assert made.names == ("gain", "bias")
    default, other = made(), made.with_params({"gain": -1.0})
    assert [p.act([1.0]) for p in (default, other, default)] == [(4.5,), (-1.5,), (4.5,)]
    assert [p.act([3.0]) for p in (default, other)] == [(8.5,), (-3.5,)]
    both = made.with_params({"bias": -0.25, "gain": 3.0})
    assert [p.act([1.0]) for p in (made.with_params({"bias": 1.0}), both)] == [(5.0,), (5.75,)]
    with pytest.raises(ValueError, match="no parameter 'gian'"):
        made.with_params({"gian": 1.0})


@pytest.mark.skipif(not COMPILERS, reason="no gcc and no clang on this machine")
def test_parameters_and_instances_of_emitted_c(tmp_path):
    first = compiled(program_of(PARAMETERS), tmp_path)
    other = first.with_params({"gain": -1.0})
    assert first.params == {"gain": 2.0, "bias": 0.5}
    assert [c.step([1.0])[0] for c in (first, other, first)] == [(4.5,), (-1.5,), (4.5,)]
    assert [c.step([3.0])[0] for c in (first, other)] == [(8.5,), (-3.5,)]
    both = first.with_params({"bias": -0.25, "gain": 3.0})
    assert [c.step([1.0])[0] for c in (first.with_params({"bias": 1.0}), both)] == [(5.0,), (5.75,)]
    first.reset()
    assert first.step([2.0]) == ((8.5,), 0)
    with pytest.raises(PirlcError) as caught:
        first.with_params({"gian": 1.0})
    diagnostic = caught.value.diagnostics[0]
    assert (diagnostic.code, diagnostic.message) == (
        "E0807",
        "the program has no parameter 'gian'",
    )


def test_a_counter_of_missing_readings_never_overflows(start):
    run = start(policy("missing hold 3 then fail"))
    found = trace(run, [1.0] + [NAN] * 1000)
    assert found[4:] == [(-7, MISSING | SAFE_USED)] * 997
