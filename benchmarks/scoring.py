"""How fast program templates are scored: `python -m benchmarks.scoring`.

A program-history is one program evaluated on one history. Prints, for a PID program over a window
of 5 on one core, the raw results alone, and with them clipping and the distance to the oracle.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from pirlc.ir.operators import Operator
from pirlc.ir.policy import (
    ActionSpec,
    Continuous,
    FreeParameter,
    Interface,
    ProgramTemplate,
    Sensor,
)
from pirlc.ir.terms import Apply, Fold, Let, LocalRef, ParameterRef, Peek, SensorRef, Term
from pirlc.ir.types import Sequence
from pirlc.semantics.histories import HistorySet, histories_of
from pirlc.semantics.precision import Precision
from pirlc.semantics.vectorised import apply_actions, compile_plan, distance

WINDOW = 5
TRAJECTORY = 200


def pid() -> ProgramTemplate:
    """`let e = setpoint - h in kp*peek(e, -1) + ki*fold(+, e) + kd*(peek(h, -2) - peek(h, -1))`."""
    h = SensorRef("h", WINDOW)
    e = LocalRef("e", Sequence(WINDOW))

    def times(name: str, term: Term) -> Term:
        return Apply(Operator.MULTIPLY, (ParameterRef(name), term))

    proportional = times("kp", Peek(e, -1))
    integral = times("ki", Fold(Operator.ADD, e))
    derivative = times("kd", Apply(Operator.SUBTRACT, (Peek(h, -2), Peek(h, -1))))
    total = Apply(Operator.ADD, (Apply(Operator.ADD, (proportional, integral)), derivative))
    body = Let("e", Apply(Operator.SUBTRACT, (ParameterRef("setpoint"), h)), total)
    return ProgramTemplate(
        interface=Interface(
            name="pid",
            environment=None,
            sensors=(Sensor("h", -1.0, 1.0, 0),),
            actions=(ActionSpec("u", Continuous(-2.0, 2.0), 0),),
            window=WINDOW,
        ),
        parameters=tuple(
            FreeParameter(name, -100.0, 100.0) for name in ("setpoint", "kp", "ki", "kd")
        ),
        bodies=(body,),
    )


def random_histories(template: ProgramTemplate, count: int, precision: Precision) -> HistorySet:
    generator = np.random.default_rng(0)
    return histories_of(
        template.interface,
        [
            (generator.uniform(-1, 1, (TRAJECTORY, 1)), generator.uniform(-2, 2, (TRAJECTORY, 1)))
            for _ in range(count // TRAJECTORY)
        ],
        precision,
    )


def per_second(work: Callable[[], object], items: int, seconds: float = 1.0) -> float:
    """The best rate of several rounds, in items per second."""
    work()
    started, best = time.perf_counter(), float("inf")
    while time.perf_counter() - started < seconds:
        before = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - before)
    return items / best


def main() -> None:
    template = pid()
    values = {"setpoint": 0.1, "kp": 2.0, "ki": 0.5, "kd": 7.0}
    print("program-histories/s, one core, PID over a window of 5")
    for precision in Precision:
        for count in (5_000, 20_000, 200_000):
            histories = random_histories(template, count, precision)
            sets = {"": histories}
            if count == 5_000:
                sets[" (gathered)"] = histories.select(np.arange(len(histories)))
            for kind, chosen in sets.items():
                labels = np.random.default_rng(1).uniform(-2, 2, (len(chosen), 1))
                plan = compile_plan(template, precision, chosen.layout)

                def raw(plan=plan, chosen=chosen):  # type: ignore[no-untyped-def]
                    return plan.run(values, chosen)

                def scored(raw=raw, chosen=chosen, labels=labels):  # type: ignore[no-untyped-def]
                    applied = apply_actions(raw(), chosen)
                    return distance(applied.actions, labels, chosen.interface.actions)

                print(
                    f"  {precision.value}, {len(chosen)} histories{kind}: "
                    f"raw {per_second(raw, len(chosen)):.2e}, "
                    f"with distance {per_second(scored, len(chosen)):.2e} program-histories/s"
                )


if __name__ == "__main__":
    main()
