"""Constants lose the digits that earn nothing, and of equals the shorter program wins."""

from __future__ import annotations

import numpy as np
import pytest

from pirlc.frontend import parse_sketch
from pirlc.ir.expansion import expand, only_derivation
from pirlc.ir.policy import Environment
from pirlc.search.candidate import Candidate, choose, within_noise
from pirlc.search.context import Search
from pirlc.search.journal import Budget, Journal
from pirlc.search.rounding import round_constants
from pirlc.search.settings import Settings
from pirlc.simulation.workers import ALONE
from pirlc.source import SourceText

LAW = """policy pole
environment "CartPole-v1"
sensor Position        : [-2.4, 2.4]   = 0
sensor Angle           : [-0.21, 0.21] = 2
sensor AngularVelocity : [-3.5, 3.5]   = 3
action Push : {0, 1} = if LAW > 0 then 1 else 0
"""
SHORT = "?(a in [-3.1, 3.1]) * peek(Angle, -1) + ?b * peek(AngularVelocity, -1)"
LONG = f"{SHORT} + ?c * peek(Position, -1)"


def candidate(law: str, values: dict[str, float]) -> Candidate:
    sketch = parse_sketch(SourceText("pole.pirl", LAW.replace("LAW", law)))
    derivations = only_derivation(sketch)
    assert derivations is not None
    named = tuple(sorted((f"Push_{name}", value) for name, value in values.items()))
    return Candidate(expand(sketch, derivations), named, 0.0)


def search_of(law: str) -> Search:
    sketch = parse_sketch(SourceText("pole.pirl", LAW.replace("LAW", law)))
    return Search(
        sketch,
        Environment("CartPole-v1"),
        Settings(episodes=5),
        Journal(None, Budget()),
        ALONE,
        lambda _: None,
        lambda _stage, _candidate: None,
    )


def test_digits_that_earn_nothing_go() -> None:
    rounded = round_constants(
        search_of(SHORT), candidate(SHORT, {"a": 2.98765432, "b": 1.012345678})
    )
    assert dict(rounded.values) == {"Push_a": 3.0, "Push_b": 1.0}
    assert rounded.mean == 500.0


def test_bounds_hold_after_rounding() -> None:
    rounded = round_constants(search_of(SHORT), candidate(SHORT, {"a": 3.0999, "b": 1.01}))
    assert dict(rounded.values)["Push_a"] <= 3.1


def test_digits_that_earn_something_stay() -> None:
    # One digit would leave a threshold of 0.149 rad, past which no pole is caught.
    law = "?a * peek(Angle, -1) + 0.3 * peek(AngularVelocity, -1) + ?b - 1.149"
    rounded = round_constants(search_of(law), candidate(law, {"a": 1.0, "b": 1.149}))
    assert dict(rounded.values)["Push_b"] == pytest.approx(1.149, abs=0.06)
    assert rounded.mean == 500.0


def with_returns(law: str, returns: list[float]) -> Candidate:
    values = {"a": 1.0, "b": 1.0} | ({"c": 1.0} if law == LONG else {})
    return candidate(law, values).with_returns(np.array(returns))


def test_the_shorter_wins_within_the_noise_only() -> None:
    short = with_returns(SHORT, [490.0, 510.0, 480.0, 500.0, 495.0])
    near = with_returns(LONG, [500.0, 500.0, 490.0, 495.0, 500.0])
    far = with_returns(LONG, [590.0, 610.0, 580.0, 600.0, 596.0])
    assert within_noise(short, near)
    assert choose([near, short]) is short
    assert not within_noise(short, far)
    assert choose([short, far]) is far
