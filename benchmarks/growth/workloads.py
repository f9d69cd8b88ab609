"""Sketches, templates, histories and programs of any size, the same ones every time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pirlc.frontend import parse_sketch
from pirlc.ir.expansion import expand, only_derivation
from pirlc.ir.policy import Program, ProgramTemplate, Sketch
from pirlc.semantics.histories import HistorySet, histories_of
from pirlc.source import SourceText

STEPS = 200
"""Of a trajectory, as in most of Gymnasium's classic environments."""

Trajectory = tuple[NDArray[np.float64], NDArray[np.float64]]


def sketch(sensors: int, window: int, body: str, rules: str = "") -> Sketch:
    """One action over this many sensors s0, s1, ... with readings in [-1, 1]."""
    declared = "\n".join(f"sensor s{i} : [-1, 1] = {i}" for i in range(sensors))
    text = f"policy growth\n{declared}\nwindow {window}\naction A : [-1, 1] = {body}\n{rules}\n"
    return parse_sketch(SourceText("growth", text))


def only_template(of: Sketch) -> ProgramTemplate:
    derivation = only_derivation(of)
    assert derivation is not None
    return expand(of, derivation).template


def _sum(terms: list[str]) -> str:
    return " + ".join(terms)


def every_sensor(sensors: int, window: int) -> ProgramTemplate:
    """A guard, and on either side the sum and the newest reading of every sensor, with gains."""

    def law(side: str) -> str:
        return _sum(
            [
                f"?{side}sum{i} * fold(+, s{i}) + ?{side}new{i} * peek(s{i}, -1)"
                for i in range(sensors)
            ]
        )

    body = f"if ?offset + ?slope * peek(s0, -1) > 0 then {law('a')} else {law('b')}"
    return only_template(sketch(sensors, window, body))


def switched_pid(sensors: int, window: int) -> ProgramTemplate:
    """A guard on one sensor, and a PID law on another, each with parameters of its own.

    The program reads two sensors, the histories have them all: what a search tunes most often.
    """

    def pid(side: str) -> str:
        return (
            f"?{side}p * peek(s1, -1) + ?{side}i * fold(+, s1)"
            f" + ?{side}d * (peek(s1, -2) - peek(s1, -1))"
        )

    body = f"if ?offset + ?slope * peek(s0, -1) > 0 then {pid('a')} else {pid('b')}"
    return only_template(sketch(sensors, window, body))


def one_law(sensors: int, window: int) -> ProgramTemplate:
    """The sum and the two newest readings of one sensor, with gains: no guard, so least squares."""
    body = "?sum * fold(+, s1) + ?new * peek(s1, -1) + ?old * peek(s1, -2)"
    return only_template(sketch(sensors, window, body))


def nested(guards: int, sensors: int = 8, window: int = 5) -> ProgramTemplate:
    """A balanced tree of so many `if`s, a law of two gains at each leaf."""
    made = 0

    def tree(inner: int) -> str:
        nonlocal made
        here, made = made, made + 1
        if not inner:
            return f"?gain{here} * peek(s{here % sensors}, -1) + ?bias{here}"
        guard = f"?slope{here} * peek(s{here % sensors}, -1) > ?edge{here}"
        left = (inner - 1) // 2
        return f"if {guard} then {tree(left)} else {tree(inner - 1 - left)}"

    return only_template(sketch(sensors, window, tree(guards)))


def parameters(count: int, sensors: int = 8) -> ProgramTemplate:
    """One guard, with half of so many parameters in it and half in what it guards."""
    half = count // 2
    window = max(2, -(-half // sensors))

    def law(side: str) -> str:
        return _sum(
            [f"?{side}{i} * peek(s{i % sensors}, -{1 + i // sensors})" for i in range(half)]
        )

    return only_template(sketch(sensors, window, f"if {law('a')} > 0 then {law('b')} else 0"))


def laws_and_guards() -> Sketch:
    """A sketch with as many templates as one likes, as in the examples."""
    rules = """
rule Term(x) = ?k * peek(x, -1) | ?k * fold(+, x)
rule Law = Term(s0) | Term(s1) | Law + Law
rule Guard = Law > 0 | Guard and Guard
rule Switched = Law | if Guard then Switched else Switched
"""
    return sketch(4, 5, "Switched", rules)


def trajectories(histories: int, sensors: int) -> list[Trajectory]:
    generator = np.random.default_rng(0)
    lengths = [STEPS] * (histories // STEPS) + [histories % STEPS] * bool(histories % STEPS)
    return [
        (generator.uniform(-1, 1, (steps, sensors)), generator.uniform(-1, 1, (steps, 1)))
        for steps in lengths
    ]


def history_set(template: ProgramTemplate, histories: int) -> HistorySet:
    interface = template.interface
    return histories_of(interface, trajectories(histories, len(interface.sensors)))


def labels_for(histories: HistorySet) -> NDArray[np.float64]:
    """What an oracle might do there: it switches, saturates, and is not a program's function."""
    first = histories.element(histories.interface.sensors[0].name, -1)
    last = histories.element(histories.interface.sensors[-1].name, -2)
    wanted = np.sin(4.0 * first) + np.where(first > 0.2, 0.6, -0.4) * last
    return np.clip(wanted.astype(np.float64), -1.0, 1.0).reshape(-1, 1)


def values_of(template: ProgramTemplate) -> dict[str, float]:
    generator = np.random.default_rng(1)
    return {p.name: float(generator.normal()) for p in template.free}


def closed(template: ProgramTemplate) -> Program:
    return template.close(values_of(template))


@dataclass(frozen=True)
class ByHand:
    """Balances CartPole: an oracle that needs no training."""

    def actions(self, observations: NDArray[np.float64]) -> NDArray[np.float64]:
        law = observations @ np.array([0.3, 0.6, 6.0, 1.5])
        return (law > 0.0).astype(np.float64).reshape(-1, 1)

    def values(self, observations: NDArray[np.float64]) -> None:  # noqa: ARG002
        return

    def reset(self) -> None:
        pass

    def act(self, observation: NDArray[np.float64]) -> tuple[float, ...]:
        return tuple(self.actions(np.asarray(observation)[np.newaxis])[0].tolist())


CARTPOLE = """
policy cartpole
environment "CartPole-v1"
sensor Position        : [-2.4, 2.4]   = 0
sensor Velocity        : [-3, 3]       = 1
sensor Angle           : [-0.21, 0.21] = 2
sensor AngularVelocity : [-3.5, 3.5]   = 3
window 5
action Push : {0, 1} = if Law > 0 then 1 else 0
rule Term(x) = ?k * peek(x, -1) | ?k * fold(+, x)
rule Law = Term(Angle) | Law + Term(AngularVelocity) | Law + Term(Position)
"""
