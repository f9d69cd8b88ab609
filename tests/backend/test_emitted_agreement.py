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
from tests.backend.helpers import COMPILERS, NAMES, Run, bits, load_program, program_of
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
