"""What the tests of proofs share: programs from text, and replays that trust nothing but `step`."""

from __future__ import annotations

import math
from dataclasses import replace

from pirlc.frontend import check
from pirlc.ir.evidence import Kind
from pirlc.ir.expansion import close
from pirlc.ir.policy import Program
from pirlc.semantics.interpreter import State, initial_state, step
from pirlc.semantics.precision import BINARY64
from pirlc.source import SourceText
from pirlc.verify.properties.prove import prove

HEAD = """policy example
sensor x : [-1, 1] = 0
sensor y : [0.5, 3] = 1
window 3
"""


def program_of(text: str) -> Program:
    sketch, _ = check(SourceText("example.pirl", text))
    program = close(sketch)
    assert program is not None
    return program


def proved(action: str, claim: str, head: str = HEAD):
    """The finding of one property of one action A."""
    text = f"{head}action A : [-2, 2] safe 0 = {action}\nproperty p {claim}\n"
    program = program_of(text)
    (finding,) = prove(program)
    if finding.counterexample is not None:
        precision_of_replay(program, finding.counterexample)
    return finding


def kinds(finding) -> tuple[str, str, str]:
    return tuple(e.kind.value for e in (finding.evidence, finding.binary64, finding.binary32))


PROVED = (Kind.PROVED.value,) * 3
REFUTED = (Kind.REFUTED.value,) * 3


def precision_of_replay(program: Program, replay, precision=BINARY64) -> None:
    """Replays by hand: the windows warmed by ordinary steps, then `previous` put in place."""
    interface = program.interface
    window, steps = interface.window, len(replay.steps)
    readings = replay.history.readings
    length = 1 + max(sensor.index for sensor in interface.sensors)
    count = max(map(len, readings.values()))
    assert count == window + steps - 1
    for sensor in interface.sensors:
        for reading in readings[sensor.name]:
            assert sensor.lower - 1e-6 <= reading <= sensor.upper + 1e-6
    state = initial_state(program, precision)

    def observation(place: int) -> list[float]:
        taken = [0.0] * length
        for sensor in interface.sensors:
            taken[sensor.index] = readings[sensor.name][min(place, count - 1)]
        return taken

    for place in range(window - 1 + interface.latency):
        state = step(program, state, observation(place), precision).state
    previous = tuple(replay.history.previous[spec.name] for spec in interface.actions)
    state = State(state.sensors, previous)
    for number, shown in enumerate(replay.steps):
        place = window - 1 + interface.latency + number
        result = step(program, state, observation(place), precision)
        state = replace(result.state)
        for spec, raw, action in zip(interface.actions, result.raw, result.actions, strict=True):
            assert _same(raw, shown.raw[spec.name]), (raw, shown.raw)
            assert _same(action, shown.applied[spec.name])


def _same(a: float, b: float) -> bool:
    return a == b or (math.isnan(a) and math.isnan(b))
