"""The benchmark of growth: its exponents, its measurements, and the memory it is about."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.growth.__main__ import main
from benchmarks.growth.findings import MEMORY_LIMIT, Curve, Point, markdown, memory, seconds
from benchmarks.growth.fitting import exponent, upper_half
from benchmarks.growth.measure import Server, timed

SIZES = [1e3, 1e4, 1e5, 1e6]


def test_the_exponent_of_a_power_is_found_exactly() -> None:
    found = exponent(SIZES, [3e-6 * size**1.25 for size in SIZES])
    assert found.value == pytest.approx(1.25)
    assert found.half == pytest.approx(0.0, abs=1e-9)
    assert str(found) == "1.25 ± 0.00"


def test_the_interval_holds_the_exponent_as_often_as_it_says() -> None:
    generator = np.random.default_rng(0)
    held = 0
    for _ in range(400):
        noise = np.exp(generator.normal(0.0, 0.2, 12))
        found = exponent(SIZES * 3, np.array(SIZES * 3) ** 0.9 * noise)
        held += abs(found.value - 0.9) <= found.half
    assert 0.92 <= held / 400 <= 0.98


def test_of_two_points_no_interval_is_known() -> None:
    found = exponent([1, 10], [1, 100])
    assert (found.value, found.half) == (pytest.approx(2.0), math.inf)


def test_the_upper_half_is_in_logarithms_and_has_three_sizes() -> None:
    assert upper_half([1, 10, 100, 1_000, 10_000]) == [100, 1_000, 10_000]
    assert upper_half([2, 4, 8, 16, 32, 64]) == [16, 32, 64]
    assert upper_half([1, 10, 10, 1_000]) == [1, 10, 1_000]


def curve(power: float, limit: float | None = 1.1) -> Curve:
    """A stage that costs a second at any size, and what grows."""
    sizes = [10**i for i in range(7)]
    points = tuple(
        Point(size, (1 + 1e-3 * size**power, 1 + 1.01e-3 * size**power), (2**27 + 64 * size,))
        for size in sizes
    )
    return Curve("work", "things", limit, points)


def test_what_hides_at_small_sizes_is_seen_in_the_upper_half() -> None:
    linear, square = curve(1.0), curve(2.0)
    whole, upper = square.time_exponent(), square.upper_exponent()
    assert whole is not None
    assert upper is not None
    assert upper.value > whole.value + 0.1
    assert (linear.within, square.within, curve(2.0, None).within) == (True, False, None)
    grown = linear.memory_exponent(2**27)
    assert grown is not None
    assert grown.value == pytest.approx(1.0, abs=1e-6)
    text = markdown([linear, square], "Preface.")
    assert "## Things" in text
    assert "met (≤ 1.1)" in text
    assert "MISSED (≤ 1.1)" in text


def test_figures_are_told_in_their_units() -> None:
    assert [seconds(x) for x in (2.5, 0.025, 2.5e-5)] == ["2.5 s", "25 ms", "25 µs"]
    assert [memory(x) for x in (2**31, 3 * 2**20)] == ["2.00 GiB", "3 MiB"]


def test_work_is_repeated_unless_it_is_long() -> None:
    calls: list[None] = []
    timed(lambda: calls.append(None), long=True)
    assert len(calls) == 1
    _, repeats = timed(lambda: sum(range(100_000)), long=False)
    assert repeats > 1


def test_every_job_is_a_process_of_its_own() -> None:
    with Server() as server:
        empty = server.measure(-1, 0)
        large, small = server.measure(0, 200_000), server.measure(0, 1_000)
        assert large.peak > small.peak + 10 * 2**20, "what one job held, the next does not"
        assert empty.peak <= small.peak < 2**30
        with pytest.raises(RuntimeError, match="stage 10000 at 1: ended with status 1"):
            server.measure(10_000, 1)
        assert server.measure(0, 1_000).seconds > 0.0


def test_a_quick_run_writes_tables_and_a_plot(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--quick", "--only", "emit C", "--output", str(tmp_path)]) == 0
    text = (tmp_path / "growth.md").read_text(encoding="utf-8")
    assert capsys.readouterr().out.strip() == text.strip()
    assert "| emit C | 2 to 8 |" in text
    found = json.loads((tmp_path / "growth.json").read_text(encoding="utf-8"))
    assert {c["axis"] for c in found["curves"]} == {
        "window (8 sensors)",
        "nested ifs (8 sensors, window 5)",
    }
    assert all(len(c["points"]) == 3 for c in found["curves"])
    assert (tmp_path / "growth.png").read_bytes().startswith(b"\x89PNG")


def test_a_word_that_no_stage_has(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--quick", "--only", "nonsense", "--output", str(tmp_path)])
    assert "no stage has 'nonsense' in its name or axis" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


MILLION = """
import resource
resource.setrlimit(resource.RLIMIT_AS, ({limit}, {limit}))
import numpy as np
from benchmarks.growth import workloads as given
from pirlc.semantics.vectorised import apply_actions, compile_plan, distance
from pirlc.symbolic.smooth import SmoothedObjective
from pirlc.tune import TuningProblem
from pirlc.tune.smoothed import tune

template = given.every_sensor(8, 64)
histories = given.history_set(template, 1_000_000)
labels, values = given.labels_for(histories), given.values_of(template)
plan = compile_plan(template)

def score(histories, labels):
    actions = apply_actions(plan.run(values, histories), histories).actions
    return distance(actions, labels, template.interface.actions)

whole = score(histories, labels)
order = np.random.default_rng(0).permutation(1_000_000)
again = score(histories.select(order), labels[order])
smoothed = SmoothedObjective(template, histories, labels)
loss, gradient = smoothed(np.array(list(values.values())), 0.3)
tuned = tune(TuningProblem(given.one_law(8, 64), histories, labels), 0)
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
print(len(histories), whole, again, np.isfinite(gradient).all(), tuned.distance, peak)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory and their units are Linux's")
def test_a_million_histories_of_eight_sensors_over_a_window_of_64_fit_into_4_gib() -> None:
    """Scored, selected, and tuned on, under a limit of the address space, libraries and all."""
    ran = subprocess.run(
        [sys.executable, "-c", MILLION.format(limit=MEMORY_LIMIT)],
        capture_output=True,
        text=True,
        check=False,
        env={"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONPATH": "."},
        cwd=Path(__file__).parents[2],
    )
    assert ran.returncode == 0, ran.stderr[-2000:]
    count, whole, again, finite, tuned, peak = ran.stdout.split()
    assert int(count) == 1_000_000
    assert float(again) == pytest.approx(float(whole), rel=1e-12)
    assert finite == "True"
    assert float(tuned) < float(whole)
    assert int(peak) < 2 * 2**30
