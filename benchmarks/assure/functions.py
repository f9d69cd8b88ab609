"""How far each machine's `exp` and `tanh` are from the true value, in units in the last place.

Programs that use them are compared across machines by this bound instead of bit for bit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.assure import tools
from benchmarks.assure.driving import DRIVER, HOST, TARGETS, Machine
from benchmarks.assure.subjects import REALS
from pirlc.backend.numbers import PRECISIONS, RealType

TOOLS = (tools.GCC, *dict.fromkeys(tool for target in TARGETS for tool in target.tools))

BOUND = 2.0
"""Units in the last place of the working precision that no machine may exceed here."""
POINTS = 10_000
FUNCTIONS = ("exp", "tanh")


@dataclass(frozen=True)
class Distance:
    """The largest error over the points, in units in the last place of the true value."""

    machine: str
    function: str
    real: RealType
    ulp: float
    at: float


def points() -> NDArray[np.float64]:
    """Binary32 numbers, dense around 0 and up to where `exp` leaves the range of binary32."""
    rng = np.random.default_rng(4)
    half = POINTS // 2
    near = rng.standard_normal(half) * 10.0 ** rng.uniform(-6.0, 0.5, half)
    wide = rng.uniform(-87.0, 88.0, POINTS - half)
    return np.concatenate([near, wide]).astype(np.float32).astype(np.float64)


def measure(machine: Machine, folder: Path) -> list[Distance]:
    folder.mkdir(parents=True, exist_ok=True)
    program = folder / "program"
    sources = [DRIVER / name for name in ("functions.c", *machine.sources)]
    tools.succeed(
        [
            *(machine.compiler.command, *machine.flags, "-std=gnu99", "-fno-builtin", "-w"),
            *("-o", str(program), *map(str, sources), *machine.libraries),
        ]
    )
    given = points()
    given.astype(machine.number).tofile(folder / "readings")
    if machine.emulator is None:
        command: list[str | Path] = [program, "readings", "answers"]
    elif machine.emulator is tools.QEMU_ARM:
        command = [machine.emulator.command, *machine.emulation, "-kernel", program]
    else:
        command = [machine.emulator.command, program, "readings", "answers"]
    tools.succeed(command, folder)
    found = np.fromfile(folder / "answers", machine.number).reshape(len(given), 4)
    distances = []
    columns: list[tuple[str, RealType]] = [(f, r) for f in FUNCTIONS for r in REALS]
    for column, (function, real) in enumerate(columns):
        errors = [
            _ulps(function, real, x, y)
            for x, y in zip(given.tolist(), found[:, column].tolist(), strict=True)
        ]
        worst = int(np.argmax(errors))
        distances.append(Distance(machine.name, function, real, errors[worst], given[worst]))
    return distances


def _ulps(function: str, real: RealType, x: float, y: float) -> float:
    """|y - f(x)| in units in the last place of f(x), by ball arithmetic to 200 bits."""
    from flint import arb, ctx

    ctx.prec = 200
    true = arb(x).exp() if function == "exp" else arb(x).tanh()
    nearest = PRECISIONS[real].round(float(true.mid()))
    exponent = math.frexp(nearest)[1]
    bits, least = (53, -1074) if real == "double" else (24, -149)
    unit = math.ldexp(1.0, max(exponent - bits, least))
    return abs(float(((arb(y) - true) / arb(unit)).mid()))


def check(work: Path) -> tuple[list[Distance], list[str]]:
    """On this machine and on every target; what exceeds the bound is a finding."""
    distances = [
        distance
        for machine in (HOST, *TARGETS)
        for distance in measure(machine, work / "functions" / machine.name)
    ]
    findings = [
        f"{d.machine}: {d.function} ({d.real}) is {d.ulp:.2f} ulp off at {d.at!r}"
        for d in distances
        if not d.ulp <= BOUND
    ]
    return distances, findings
