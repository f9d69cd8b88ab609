"""How fast races are, and that nothing grows.

    python -m benchmarks.torcs.environment [--repeats 7]

On Aalborg, on one core: native races of the paper's printed program, with and without the range
finders' rays; steps in lock-step through Gymnasium; resets. Medians, and the least and the most of
the repeats. Then 1,000 resets, each followed by some steps; before and after them memory,
descriptors and processes, of Python and of the simulator. And whether the program gives the same
race, frame by frame and bit by bit, as native code in TORCS and interpreted in lock-step.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.torcs import paper
from benchmarks.torcs.drivers import PRINTED, CompiledProgram, compiled, read_program
from benchmarks.torcs.processes import descriptors, group, resident
from benchmarks.torcs.telling import number, parser_of, table, tell
from pirlc.ir.policy import Environment
from pirlc.semantics.policies import InterpretedPolicy
from pirlc.simulation.environments import make
from pirlc.simulation.torcs.environment import Torcs

STEPS = 5_000
RESETS = 1_000
STEPS_AFTER_A_RESET = 10


@dataclass(frozen=True)
class Measured:
    """Of repeats."""

    median: float
    least: float
    most: float


@dataclass(frozen=True)
class Held:
    """What Python and the simulator hold: resident bytes, open descriptors, processes."""

    python: int
    torcs: int
    descriptors: int
    torcs_descriptors: int
    processes: int


def repeated(measure: Callable[[], float], repeats: int) -> Measured:
    """After one time that does not count."""
    measure()
    values = [measure() for _ in range(repeats)]
    return Measured(statistics.median(values), min(values), max(values))


@contextmanager
def one_core() -> Iterator[None]:
    """Keeps this process, and what it starts, on one core."""
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(allowed)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)


def torcs(laps: int = 3) -> Torcs:
    arguments = (("track", paper.AALBORG), ("laps", laps), ("termination", "none"))
    made = make(Environment("pirlc/Torcs-v0", arguments)).unwrapped
    assert isinstance(made, Torcs)
    return made


def native(environment: Torcs, program: CompiledProgram, beams: bool) -> float:
    """Seconds raced in a second."""
    start = time.perf_counter()
    trace = environment.race(program.library, None, 0, None, beams)
    return float(trace["time"][-1]) / (time.perf_counter() - start)


def lock_step(environment: Torcs) -> float:
    """Control steps in a second. The driver takes no time: it drives straight on, slowly."""
    action = np.array([0.0, 0.05])
    environment.reset(seed=0)
    start = time.perf_counter()
    for _ in range(STEPS):
        environment.step(action)
    return STEPS / (time.perf_counter() - start)


def reset(environment: Torcs) -> float:
    """Seconds, in the middle of a race."""
    environment.step(np.array([0.0, 0.5]))
    start = time.perf_counter()
    environment.reset(seed=0)
    return time.perf_counter() - start


def held(environment: Torcs) -> Held:
    process = environment._ready()
    return Held(
        resident(os.getpid()),
        resident(process.pid),
        descriptors(os.getpid()),
        descriptors(process.pid),
        len(group(process.pid)),
    )


def grown(environment: Torcs, resets: int) -> tuple[Held, Held]:
    """Before and after resets; some go before, so that all that is made once is there."""

    def some(count: int) -> None:
        action = np.array([0.0, 0.5])
        for seed in range(count):
            environment.reset(seed=seed)
            for _ in range(STEPS_AFTER_A_RESET):
                environment.step(action)

    some(max(1, resets // 10))
    before = held(environment)
    some(resets)
    return before, held(environment)


def same_race(environment: Torcs, file: Path, program: CompiledProgram) -> tuple[bool, int]:
    """Whether the interpreter in lock-step has the native race's readings, actions and rewards,
    bit for bit; and the steps."""
    trace = environment.race(program.library, None, 0, None)
    policy = InterpretedPolicy(read_program(file))
    policy.reset()
    readings, _ = environment.reset(seed=0)
    over, step = False, 0
    while not over and step < len(trace.rewards):
        action = policy.act(readings)
        same = np.array_equal(readings, trace.observations[step])
        same = same and action == tuple(trace.actions[step, : len(action)])
        readings, reward, over, _, _ = environment.step(np.array(action))
        if not same or reward != trace.rewards[step]:
            return False, step
        step += 1
    return over and step == len(trace.rewards), step


def main(words: list[str] | None = None) -> None:
    parser = parser_of("benchmarks.torcs.environment", __doc__)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--resets", type=int, default=RESETS)
    chosen = parser.parse_args(words)
    file = PRINTED / f"{paper.AALBORG}.pirl"
    with one_core(), TemporaryDirectory() as place, closing(torcs()) as environment:
        program = compiled(file, Path(place))
        environment.reset(seed=0)
        of = chosen.repeats
        measured = {
            "native race, times real time": repeated(
                lambda: native(environment, program, beams=False), of
            ),
            "the same with range finders": repeated(
                lambda: native(environment, program, beams=True), of
            ),
            "lock-step, steps per second": repeated(lambda: lock_step(environment), of),
            "reset, ms": repeated(lambda: 1e3 * reset(environment), 20 * of),
        }
        before, after = grown(environment, chosen.resets)
        same, steps = same_race(environment, file, program)
    bars = ((">= 300", 0), ("", 0), (">= 5,000", 0), ("<= 100", 2))
    rows = [
        [name, *(number(v, digits) for v in (m.median, m.least, m.most)), bar]
        for (name, m), (bar, digits) in zip(measured.items(), bars, strict=True)
    ]
    growth = [
        [name, *(number(getattr(at, key) / unit, digits) for at in (before, after))]
        for name, key, unit, digits in (
            ("memory of Python, MB", "python", 1e6, 1),
            ("memory of TORCS, MB", "torcs", 1e6, 1),
            ("descriptors of Python", "descriptors", 1, 0),
            ("descriptors of TORCS", "torcs_descriptors", 1, 0),
            ("processes of TORCS", "processes", 1, 0),
        )
    ]
    agreement = (
        f"Native and interpreted in lock-step: the same race, {steps:,} steps bit for bit.\n"
        if same
        else f"Native and interpreted in lock-step differ after {steps:,} steps.\n"
    )
    text = "\n".join(
        [
            table(["on Aalborg, one core", "median", "least", "most", "wanted"], rows),
            table(["", f"before {chosen.resets:,} resets", "after"], growth),
            agreement,
        ]
    )
    data = {
        "measured": {name: vars(m) for name, m in measured.items()},
        "before": vars(before),
        "after": vars(after),
        "resets": chosen.resets,
        "same_race": same,
        "steps": steps,
    }
    tell("environment", text, data, chosen.output)


if __name__ == "__main__":
    main()
