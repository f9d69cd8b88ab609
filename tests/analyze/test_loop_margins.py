"""Margins: textbook loops, closed formulas, 200 random loops with each figure found twice."""

from __future__ import annotations

import math
from dataclasses import replace

import control
import numpy as np
import pytest

from pirlc.analyze.checks import checks_of, failed
from pirlc.analyze.margins import margins_of
from pirlc.analyze.problems import Disagreement, describe
from tests.support.analysis import realised, response_of


def _margins(num, den, taps=(1.0,), latency=0, sample_time=1.0):
    loop = realised(num, den, taps, latency)
    found = margins_of(loop, sample_time)
    checks = checks_of(loop, response_of(num, den, taps, latency), found, sample_time)
    assert not [check for check in checks if failed(check)]
    return found


def test_ogata_range_of_gain():
    """Ogata, Discrete-Time Control Systems, 2nd ed., section 4-3: K / (s (s + 1)) with a hold at
    T = 1 s is stable for 0 < K < 2.3925, and then swings at 1.3244 rad/s."""
    found = _margins([0.3679, 0.2642], np.polymul([1, -1], [1, -0.3679]))
    assert found.gain_up == pytest.approx(2.3925, abs=1e-4)
    assert found.gain_up_frequency == pytest.approx(1.3244, abs=1e-4)
    assert found.gain_down == 0.0


def test_second_order_loop_by_jurys_criterion():
    """0.25 K / ((z - 1)(z - 0.5)): z^2 - 1.5 z + 0.5 + 0.25 K is stable while 0.5 + 0.25 K < 1."""
    found = _margins([0.25], np.polymul([1, -1], [1, -0.5]))
    assert found.gain_up == pytest.approx(2.0, abs=1e-12)
    assert found.gain_up_frequency == pytest.approx(math.acos(0.75), abs=1e-12)


@pytest.mark.parametrize("gain", [0.1, 0.5, 1.3])
def test_integrator_in_closed_form(gain):
    """k / (z - 1): |z - 1| = k at theta = 2 asin(k / 2); its phase is -90 degrees - theta / 2."""
    found = _margins([gain], [1, -1])
    theta = 2 * math.asin(gain / 2)
    assert found.gain_up == pytest.approx(2 / gain, rel=1e-12)
    assert found.gain_up_frequency == pytest.approx(math.pi)
    assert found.phase == pytest.approx(90 - math.degrees(theta / 2), rel=1e-12)
    assert found.phase_frequency == pytest.approx(theta, rel=1e-12)
    assert found.delay_samples == pytest.approx((math.pi / 2 - theta / 2) / theta, rel=1e-12)
    # S = (z - 1) / (z - 1 + k) is largest at z = -1, T = k / (z - 1 + k) at z = 1 or -1.
    assert found.sensitivity_peak == pytest.approx(2 / (2 - gain), rel=1e-12)
    assert found.complementary_peak == pytest.approx(max(1.0, gain / (2 - gain)), rel=1e-12)


def test_an_unstable_plant_has_a_lower_gain_margin():
    """k / (z - 1.2) is stable for 0.2 < k < 2.2."""
    found = _margins([0.5], [1, -1.2])
    assert found.gain_down == pytest.approx(0.4, rel=1e-12)
    assert found.gain_up == pytest.approx(4.4, rel=1e-12)
    assert found.gain_down_frequency == 0.0


def test_a_margin_at_the_nyquist_frequency_is_not_overlooked():
    """python-control's margins leave z = -1 out: for it this loop has no gain margin."""
    system = control.tf([0.5], [1, -1], 1.0)
    assert math.isinf(control.stability_margins(system)[0])
    assert _margins([0.5], [1, -1]).gain_up == pytest.approx(4.0)


def test_python_control_agrees_away_from_the_ends():
    num, den = [0.3679, 0.2642], np.polymul([1, -1], [1, -0.3679])
    gain, phase, _, gain_at, phase_at, _ = control.stability_margins(control.tf(num, den, 1.0))
    found = _margins(num, den)
    assert (found.gain_up, found.phase) == (pytest.approx(gain), pytest.approx(phase))
    assert found.gain_up_frequency == pytest.approx(gain_at)
    assert found.phase_frequency == pytest.approx(phase_at)
    grid = np.linspace(1e-4, math.pi, 4000)
    disk, _, disk_phase = control.disk_margins(control.tf(num, den, 1.0), grid, skew=0.0)
    assert found.disk == pytest.approx(disk, rel=1e-5)
    assert found.disk_phase == pytest.approx(disk_phase, rel=1e-5)


def test_the_disk_margin_bounds_the_others():
    found = _margins([0.3679, 0.2642], np.polymul([1, -1], [1, -0.3679]))
    low, high = found.disk_gain
    assert low * high == pytest.approx(1.0)
    assert high <= found.gain_up
    assert found.disk_phase <= found.phase


def test_latency_takes_frequency_times_time_from_the_phase():
    margins = [_margins([0.1], [1, -1], latency=k, sample_time=0.02) for k in (0, 1, 2)]
    for later, found in enumerate(margins):
        lost = margins[0].phase - found.phase
        frequency = margins[0].phase_frequency
        assert lost == pytest.approx(math.degrees(frequency * 0.02 * later), rel=1e-9, abs=1e-9)
        assert found.delay_samples == pytest.approx(margins[0].delay_samples - later, rel=1e-9)
        assert found.delay_seconds == pytest.approx(found.delay_samples * 0.02)


def test_a_loop_gain_above_one_at_nyquist_bears_no_delay_of_a_whole_sample():
    """L(-1) = 1.2 / 0.75: one more step of delay turns it to the other side of -1."""
    num, den = [0.6, -0.6], [1.0, 0.0, -0.25]
    loop = realised(num, den)
    assert loop.at(np.array([-1.0 + 0j]))[0] == pytest.approx(-1.6)
    num = [-0.6, 0.6]
    loop = realised(num, den)
    assert loop.at(np.array([-1.0 + 0j]))[0] == pytest.approx(1.6)
    assert np.max(np.abs(loop.closed())) < 1.0
    assert np.max(np.abs(realised(num, den, latency=1).closed())) > 1.0
    assert _margins(num, den).delay_samples <= 1.0


def test_a_zero_at_the_nyquist_frequency_is_no_margin():
    """A sampled double integrator: L(-1) is 0, whatever rounding makes of it."""
    num, den = np.array([0.005, 0.005]), [1.0, -2.0, 1.0]
    found = _margins(num, den, (4.0, -3.5))
    assert found.gain_down == 0.0
    assert found.gain_up_frequency < 3.0


@pytest.mark.parametrize(
    ("num", "den"), [([0.5], [1, -0.5]), ([0.5, 0.5], [1, 0, 0]), ([-0.5, 0.5], [1, 0, 0])]
)
def test_a_loop_gain_of_one_only_at_an_end_is_half_a_turn_away(num, den):
    """L(1) = 1, or L(-1) = 1 in the last: |L| is below 1 elsewhere."""
    found = _margins(num, den)
    assert found.phase == pytest.approx(180.0) or math.isinf(found.phase)


def _random_loop(rng):
    """A plant of order 1 to 5, stable or not, with integrators and resonances, and a PID or any
    finite impulse response behind up to three steps of latency."""
    order = int(rng.integers(1, 6))
    poles: list[complex] = []
    while len(poles) < order:
        kind = rng.integers(0, 4)
        if kind == 0 and order - len(poles) >= 2:
            pole = rng.uniform(0.3, 1.05) * np.exp(1j * rng.uniform(0.02, 3.0))
            poles += [pole, pole.conjugate()]
        elif kind == 1 and 1.0 not in poles:
            poles.append(1.0)
        else:
            poles.append(rng.uniform(-0.9, 1.1))
    num = rng.normal(size=order) * rng.choice([0.01, 0.1, 1.0])
    taps = np.zeros(int(rng.integers(2, 7)))
    kp, ki, kd = rng.normal(size=3) * [1.0, 0.2, 1.0] * rng.choice([0.03, 0.1, 0.3, 1.0])
    taps += ki
    taps[0] += kp + kd
    taps[1] -= kd
    if rng.random() < 0.3:
        taps = rng.normal(size=len(taps)) * 0.2
    return num, np.real(np.poly(poles)), taps, int(rng.integers(0, 4))


def _stabilised(rng):
    """An unstable plant and a finite impulse response that holds it."""
    while True:
        num, den, taps, _ = _random_loop(rng)
        latency = int(rng.integers(0, 2))
        if len(den) > 4 or np.max(np.abs(np.roots(den))) < 1.01:
            continue
        for _ in range(300):
            draw = rng.normal(size=max(len(taps), 3)) * rng.choice([0.3, 1.0, 3.0])
            if np.max(np.abs(realised(num, den, draw, latency).closed())) < 0.999:
                return num, den, draw, latency


def test_two_hundred_random_loops_agree_with_eigenvalues_and_a_dense_grid():
    rng = np.random.default_rng(4)
    done, worst = 0, 0.0
    while done < 200:
        parts = _stabilised(rng) if done % 5 == 0 else _random_loop(rng)
        loop = realised(*parts)
        if np.max(np.abs(loop.closed())) >= 1.0 - 1e-6:
            continue
        done += 1
        checks = checks_of(loop, response_of(*parts), margins_of(loop, 0.05), 0.05)
        assert len(checks) == 8
        worst = max(worst, *(check.difference for check in checks))
    assert worst <= 1e-6


def test_any_wrong_figure_is_noticed():
    num, den = [0.5, 0.1], np.polymul([1, -1.1], [1, -0.3])
    loop, response = realised(num, den), response_of(num, den)
    right = margins_of(loop, None)
    for figure in (
        "gain_up", "gain_down", "phase", "delay_samples", "disk", "sensitivity_peak",
        "complementary_peak",
    ):  # fmt: skip
        value = getattr(right, figure)
        assert math.isfinite(value)
        wrong = replace(right, **{figure: value * (1 + 2e-6)})
        assert sum(map(failed, checks_of(loop, response, wrong, None))) == 1, figure

    def other(z):
        return response(z) * (1 + 1e-5)

    assert sum(map(failed, checks_of(loop, other, right, None))) >= 1


def test_e0921():
    num, den = [0.5], [1, -1]
    loop = realised(num, den)
    wrong = replace(margins_of(loop, None), phase=70.0)
    checks = [c for c in checks_of(loop, response_of(num, den), wrong, None) if failed(c)]
    diagnostic = describe(Disagreement("Steer 1", tuple(checks)))
    assert diagnostic.code == "E0921"
    assert diagnostic.message == "two ways to a margin of the loop with Steer 1 disagree"
    assert diagnostic.notes == (
        "phase margin: 70, but 75.5224878 by rotation at which one crosses",
    )
