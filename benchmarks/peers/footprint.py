"""What a controller in C takes: bytes of code, and nanoseconds a step.

The same for every method: `cc -std=c99 -O2`, the controller in an object of its own, and a loop
over recorded observations that calls it through one function that hands over plain arrays.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pirlc.backend.c import CPrinter, c_files
from pirlc.backend.files import Provenance
from pirlc.backend.names import file_stem
from pirlc.backend.policies import python_policy
from pirlc.backend.toolchain import FLAGS, find_compiler
from pirlc.ir.policy import Program
from pirlc.ir.printer import program_text
from pirlc.lower import lower
from pirlc.simulation.rollout import run_episode
from pirlc.simulation.workers import shared_simulator

Array = NDArray[np.float64]

STEPS, ROUNDS = 5_000, 60
RECORDED_SEED = 900_000
"""The first of the episodes that observations are recorded in."""
_DRIVER = Path(__file__).parent / "timed.c"


@dataclass(frozen=True)
class CSource:
    """A controller's C: `files` by name, of which `unit` is compiled.

    `adapter` is C that defines ``peer_reset`` and ``peer_step`` with the controller's own
    functions, `roots`: what it calls; of the unit, only what these need is counted.
    """

    files: Mapping[str, str]
    unit: str
    adapter: str
    roots: tuple[str, ...]
    include: tuple[Path, ...] = ()


@dataclass(frozen=True)
class Footprint:
    """`code_bytes`: machine code and constants, without libm. `actions`: (N, k), what it did."""

    code_bytes: int
    step_nanoseconds: float
    actions: Array


def footprint(source: CSource, observations: Array, components: int) -> Footprint:
    """Build a controller and run it over observations (N, d). Raises SystemExit with the words of
    a compiler that refuses."""
    compiler = find_compiler().command
    with tempfile.TemporaryDirectory(prefix="pirlc-footprint-") as place:
        folder = Path(place)
        for name, text in source.files.items():
            (folder / name).write_text(text, encoding="utf-8")
        (folder / "peer_adapter.c").write_text(source.adapter, encoding="utf-8")
        included = [word for path in (folder, *source.include) for word in ("-I", str(path))]
        sections = ("-ffunction-sections", "-fdata-sections", *included)
        _run(folder, *compiler, *FLAGS, *sections, "-c", source.unit, "-o", "unit.o")
        roots = [f"-Wl,-u,{root}" for root in source.roots]
        _run(folder, *compiler, "-r", "-nostdlib", "-Wl,--gc-sections", *roots, "unit.o", "-o",
             "needed.o")  # fmt: skip
        sizes = (f"-DSTEPS={len(observations)}", f"-DSENSORS={observations.shape[1]}")
        driver = (*sizes, f"-DACTIONS={components}", f"-DROUNDS={ROUNDS}", str(_DRIVER))
        _run(folder, *compiler, *FLAGS, *included, *driver, "peer_adapter.c", "unit.o", "-lm",
             "-o", "timed")  # fmt: skip
        np.ascontiguousarray(observations, np.float64).tofile(folder / "observations")
        taken = _run(folder, "./timed", "observations", "actions")
        actions = np.fromfile(folder / "actions").reshape(-1, components)
        return Footprint(_code_bytes(folder), float(taken), actions)


def _run(folder: Path, *command: str) -> str:
    answer = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if answer.returncode != 0:
        raise SystemExit(f"{' '.join(command)}:\n{answer.stderr or answer.stdout}")
    return answer.stdout


def _code_bytes(folder: Path) -> int:
    """Of the sections with code and constants; `size -A` prints name, size, address."""
    total = 0
    for line in _run(folder, "size", "-A", "-d", "needed.o").splitlines():
        words = line.split()
        if len(words) == 3 and words[0].startswith((".text", ".rodata", ".data")):
            total += int(words[1])
    return total


def c_source(program: Program) -> CSource:
    """A program as pirlc emits it."""
    controller = lower(program)
    stem = file_stem(controller.name)
    files = {
        file.path.name: file.text
        for file in c_files(controller, "double", Provenance(program_text(program)))
    }
    printer = CPrinter(controller, "double")
    take = "".join(
        f"    in.{printer.inputs[c.name]} = r[{c.index}];\n" for c in controller.channels
    )
    outputs = sorted(controller.outputs, key=lambda output: output.component)
    give = "".join(
        f"    a[{k}] = (double)out.{printer.actions[o.name]};\n" for k, o in enumerate(outputs)
    )
    adapter = (
        f'#include "{stem}.h"\n'
        "void peer_reset(void);\nvoid peer_step(const double *r, double *a);\n"
        f"static {stem}_state state;\n"
        f"void peer_reset(void)\n{{\n    {stem}_reset(&state);\n}}\n"
        "void peer_step(const double *r, double *a)\n{\n"
        f"    {stem}_observation in;\n    {stem}_action out;\n{take or '    in.unused = 0u;'}"
        f"    (void)r;\n    (void){stem}_step(&{stem}_default_params, &state, &in, &out);\n"
        f"{give}}}\n"
    )
    roots = tuple(f"{stem}_{name}" for name in ("reset", "step", "default_params"))
    return CSource(files, f"{stem}.c", adapter, roots)


def measure_program(program: Program, observations: Array | None = None) -> tuple[int, float]:
    """The bytes of a program's emitted C (binary64), and the nanoseconds of its step.

    `observations` (N, d) default to those of the program's own episodes in its environment; for one
    that is not Gymnasium's own, to random readings within the sensors' ranges.
    """
    given = recorded(program) if observations is None else observations
    found = footprint(c_source(program), given, len(program.interface.actions))
    return found.code_bytes, found.step_nanoseconds


def recorded(program: Program, steps: int = STEPS) -> Array:
    """The observations (steps, d) of a program's own episodes."""
    environment = program.interface.environment
    if environment is None or "/" in environment.id or ":" in environment.id:
        return _random(program, steps)
    simulator, policy = shared_simulator(environment), python_policy(program)
    pieces: list[Array] = []
    for seed in count(RECORDED_SEED):
        pieces.append(run_episode(simulator, policy, seed).observations)
        if sum(map(len, pieces)) >= steps:
            break
    return np.concatenate(pieces)[:steps]


def _random(program: Program, steps: int) -> Array:
    sensors: Sequence[tuple[int, float, float]] = [
        (s.index, s.lower, s.upper) for s in program.interface.sensors
    ]
    width = max((index for index, _, _ in sensors), default=0) + 1
    rows = np.zeros((steps, width))
    generator = np.random.default_rng(0)
    for index, least, most in sensors:
        rows[:, index] = generator.uniform(least, most, steps)
    return rows
