"""Builds a controller with the driver for a machine, and runs it over a stream there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.assure import tools
from benchmarks.assure.subjects import Subject
from benchmarks.assure.tools import Tool
from pirlc.backend.toolchain import FLAGS

DRIVER = Path(__file__).parent / "driver"


@dataclass(frozen=True)
class Machine:
    """How to build for a machine, and how to run there: `program` and its arguments follow.

    `big_endian` is the byte order of the files that it reads and writes.
    """

    name: str
    compiler: Tool
    flags: tuple[str, ...]
    emulator: Tool | None
    emulation: tuple[str, ...] = ()
    big_endian: bool = False
    sources: tuple[str, ...] = ()
    libraries: tuple[str, ...] = ("-lm",)

    @property
    def tools(self) -> tuple[Tool, ...]:
        return (self.compiler,) if self.emulator is None else (self.compiler, self.emulator)

    @property
    def number(self) -> np.dtype[np.float64]:
        return np.dtype(">f8" if self.big_endian else "<f8")


HOST = Machine("host", tools.GCC, FLAGS, None)

_SEMIHOSTED = (
    *("-nographic", "-monitor", "none", "-serial", "none"),
    *("-semihosting-config", "enable=on,target=native,arg=program,arg=readings,arg=answers"),
)


def _cortex_m(name: str, cpu: str, board: str, *floating: str) -> Machine:
    return Machine(
        name,
        tools.ARM_GCC,
        (*FLAGS, f"-mcpu={cpu}", "-mthumb", *floating),
        tools.QEMU_ARM,
        ("-M", board, *_SEMIHOSTED),
        sources=("startup.c",),
        libraries=("--specs=rdimon.specs", "-T", str(DRIVER / "cortex_m.ld"), "-lm"),
    )


CORTEX_M3 = _cortex_m("Cortex-M3", "cortex-m3", "mps2-an385", "-mfloat-abi=soft")
CORTEX_M4F = _cortex_m(
    "Cortex-M4F", "cortex-m4", "mps2-an386", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"
)
# There -std=c99 alone means that `float` is computed in `double`, which emitted C refuses.
S390X = Machine(
    "s390x",
    tools.S390X_GCC,
    (*FLAGS, "-fexcess-precision=fast", "-static"),
    tools.QEMU_S390X,
    big_endian=True,
)
PPC64 = Machine("ppc64", tools.PPC64_GCC, (*FLAGS, "-static"), tools.QEMU_PPC64, big_endian=True)
TARGETS = (CORTEX_M3, CORTEX_M4F, S390X, PPC64)


def glue(subject: Subject) -> str:
    """The names of the controller's members for the driver."""
    printer, stem = subject.printer, subject.stem
    channels, outputs = subject.controller.channels, subject.controller.outputs
    take = " ".join(
        f"(in).{printer.inputs[c.name]} = ({stem}_real)(r)[{k}];" for k, c in enumerate(channels)
    )
    give = " ".join(
        f"(a)[{k}] = (double)(out).{printer.actions[o.name]};" for k, o in enumerate(outputs)
    )
    flags = " ".join(f"(f)[{k}] = (s).{printer.flags[c.name]};" for k, c in enumerate(channels))
    return (
        f'#include "{stem}.h"\n'
        f"#define NAME(x) {stem}_##x\n"
        f"#define SENSORS {len(channels)}\n"
        f"#define ACTIONS {len(outputs)}\n"
        f"#define TAKE(in, r) {take}\n"
        f"#define GIVE(out, a) {give}\n"
        f"#define FLAGS(s, f) {flags}\n"
    )


def build(
    subject: Subject,
    machine: Machine,
    folder: Path,
    extra: Sequence[str] = (),
    driver_only: Sequence[str] = (),
    driver: str = "driver.c",
) -> Path:
    """The driver with the controller; `extra` flags are for both, `driver_only` for the driver."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "glue.h").write_text(glue(subject), encoding="ascii")
    compiler = machine.compiler.command
    controller = folder / "controller.o"
    tools.succeed([compiler, *machine.flags, *extra, "-c", subject.source, "-o", controller])
    sources = [DRIVER / name for name in (driver, *machine.sources)]
    program = folder / "program"
    tools.succeed(
        [
            *(compiler, *machine.flags, *extra, "-std=gnu99", "-w", *driver_only),
            *("-I", str(folder), "-I", str(subject.folder), "-o", str(program)),
            *map(str, (*sources, controller)),
            *machine.libraries,
        ]
    )
    return program


def answers(
    program: Path,
    subject: Subject,
    machine: Machine,
    readings: NDArray[np.float64],
    extra_columns: int = 0,
    emulation: Sequence[str] = (),
) -> NDArray[np.float64]:
    """What the controller answers: (steps, actions + 1), the last column the status and flags.

    Raises `ToolFailed` where the program ends with an error or says anything.
    """
    folder = program.parent
    readings.astype(machine.number).tofile(folder / "readings")
    if machine.emulator is None:
        command: list[str | Path] = [program, "readings", "answers"]
    elif machine.emulator is tools.QEMU_ARM:
        command = [machine.emulator.command, *machine.emulation, *emulation, "-kernel", program]
    else:
        command = [machine.emulator.command, program, "readings", "answers"]
    tools.succeed(command, folder)
    columns = len(subject.controller.outputs) + 1 + extra_columns
    result = np.fromfile(folder / "answers", machine.number).reshape(-1, columns)
    for name in ("readings", "answers"):
        (folder / name).unlink()
    if len(result) != len(readings):
        raise tools.ToolFailed(f"{machine.name}: {len(result)} answers to {len(readings)}")
    return result.astype(np.float64)


def difference(ours: NDArray[np.float64], theirs: NDArray[np.float64]) -> str | None:
    """The first step at which any bit differs, in words."""
    differ = (ours.view(np.int64) != theirs.view(np.int64)).any(axis=1)
    if not differ.any():
        return None
    step = int(differ.argmax())
    return (
        f"{int(differ.sum())} of {len(differ)} steps differ; step {step}: "
        f"{ours[step].tolist()} and {theirs[step].tolist()}"
    )
