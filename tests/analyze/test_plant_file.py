"""Plants that users give: matrices or transfer functions, and what is wrong with others."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import scipy.signal

from pirlc.analyze.analysis import analyze
from pirlc.analyze.plant_file import read_plant
from pirlc.diagnostics import PirlcError
from pirlc.source import SourceText
from tests.support.analysis import program_of

PROGRAM = program_of(
    "policy p\nsensor RPM : [0, 1] = 0\nsensor Speed : [0, 1] = 1\nsample_time 0.02\n"
    "action Accel : [0, 1] = 1 - peek(RPM, -1) - peek(Speed, -1)\n"
)
GIVEN = """inputs = ["Accel"]
outputs = ["RPM"]
a = [[0.98]]
b = [[0.01]]
c = [[1.0]]
"""
CHANNEL = """[[channels]]
input = "Accel"
output = "RPM"
num = [0.01]
den = [1.0, -0.98]
"""


def _read(text):
    return read_plant(SourceText("plant.toml", text), PROGRAM)


def test_matrices():
    plant = _read(GIVEN + "[operating]\nRPM = 0.5\n")
    assert (plant.a, plant.b, plant.c, plant.d) == (((0.98,),), ((0.01,),), ((1.0,),), ((0.0,),))
    assert (plant.inputs, plant.outputs) == (("Accel",), ("RPM",))
    assert (plant.sample_time, plant.operating) == (0.02, {"RPM": 0.5})


def test_channels_are_their_transfer_functions():
    text = CHANNEL + CHANNEL.replace("RPM", "Speed").replace("[0.01]", "[0, 0.5, -0.25]").replace(
        "[1.0, -0.98]", "[2.0, -3.0, 1.25]"
    )
    plant = _read(text)
    a, b, c = (np.array(matrix) for matrix in (plant.a, plant.b, plant.c))
    assert a.shape == (3, 3)
    for z in (0.3 + 0.4j, -1.0, 2.0):
        answer = (c @ np.linalg.solve(z * np.eye(3) - a, b)).reshape(-1)
        assert answer[0] == pytest.approx(0.01 / (z - 0.98))
        assert answer[1] == pytest.approx((0.5 * z - 0.25) / (2 * z * z - 3 * z + 1.25))


def test_json_is_read_too():
    data = {"inputs": ["Accel"], "outputs": ["RPM"], "a": [[0.98]], "b": [[0.01]], "c": [[1]]}
    assert _read(json.dumps(data)) == _read(GIVEN)


def test_a_continuous_plant_is_sampled_with_a_hold():
    """1 / (2 s + 1)."""
    text = "continuous = true\n" + CHANNEL.replace("[0.01]", "[1]").replace(
        "[1.0, -0.98]", "[2, 1]"
    )
    plant = _read(text)
    pole = math.exp(-0.01)
    assert plant.a[0][0] == pytest.approx(pole)
    assert plant.c[0][0] * plant.b[0][0] == pytest.approx(1 - pole)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("inputs = [", None),
        (GIVEN.replace("a =", "q ="), "`q` means nothing here"),
        (GIVEN.replace("inputs", "input"), "`input` means nothing here; did you mean `inputs`?"),
        (GIVEN.replace("a = [[0.98]]\n", ""), "`a` is missing (or `channels`)"),
        (
            GIVEN.replace("[[0.01]]", "[[0.01, 0.02]]"),
            "`b` is 1 by 2; with 1 states, 1 inputs and 1 outputs it would be 1 by 1",
        ),
        (GIVEN.replace("0.98", "nan"), "`a` is not finite"),
        (GIVEN.replace("0.98", '"x"'), "`a` is no number"),
        (GIVEN.replace("[[0.98]]", "[]"), "`a` is not a list of 1 to 60 rows"),
        (GIVEN.replace("[[0.98]]", "[[1, 0], [1]]"), "the rows of `a` differ in length"),
        (GIVEN.replace('["RPM"]', '["RPM", "RPM"]').replace("[[1.0]]", "[[1.0], [1.0]]"),
         "an output is named twice"),
        (CHANNEL.replace("[0.01]", "[1, 2, 3]"),
         "`channels[0].num` is of a higher degree than `den`"),
        (CHANNEL.replace("den", "dem"),
         "`channels[0].dem` means nothing here; did you mean `den`?"),
        ("sample_time = 0\n" + GIVEN, "`sample_time` is not above 0"),
        ("continuous = 1\n" + GIVEN, "`continuous` is not true or false"),
    ],
)  # fmt: skip
def test_e0920(text, reason):
    with pytest.raises(PirlcError) as caught:
        _read(text)
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.code == "E0920"
    if reason is None:
        assert diagnostic.message.startswith(
            "plant.toml describes no plant: it is neither TOML nor JSON ("
        )
    else:
        assert diagnostic.message == f"plant.toml describes no plant: {reason}"


@pytest.mark.parametrize(
    ("text", "code", "message"),
    [
        (GIVEN.replace('["Accel"]', '["accel"]'), "E0922",
         "plant.toml: the program has no action 'accel'"),
        (GIVEN.replace('["RPM"]', '["Rpm"]'), "E0922",
         "plant.toml: the program has no sensor 'Rpm'"),
        (GIVEN + "[operating]\nx = 1\n", "E0922",
         "plant.toml: the program has no sensor or action 'x'"),
        (GIVEN + "d = [[0.5]]\n", "E0923", "plant.toml: RPM answers Accel in the same step"),
        (CHANNEL.replace("[0.01]", "[0.01, 0]"), "E0923",
         "plant.toml: RPM answers Accel in the same step"),
        ("sample_time = 0.1\n" + GIVEN, "E0926",
         "plant.toml is sampled every 0.1 s, the program every 0.02 s"),
    ],
)  # fmt: skip
def test_other_mistakes(text, code, message):
    with pytest.raises(PirlcError) as caught:
        _read(text)
    (diagnostic,) = caught.value.diagnostics
    assert (diagnostic.code, diagnostic.message) == (code, message)


@pytest.mark.parametrize("sampled", [False, True])
def test_a_fast_sampled_lag_of_third_order(sampled):
    """1 / (s + 1)^3 bears a gain of 8, where it swings at sqrt(3) rad/s; at 1 kHz nearly the same.

    Its poles in z are within 1e-3 of 1: in powers of z the coefficients cancel to a billionth.
    """
    text = (
        "policy p\nsensor y : [-9, 9] = 0\nsample_time 0.001\n"
        "action u : [-9, 9] safe 0 = 0.5 * peek(0 - y, -1)\n"
    )
    program = program_of(text)
    num, den = [1.0], np.poly([-1.0, -1.0, -1.0])
    if sampled:
        pole = math.exp(-0.001)
        matrix = scipy.signal.cont2discrete((num, den), 0.001)
        num, den = matrix[0][0][1:].tolist(), np.poly([pole] * 3)
    channel = {"input": "u", "output": "y", "num": list(num), "den": list(den)}
    data = {"channels": [channel], "continuous": not sampled}
    plant = read_plant(SourceText("plant.json", json.dumps(data)), program)
    (loop,) = analyze(program, plant).loops
    # Half the gain, and a hold of half a step.
    assert loop.margins.gain_up == pytest.approx(16.0, rel=4e-3)
    assert loop.margins.gain_up_frequency == pytest.approx(math.sqrt(3), rel=2e-3)
    assert max(check.difference for check in loop.checks) < 1e-6
