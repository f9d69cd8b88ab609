"""Emitted Python and C do, bit for bit, what the reference interpreter does."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np
import pytest

from pirlc.ir.operators import Operator
from pirlc.ir.policy import Interface, Program
from pirlc.ir.terms import Apply, LocalRef, SensorRef, Term, subterms, transform
from pirlc.ir.types import Sequence
from tests.backend.helpers import COMPILERS, FORMS, NAMES, Run, bits, load_program, program_of
from tests.support.observations import random_observations
from tests.support.programs import random_program

STEPS = 90


def wide_observations(rng: random.Random, interface: Interface, steps: int):
    """Random observations of every sensor, whatever its component."""
    table = np.zeros((steps, 1 + max(sensor.index for sensor in interface.sensors)))
    for sensor in interface.sensors:
        alone = replace(interface, sensors=(replace(sensor, index=0),))
        with np.errstate(over="ignore"):
            table[:, sensor.index] = random_observations(rng, alone, steps)[:, 0]
    return table


def assert_agrees(program: Program, real: str, seed: int, forms: list[Run], folder) -> None:
    observations = wide_observations(random.Random(seed), program.interface, STEPS)
    reference = Run(program, "interpreter", real, folder)
    libm = any(
        isinstance(sub, Apply) and sub.operator in (Operator.EXP, Operator.TANH)
        for body in program.bodies
        for sub in subterms(body)
    )
    for round_ in range(2):
        for run in (reference, *forms):
            run.reset()
        for number, observation in enumerate(observations):
            expected = reference.step(observation)
            for run in forms:
                found = run.step(observation)
                where = f"{run.form}, {real}, step {number}, round {round_}"
                assert found[1:] == expected[1:], where
                if libm and run.form == "c":
                    assert found[0] == pytest.approx(expected[0], rel=1e-6, nan_ok=True), where
                else:
                    assert bits(found[0]) == bits(expected[0]), where


@pytest.mark.skipif(not COMPILERS, reason="no gcc and no clang on this machine")
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize(
    ("level", "real"),
    [("-O0", "double"), ("-O2", "double"), ("-O3", "double"), ("-O2", "float")],
)
def test_programs_in_c(name, compiler, level, real, tmp_path):
    program = load_program(name)
    run = Run(program, "c", real, tmp_path, compiler=compiler, level=level)
    assert_agrees(program, real, 1, [run], tmp_path)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("real", ["double", "float"])
def test_programs_in_python(name, real, tmp_path):
    program = load_program(name)
    assert_agrees(program, real, 2, [Run(program, "python", real, tmp_path)], tmp_path)


def lengthened(program: Program, by: int) -> Program:
    """The program over longer windows: rings in C, and loops instead of unrolled folds."""

    def change(term: Term) -> Term:
        if isinstance(term, SensorRef):
            return replace(term, length=term.length + by)
        if isinstance(term, LocalRef) and isinstance(term.type, Sequence):
            return replace(term, type=Sequence(term.type.length + by))
        return term

    interface = replace(program.interface, window=program.interface.window + by)
    return replace(
        program, interface=interface, bodies=tuple(transform(b, change) for b in program.bodies)
    )


@pytest.mark.parametrize("real", ["double", "float"])
def test_random_programs_in_python(real, tmp_path):
    for seed in range(40):
        rng = random.Random(seed)
        program = lengthened(random_program(rng), rng.choice([0, 0, 3, 12]))
        assert_agrees(program, real, seed, [Run(program, "python", real, tmp_path)], tmp_path)


@pytest.mark.skipif(not COMPILERS, reason="no gcc and no clang on this machine")
@pytest.mark.parametrize("real", ["double", "float"])
def test_random_programs_in_c(real, tmp_path):
    for seed in range(1000, 1016):
        rng = random.Random(seed)
        program = lengthened(random_program(rng), rng.choice([0, 0, 3, 12]))
        compiler = COMPILERS[seed % len(COMPILERS)]
        run = Run(program, "c", real, tmp_path, compiler=compiler)
        assert_agrees(program, real, seed, [run], tmp_path)


@pytest.mark.parametrize("real", ["double", "float"])
def test_folds_inside_folds_over_a_single_reading(real: str, tmp_path) -> None:
    program = program_of(
        "policy single\n"
        "sensor X : [-1, 1] = 0\n"
        r"action A : [-2, 2] safe 0 = fold(\v acc -> acc + v * fold(+, X), X, 1)"
    )
    forms = [Run(program, form, real, tmp_path) for form in ("python", "c")]
    assert_agrees(program, real, 7, forms, tmp_path)


SMALL = """
policy small
sensor X : [-1, 1] = 0
sensor Y : [-1, 1] = 1 missing zero
window {window}
latency {latency}
action A : [-2, 2] safe 0.5 = {action}
"""

KEEPS = r"fold(\v acc -> if v > 0 then acc else (if v < -0.5 then v else acc * 0.5), X, 1)"
TAKES = r"fold(\v acc -> if v > 0 then (if v > 0.5 then v else acc * 0.5) else acc, X, 1)"
NESTED = r"fold(\v acc -> acc + v * fold(+, Y), X, 1)"


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize(
    ("action", "window", "latency"),
    [
        (NESTED, 2, 0),
        (NESTED, 2, 1),
        (NESTED, 3, 2),
        (NESTED, 9, 0),
        (KEEPS, 2, 0),
        (KEEPS, 12, 1),
        (TAKES, 12, 0),
        ("peek(X, -1) + fold(+, Y)", 8, 1),
        ("1 / peek(X, -1) + peek(Y, -1) / 0", 1, 0),
        ("1e300 * 1e300 * peek(X, -1)", 1, 0),
        ("fold(max, diff(X)) - fold(min, X * 1e39)", 10, 3),
    ],
)
def test_small_programs(action, window, latency, real, tmp_path):
    program = program_of(SMALL.format(action=action, window=window, latency=latency))
    forms = [Run(program, form, real, tmp_path) for form in FORMS if form != "interpreter"]
    assert_agrees(program, real, 3, forms, tmp_path)


@pytest.mark.parametrize("form", FORMS)
def test_truth_tables(form, tmp_path):
    guards = [
        "{a} and {b}",
        "{a} or {b}",
        "not {a}",
        "not ({a} or {b})",
        "({a} implies {b})",
        "({b} implies {a}) and not ({a} and {b})",
        "{a} and ({b} or not {a})",
        "not ({a} implies {b}) or {b}",
    ]
    a, b = "peek(X, -1) > 0", "peek(Y, -1) > 0"
    actions = "\n".join(
        f"action u{k} : {{0, 1}} = if {guard.format(a=f'({a})', b=f'({b})')} then 1 else 0"
        for k, guard in enumerate(guards)
    )
    run = Run(
        program_of(f"policy truth\nsensor X : [-1, 1] = 0\nsensor Y : [-1, 1] = 1\n{actions}"),
        form,
        "double",
        tmp_path,
    )
    for x in (False, True):
        for y in (False, True):
            expected = [
                x and y,
                x or y,
                not x,
                not (x or y),
                not x or y,
                (not y or x) and not (x and y),
                x and (y or not x),
                (x and not y) or y,
            ]
            assert run.step([x - 0.5, y - 0.5])[0] == tuple(map(int, expected)), (x, y)
