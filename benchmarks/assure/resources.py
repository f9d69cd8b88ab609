"""Flash, RAM, stack and instructions of a step, beside the same policy in CasADi's C.

Instructions are counted while qemu runs recorded streams: the most that any step took there. That
is no bound on the worst case, and instructions are not cycles. The longest path is counted in
operations of the program by pirlc, over all paths.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.assure import tools, twin
from benchmarks.assure.driving import (
    CORTEX_M3,
    CORTEX_M4F,
    DRIVER,
    HOST,
    Machine,
    answers,
    build,
)
from benchmarks.assure.streams import stream
from benchmarks.assure.subjects import Subject
from pirlc.backend.costs import checking_operations, program_operations
from pirlc.backend.numbers import RealType
from pirlc.ir.policy import Fill, Program
from pirlc.symbolic.casadi_form import Element, casadi_form

TOOLS = (tools.GCC, tools.ARM_GCC, tools.QEMU_ARM)
MACHINES: dict[RealType, Machine] = {"float": CORTEX_M4F, "double": CORTEX_M3}
"""binary32 where there is hardware for it, binary64 in software."""

STEPS = 10_000
COUNTING = ("-icount", "shift=10")
AGREEMENT = {"double": 1e-6, "float": 1e-2}
"""Of the actions' ranges; at a guard, the two may differ altogether."""


@dataclass(frozen=True)
class Use:
    """Bytes, and instructions a step. `flash` has what the code needs of libgcc and libm."""

    flash: int
    ram: int
    stack: int
    instructions: int
    mean_instructions: float


@dataclass(frozen=True)
class Resources:
    """`own_flash` is without libraries, `frame` the stack of the step function alone.

    `taken` of the C's `branches` (two for each condition) were taken by the stream.
    """

    label: str
    machine: str
    real: RealType
    emitted: Use
    own_flash: int
    frame: int
    operations: int
    checks: int
    branches: int
    taken: int
    casadi: Use
    steps: int


def measure(subject: Subject, work: Path) -> tuple[Resources, list[str]]:
    """The figures, and what is wrong with them."""
    machine = MACHINES[subject.real]
    readings = stream(subject.program, STEPS, subject.seed + 2_000)
    program = build(subject, machine, work / "emitted", driver_only=["-DCOUNTED"])
    found = answers(program, subject, machine, readings, 2, COUNTING)
    compiled = _object(subject.source, machine, work, ["-fstack-usage"])
    emitted = Use(
        flash=_linked(
            compiled,
            machine,
            tuple(f"{subject.stem}_{part}" for part in ("step", "reset", "default_params")),
        ),
        ram=_state_size(subject, machine, work),
        stack=int(found[:, -1].max()),
        instructions=int(found[:, -2].max()),
        mean_instructions=round(float(found[:, -2].mean()), 1),
    )
    branches, taken = _coverage(subject, readings, work / "covered")
    casadi, findings = _casadi(subject, machine, good(subject.program, readings), work)
    resources = Resources(
        label=subject.label,
        machine=machine.name,
        real=subject.real,
        emitted=emitted,
        own_flash=_size(compiled),
        frame=_frame(compiled, f"{subject.stem}_step"),
        operations=program_operations(subject.controller),
        checks=checking_operations(subject.controller),
        branches=branches,
        taken=taken,
        casadi=casadi,
        steps=STEPS,
    )
    return resources, [f"{subject.name}: {finding}" for finding in findings]


def good(program: Program, readings: NDArray[np.float64]) -> NDArray[np.float64]:
    """The stream without missing readings and within the ranges."""
    table = readings.copy()
    for column, sensor in enumerate(program.interface.sensors):
        values = table[:, column]
        values[0] = values[0] if np.isfinite(values[0]) else sensor.lower
        last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), 0))
        table[:, column] = np.clip(values[last], sensor.lower, sensor.upper)
    return table


def _casadi(
    subject: Subject, machine: Machine, readings: NDArray[np.float64], work: Path
) -> tuple[Use, list[str]]:
    made = twin.generate(subject, work / "twin")
    plain = build(subject, machine, work / "again")
    ours = answers(plain, subject, machine, readings)[:, :-1]
    folder = made.source.parent
    windows = _windows(subject, readings, ours)
    program = folder / "program"
    compiled = _object(made.source, machine, folder)
    sources = [DRIVER / name for name in ("twin.c", *machine.sources)]
    flags = [f"-DINPUTS={made.inputs}", f"-DOUTPUTS={made.outputs}", f"-DREAL={subject.real}"]
    tools.succeed(
        [
            *(machine.compiler.command, *machine.flags, "-std=gnu99", "-w", *flags),
            *("-I", str(folder), "-o", str(program), *map(str, sources), str(compiled)),
            *machine.libraries,
        ]
    )
    windows.astype(machine.number).tofile(folder / "readings")
    tools.succeed(
        [tools.QEMU_ARM.command, *machine.emulation, *COUNTING, "-kernel", program], folder
    )
    found = np.fromfile(folder / "answers", machine.number).reshape(len(windows), -1)
    use = Use(
        flash=_linked(compiled, machine, ("twin",)),
        ram=made.history * (8 if subject.real == "double" else 4),
        stack=int(found[:, -1].max()),
        instructions=int(found[:, -2].max()),
        mean_instructions=round(float(found[:, -2].mean()), 1),
    )
    apart = np.abs(found[:, :-2] - ours) > AGREEMENT[subject.real]
    share = float(apart.any(axis=1).mean())
    findings = [f"CasADi's function differs at {share:.1%} of the steps"] if share > 0.02 else []
    return use, findings


def _windows(
    subject: Subject, readings: NDArray[np.float64], actions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """What the CasADi function takes at each step: elements of windows, previous actions."""
    interface = subject.program.interface
    assert interface.fill is Fill.FIRST
    sensors = [sensor.name for sensor in interface.sensors]
    columns = []
    for which in casadi_form(subject.program, 1).inputs:
        if isinstance(which, Element):
            behind = -which.index - 1 + interface.latency
            values = readings[:, sensors.index(which.sensor)]
            first = np.full(min(behind, len(values)), values[0])
            columns.append(np.concatenate([first, values[: len(values) - behind]]))
        else:
            place = [action.name for action in interface.actions].index(which.action)
            safe = interface.actions[place].safe
            columns.append(np.concatenate([[safe], actions[:-1, place]]))
    return np.column_stack(columns)


def _coverage(subject: Subject, readings: NDArray[np.float64], folder: Path) -> tuple[int, int]:
    """Branches of the C, and how many of them the stream takes."""
    program = build(subject, HOST, folder, extra=["-O0", "--coverage"])
    answers(program, subject, HOST, readings)
    said = tools.succeed(["gcov", "-b", "-n", "controller.gcda"], folder)
    found = re.search(r"Taken at least once:([\d.]+)% of (\d+)", said)
    if found is None:
        return 0, 0
    branches = int(found[2])
    return branches, round(float(found[1]) * branches / 100.0)


def _object(source: Path, machine: Machine, folder: Path, extra: list[str] | None = None) -> Path:
    place = folder / f"{source.stem}-alone.o"
    sections = ["-ffunction-sections", "-fdata-sections", *(extra or [])]
    tools.succeed([machine.compiler.command, *machine.flags, *sections, "-c", source, "-o", place])
    return place


def _size(binary: Path) -> int:
    """Code, constants and initial values, as bytes of flash."""
    text, data = tools.succeed(["arm-none-eabi-size", binary]).splitlines()[1].split()[:2]
    return int(text) + int(data)


def _linked(compiled: Path, machine: Machine, roots: tuple[str, ...]) -> int:
    """With what the functions need of libgcc and libm, and nothing else."""
    place = compiled.with_suffix(".elf")
    tools.succeed(
        [
            *(machine.compiler.command, *machine.flags, "-nostartfiles", "-Wl,--gc-sections"),
            *(f"-Wl,-e,{roots[0]}", *(f"-Wl,-u,{root}" for root in roots)),
            *("-o", str(place), str(compiled), "-lm"),
        ]
    )
    return _size(place)


def _frame(compiled: Path, function: str) -> int:
    for line in compiled.with_suffix(".su").read_text(encoding="utf-8").splitlines():
        if found := re.match(rf".*:{function}\t(\d+)\tstatic", line):
            return int(found[1])
    raise tools.ToolFailed(f"no stack usage of {function}")


def _state_size(subject: Subject, machine: Machine, work: Path) -> int:
    probe = work / "probe.c"
    probe.write_text(
        f'#include "{subject.stem}.h"\nchar probe[sizeof({subject.stem}_state)];\n',
        encoding="ascii",
    )
    compiled = work / "probe.o"
    tools.succeed(
        [
            *(machine.compiler.command, *machine.flags, "-I", str(subject.folder)),
            *("-c", str(probe), "-o", str(compiled)),
        ]
    )
    symbols = tools.succeed(["arm-none-eabi-nm", "-S", compiled])
    found = re.search(r"^\w+ (\w+) \w probe$", symbols, re.MULTILINE)
    assert found is not None, symbols
    return int(found[1], 16)
