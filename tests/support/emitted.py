"""Runs many programs through the interpreter, emitted Python and emitted C, and compares.

All C of a batch is one translation unit and one shared library, which saves a compiler start for
each program.
"""

from __future__ import annotations

import ctypes
import random
import subprocess
import types
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirlc.backend.c import c_files
from pirlc.backend.files import Provenance
from pirlc.backend.numbers import RealType
from pirlc.backend.python import python_text
from pirlc.backend.toolchain import FLAGS, CController, bridge_text, find_compiler
from pirlc.ir.controller import Controller
from pirlc.ir.policy import Choice, Program
from pirlc.lower import lower
from pirlc.semantics.interpreter import initial_state, step
from pirlc.semantics.precision import Precision
from tests.support.observations import random_observations
from tests.support.programs import Kinds, random_program, renamed

REAL: dict[Precision, RealType] = {Precision.BINARY64: "double", Precision.BINARY32: "float"}

BRIDGED = ("state_size", "default_params", "reset", "flags", "step", "series")

SERIES = """
void bridge_series(const double *values, void *s, unsigned long steps, unsigned long width,
                   unsigned long outputs, unsigned long sensors, const double *observations,
                   double *actions, unsigned *statuses, unsigned char *flags)
{
    unsigned long i;
    for (i = 0; i < steps; i++) {
        statuses[i] = bridge_step(values, s, observations + i * width, actions + i * outputs);
        bridge_flags(s, flags + i * sensors);
    }
}
"""


@dataclass(frozen=True)
class Trace:
    """One run: actions (T, k) in component order, status (T,), sensor flags (T, sensors)."""

    actions: NDArray[np.float64]
    status: NDArray[np.int64]
    flags: NDArray[np.int64]


@dataclass(frozen=True)
class Case:
    """A program in one precision, with a name that no other case of the batch has."""

    program: Program
    precision: Precision
    observations: tuple[NDArray[np.float64], ...]
    """The runs, each from a reset on."""

    @property
    def steps(self) -> int:
        return sum(map(len, self.observations))


def random_case(
    rng: random.Random, name: str, precision: Precision, runs: Sequence[int], kinds: Kinds
) -> Case:
    program = renamed(random_program(rng, kinds), name)
    observations = tuple(random_observations(rng, program.interface, steps) for steps in runs)
    return Case(program, precision, observations)


def interpreted(case: Case) -> list[Trace]:
    actions = case.program.interface.actions
    order = sorted(range(len(actions)), key=lambda i: actions[i].component)
    traces = []
    for observations in case.observations:
        state = initial_state(case.program, case.precision)
        results = []
        for observation in observations.tolist():
            result = step(case.program, state, observation, case.precision)
            state = result.state
            results.append(result)
        traces.append(
            Trace(
                np.array([[r.actions[i] for i in order] for r in results], dtype=np.float64),
                np.array([r.status for r in results], dtype=np.int64),
                np.array([r.flags for r in results], dtype=np.int64),
            )
        )
    return traces


def run_python(case: Case, controller: Controller) -> list[Trace]:
    module: dict[str, Any] = {"__name__": "controller"}
    text = python_text(controller, REAL[case.precision], Provenance("random"))
    exec(compile(text, "<controller>", "exec"), module)
    instance = module["Controller"]()
    sensors = [sensor.name for sensor in case.program.interface.sensors]
    known = instance.sensor_status().keys()
    traces = []
    for observations in case.observations:
        instance.reset()
        actions, status, flags = [], [], []
        for observation in observations.tolist():
            action = instance.step(observation)
            actions.append(action if isinstance(action, tuple) else (action,))
            status.append(instance.status)
            after = instance.sensor_status()
            flags.append([after[name] for name in sensors if name in known])
        traces.append(
            Trace(
                np.array(actions, dtype=np.float64),
                np.array(status, dtype=np.int64),
                np.array(flags, dtype=np.int64),
            )
        )
    return traces


class Library:
    """The emitted C of many controllers, compiled together.

    Python's `ctypes` finds each controller's functions by a prefix; `of` gives them the plain names
    that `CController` looks for.
    """

    def __init__(
        self,
        controllers: Sequence[tuple[Controller, Precision]],
        folder: Path,
        flags: Sequence[str] = FLAGS,
    ) -> None:
        parts = []
        for controller, precision in controllers:
            stem = controller.name
            place = folder / stem
            place.mkdir()
            for file in c_files(controller, REAL[precision], Provenance("random")):
                (place / file.path).write_text(file.text)
            (place / "bridge.c").write_text(bridge_text(controller, stem))
            names = [f"#define bridge_{name} {stem}_bridge_{name}" for name in BRIDGED]
            forget = [f"#undef bridge_{name}" for name in BRIDGED]
            parts += [*names, f'#include "{stem}/bridge.c"', SERIES, *forget]
        source = folder / "all.c"
        source.write_text("\n".join(parts) + "\n")
        library = folder / "all.so"
        compiler = find_compiler().command
        command = [*compiler, *flags, "-fPIC", "-shared", "-o", str(library), str(source), "-lm"]
        subprocess.run(command, check=True)
        self._library = ctypes.CDLL(str(library))

    def of(self, controller: Controller) -> Any:
        return types.SimpleNamespace(
            **{
                f"bridge_{name}": getattr(self._library, f"{controller.name}_bridge_{name}")
                for name in BRIDGED
            }
        )


def run_c(case: Case, controller: Controller, library: Library) -> list[Trace]:
    functions = library.of(controller)
    instance = CController(functions, controller, REAL[case.precision])
    outputs, sensors = len(controller.outputs), len(controller.channels)
    traces = []
    for observations in case.observations:
        instance.reset()
        steps, width = observations.shape
        actions = np.zeros((steps, outputs))
        status = np.zeros(steps, np.uintc)
        flags = np.zeros((steps, sensors), np.uint8)
        rows = np.ascontiguousarray(observations)
        functions.bridge_series(
            instance._params,
            instance._state,
            *(ctypes.c_ulong(n) for n in (steps, width, outputs, sensors)),
            *(array.ctypes.data_as(ctypes.c_void_p) for array in (rows, actions, status, flags)),
        )
        traces.append(Trace(actions, status.astype(np.int64), flags.astype(np.int64)))
    return traces


def differences(ours: list[Trace], theirs: list[Trace]) -> int:
    """The steps at which two evaluators differ in any bit of an action, a status or a flag.

    Actions are never NaN.
    """
    count = 0
    for a, b in zip(ours, theirs, strict=True):
        assert not np.isnan(a.actions).any()
        differ = (a.actions.view(np.int64) != b.actions.view(np.int64)).any(axis=1)
        differ |= a.status != b.status
        differ |= (a.flags != b.flags).any(axis=1)
        count += int(differ.sum())
    return count


@dataclass
class Tally:
    """What a bulk comparison went through, so that a test can insist on its breadth."""

    steps: int = 0
    mismatches: int = 0
    missing: int = 0
    out_of_range: int = 0
    safe: int = 0
    moving: int = 0
    """Steps whose actions differ from those of the step before."""
    programs: int = 0
    discrete: int = 0

    def add(self, case: Case, traces: list[Trace]) -> None:
        self.programs += 1
        self.discrete += any(
            isinstance(action.domain, Choice) for action in case.program.interface.actions
        )
        for trace in traces:
            self.steps += len(trace.status)
            self.missing += int((trace.status & 1 != 0).sum())
            self.out_of_range += int((trace.status & 2 != 0).sum())
            self.safe += int((trace.status & 4 != 0).sum())
            self.moving += int((trace.actions[1:] != trace.actions[:-1]).any(axis=1).sum())


def compare_all(cases: Sequence[Case], folder: Path, flags: Sequence[str] = FLAGS) -> Tally:
    """Runs every case three ways; asserts that nothing differs, naming the first case that does."""
    controllers = [lower(case.program) for case in cases]
    library = Library(
        [(c, case.precision) for c, case in zip(controllers, cases, strict=True)], folder, flags
    )
    tally = Tally()
    for case, controller in zip(cases, controllers, strict=True):
        expected = interpreted(case)
        tally.add(case, expected)
        for kind, traces in (
            ("Python", run_python(case, controller)),
            ("C", run_c(case, controller, library)),
        ):
            mismatches = differences(expected, traces)
            tally.mismatches += mismatches
            assert not mismatches, (
                f"emitted {kind} differs from the interpreter at {mismatches} steps of "
                f"{case.program.interface.name} in {case.precision.value}"
            )
    return tally
