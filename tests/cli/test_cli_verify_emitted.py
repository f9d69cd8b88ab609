"""`pirlc verify --emitted`."""

from __future__ import annotations

import re

from pirlc.backend import c_expressions
from tests.support.planted import plant


def test_both_precisions_are_compared(pirlc, here):
    outcome = pirlc("verify", "pole.pirl", "--emitted")
    assert (outcome.code, outcome.err) == (0, "")
    lines = [line for line in outcome.out.splitlines() if "emitted C" in line]
    assert [re.sub(r"\d+\.\d\d s", "0.07 s", line) for line in lines] == [
        "double: emitted C = program: proved (0.07 s)",
        "float: emitted C = program: proved (0.07 s)",
    ]
    data = pirlc("verify", "pole.pirl", "--emitted", "--json").data
    assert [finding["evidence"]["words"] for finding in data["emitted"]] == ["proved"] * 2
    assert pirlc("verify", "pole.pirl", "--json").data["emitted"] == []


def test_a_fault_is_told(pirlc, here, monkeypatch):
    plant(monkeypatch, c_expressions, "chosen", "{consequent.at(NEGATION)} : {last}", "0 : {last}")
    outcome = pirlc("verify", "pole.pirl", "--emitted")
    assert outcome.code == 1
    assert "double: emitted C = program: refuted" in outcome.out
    assert outcome.out.count("error[E0915]: the C emitted for pole (") == 2
    shown = pirlc("verify", "pole.pirl", "--emitted", "--json")
    assert (shown.code, shown.codes) == (1, ["E0915", "E0915"])
