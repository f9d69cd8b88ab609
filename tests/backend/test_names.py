"""Names reach emitted code only as identifiers that mean nothing else there."""

from __future__ import annotations

import builtins
import keyword
import math
import re
import subprocess
import sys
from dataclasses import replace

import pytest

from pirlc.backend.emit import emit
from pirlc.backend.names import (
    C_RESERVED,
    Identifiers,
    c_members,
    checked,
    file_stem,
    python_locals,
)
from pirlc.backend.policies import python_policy
from pirlc.backend.text import comment_lines
from pirlc.diagnostics import PirlcError
from pirlc.ir.operators import Operator
from pirlc.ir.policy import ActionSpec, Continuous, FixedParameter, Hold, Interface, Program, Sensor
from pirlc.ir.terms import Apply, Fold, If, ParameterRef, Peek, PreviousAction, SensorRef
from pirlc.ir.types import Real
from tests.backend.helpers import COMPILERS, FORMS, Run, compiled, load_program

HOSTILE = [
    'x; system("rm")',
    "x*/",
    "ä",
    "a\nb",
    "a b",
    "1a",
    "",
    "a-b",
    "x\\",
    "ｘ",
    "x\0",
    "a\n",
]


@pytest.mark.parametrize("name", HOSTILE)
def test_what_is_no_ascii_identifier_is_refused(name):
    with pytest.raises(PirlcError) as caught:
        checked(name)
    diagnostic = caught.value.diagnostics[0]
    assert diagnostic.code == "E0801"
    assert diagnostic.message == f"the name {name!a} cannot be written in emitted code"


def program_with(policy="p", sensor="x", parameter="k", action="u") -> Program:
    """`parameter * peek(sensor, -1)`, built without the front end and its checks."""
    body = Apply(Operator.MULTIPLY, (ParameterRef(parameter), Peek(SensorRef(sensor, 1), -1)))
    return Program(
        Interface(
            policy,
            None,
            (Sensor(sensor, -1.0, 1.0, 0),),
            (ActionSpec(action, Continuous(-1.0, 1.0), 0),),
        ),
        (FixedParameter(parameter, 0.5),),
        (body,),
    )


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("place", ["policy", "sensor", "parameter", "action"])
@pytest.mark.parametrize("target", ["c", "python"])
def test_no_such_name_gets_through_anywhere(name, place, target):
    with pytest.raises(PirlcError, match="E0801"):
        emit(program_with(**{place: name}), [target])


def test_names_that_need_no_change_keep_theirs():
    assert c_members().assign(["int", "int_", "long", "x"]) == {
        "int": "int_2",
        "int_": "int_",
        "long": "long_",
        "x": "x",
    }


def test_reserved_forms():
    names = python_locals(()).assign(["__init__", "_x", "a__b", "a_b", "_X"])
    assert names == {
        "__init__": "u_init_",
        "_x": "u_x",
        "a__b": "a_b_",
        "a_b": "a_b",
        "_X": "u_X",
    }
    assert c_members().assign(["FLT_MAX", "M_PI"]) == {"FLT_MAX": "u_FLT_MAX", "M_PI": "u_M_PI"}


def test_long_names_are_cut_and_stay_apart():
    first, second = "a" * 5000 + "b", "a" * 5000 + "c"
    given = Identifiers(()).assign([first, second])
    assert len(set(given.values())) == 2
    assert all(len(name) == 63 for name in given.values())


@pytest.mark.parametrize(
    ("policy", "stem"),
    [
        ("cartpole", "cartpole"),
        ("float", "policy_float"),
        ("math", "policy_math"),
        ("Math", "policy_Math"),
        ("random", "policy_random"),
        ("_private", "u_private"),
        ("step_", "step"),
        ("FLT_x", "policy_FLT_x"),
    ],
)
def test_file_names(policy, stem):
    assert file_stem(policy) == stem


WORDS = """self values flags status failed observation p s in out k int double float_ sqrt fabs y1
    main step reset state params real action step_ u_x _Bool __asm__ math numpy Controller
    oldest_of_20 x_flags x_seen x_last previous_u MISSING PARAMS sum int_flags"""
RESERVED = sorted({*keyword.kwlist, *dir(builtins), *C_RESERVED, *WORDS.split()})


def program_of_all() -> Program:
    """An action for each reserved name; sensors and parameters bear reserved names as well."""
    count = len(RESERVED)
    sensors = [Sensor(name, -1.0, 1.0, k) for k, name in enumerate(RESERVED)]
    actions = [ActionSpec(name, Continuous(-1.0, 1.0), k) for k, name in enumerate(RESERVED)]
    parameters = [FixedParameter(name, k / count) for k, name in enumerate(RESERVED)]
    bodies = [
        Apply(
            Operator.ADD,
            (
                Apply(Operator.MULTIPLY, (ParameterRef(name), Peek(SensorRef(name, 3), -3))),
                PreviousAction(RESERVED[k - 1], Real()),
            ),
        )
        for k, name in enumerate(RESERVED)
    ]
    interface = Interface("step", None, tuple(sensors), tuple(actions), window=3)
    return Program(interface, tuple(parameters), tuple(bodies))


def expected_of_all() -> tuple[float, ...]:
    count = len(RESERVED)
    return tuple(k / count * 0.5 for k in range(count))


def test_reserved_names_in_python():
    assert python_policy(program_of_all()).act([0.5] * len(RESERVED)) == expected_of_all()


@pytest.mark.skipif(not COMPILERS, reason="no gcc and no clang on this machine")
@pytest.mark.parametrize("compiler", COMPILERS)
def test_reserved_names_in_c(compiler, tmp_path):
    controller = compiled(program_of_all(), tmp_path, compiler=compiler, level="-O0")
    assert controller.step([0.5] * len(RESERVED)) == (expected_of_all(), 0)


def test_reserved_names_of_policies():
    for name in RESERVED:
        files = emit(program_with(policy=name), ["c", "python"])
        stem = file_stem(name)
        assert [str(file.path) for file in files] == [f"{stem}.h", f"{stem}.c", f"{stem}.py"]
        assert f"unsigned {stem}_step(" in files[0].text
        assert "__" not in stem
        assert stem not in {*keyword.kwlist, *dir(builtins), *C_RESERVED}


def test_very_long_names(tmp_path):
    long = {place: f"{place}_{'very_' * 40}long" for place in ("sensor", "parameter", "action")}
    program = program_with("policy_" + "x" * 400, **long)
    body = Apply(
        Operator.ADD, (Fold(Operator.ADD, SensorRef(long["sensor"], 4)), program.bodies[0])
    )
    guarded = If(Apply(Operator.LESS, (body, body)), body, Apply(Operator.MULTIPLY, (body, body)))
    sensor = replace(program.interface.sensors[0], missing=Hold(3))
    interface = replace(program.interface, window=4, sensors=(sensor,))
    program = Program(interface, program.parameters, (guarded,))
    forms = [Run(program, form, "double", tmp_path) for form in FORMS]
    for reading in (0.125, -0.0625, math.nan, 0.25):
        answers = [run.step([reading]) for run in forms]
        assert answers == [answers[0]] * len(forms)


def test_one_name_for_everything(tmp_path):
    program = program_with("x", "x", "x", "x")
    assert python_policy(program).act([0.5]) == (0.25,)
    if COMPILERS:
        assert compiled(program, tmp_path).step([0.5])[0] == (0.25,)


def test_comments_hold_printable_ascii_that_ends_nothing():
    text = 'a */ b /* c ??/ \\\nd \\  \né\r\x00\x0b\t"""\u2028e\n*//* /*/ ****/\n\n'
    lines = comment_lines(text)
    joined = "\n".join(lines)
    assert joined.isascii() and all(c.isprintable() or c == "\n" for c in joined)
    for bad in ("*/", "/*", "??"):
        assert bad not in joined
    assert not any(line.endswith("\\") for line in lines)
    assert lines[:3] == ["a * / b / * c ? ?/ \\ .", "d \\ .", '\\xe9\\r\\x00\\x0b    """\\u2028e']
    assert len(lines) == 4
    assert comment_lines("") == comment_lines("\n\n") == []
    assert comment_lines("a\n\nb") == ["a", "", "b"]


@pytest.mark.skipif(not COMPILERS, reason="no gcc and no clang on this machine")
def test_a_hostile_environment_string_stays_in_the_comment(tmp_path):
    program = load_program("hostile")
    files = {file.path.name: file.text for file in emit(program)}
    assert sorted(files) == ["policy_float.c", "policy_float.h", "policy_float.py"]
    for text in files.values():
        assert text.isascii()
    header = files["policy_float.h"]
    assert header.count("*/") == len(re.findall(r"/\*", header))
    assert "int main" in header
    compiled(program, tmp_path)
    found = subprocess.run(
        [sys.executable, "-W", "error", "-c", files["policy_float.py"]], capture_output=True
    )
    assert (found.returncode, found.stdout, found.stderr) == (0, b"", b"")
