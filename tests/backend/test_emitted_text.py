"""What emitted files tell their readers, and how their text is laid out."""

from __future__ import annotations

import re
import subprocess
from dataclasses import replace
from hashlib import sha256

import pytest

import pirlc
from pirlc.backend.c import discrete_type
from pirlc.backend.emit import emit, emit_to
from pirlc.backend.text import WIDTH, wrapped_c, wrapped_python
from pirlc.backend.toolchain import FLAGS, WARNINGS, bridge_text
from pirlc.ir.policy import Hold
from pirlc.ir.printer import program_text
from pirlc.lower import lower
from tests.backend.helpers import COMPILERS, NAMES, compiled, load_program, program_of

needs_gcc = pytest.mark.skipif("gcc" not in COMPILERS, reason="no gcc on this machine")

TOLD = """
policy told
sensor x : [0, 10] = 2 missing hold 70000 then fail
sensor y : [-1, 1] = 0 missing zero
sensor z : [-1, 1] = 1 missing fail
sensor w : [-1, 1] = 3
window 12
param k = 2
param j = 3
action u : [-1, 1] safe 0.5 = k * peek(x, -2) + fold(+, z) + j
action v : {-40000, 3} safe 3 = if peek(y, -1) > 0 and peek(w, -1) > 0 then previous(v) else 3
"""


def texts(program=None, real="double") -> tuple[str, str, str]:
    """Header, source and Python of a program."""
    header, source, python = emit(program or program_of(TOLD), real=real)
    return header.text, source.text, python.text


def structure(header: str, name: str) -> list[str]:
    """The members of one structure of a header, with their comments."""
    inside, _, _ = header.partition(f"}} {name};")
    return [line.strip() for line in inside.rpartition("typedef struct {")[2].splitlines() if line]


def test_the_header_describes_readings_and_actions():
    header, _, _ = texts()
    assert structure(header, "told_observation") == [
        "told_real x; /* [0.0, 10.0], component 2, missing hold 70000 then fail */",
        "told_real y; /* [-1.0, 1.0], component 0, missing zero */",
        "told_real z; /* [-1.0, 1.0], component 1, missing hold 0 then fail */",
        "told_real w; /* [-1.0, 1.0], component 3, missing hold */",
    ]
    assert structure(header, "told_action") == [
        "told_real u; /* [-1.0, 1.0], safe 0.5 */",
        "long v; /* {-40000, 3}, safe 3L */",
    ]
    assert structure(header, "told_params") == ["told_real k;", "told_real j;"]


def test_the_header_describes_the_state_widest_members_first():
    header, _, _ = texts()
    assert structure(header, "told_state") == [
        "told_real x[2]; /* the last 2 readings, oldest first */",
        "told_real z[12]; /* the last 12 readings, a ring */",
        "told_real w; /* last good reading */",
        "long previous_v; /* the action of the step before */",
        "unsigned long x_missing; /* readings missing in a row, at most 70000 */",
        "unsigned oldest_of_12; /* place of the oldest reading in rings of 12 */",
        "unsigned char x_seen; /* whether x has had a good reading */",
        "unsigned char y_seen; /* whether y has had a good reading */",
        "unsigned char z_seen; /* whether z has had a good reading */",
        "unsigned char x_flags; /* status bits of x at the last step */",
        "unsigned char y_flags; /* status bits of y at the last step */",
        "unsigned char z_flags; /* status bits of z at the last step */",
        "unsigned char w_flags; /* status bits of w at the last step */",
    ]


def test_what_there_is_none_of_has_a_placeholder():
    header, source, python = texts(program_of("policy still\naction u : [-1, 1] = 0.5"))
    assert structure(header, "still_observation") == [
        "unsigned char unused; /* the program reads no sensor */"
    ]
    assert structure(header, "still_params") == [
        "unsigned char unused; /* the program has no parameter */"
    ]
    assert structure(header, "still_state") == ["unsigned char unused; /* nothing is remembered */"]
    assert "State: 1 bytes" in header
    assert "s->unused = 0u;" in source
    assert "PARAMS = {\n}" in python
    assert (
        "SENSORS = {  # and the component of the observation that each of them reads\n}" in python
    )
    assert "self._params" not in python


def test_a_long_list_of_values_is_cut_in_its_comment():
    values = ", ".join(str(100 + k) for k in range(60))
    program = program_of(f"policy many\naction u : {{{values}}} = 100")
    [member] = structure(texts(program)[0], "many_action")
    about = "int u; /* {" + values
    assert member == about[: len("int u; /* ") + 76] + " ... */"
    for last, is_cut in ((100, False), (1000, True)):
        values = ", ".join(map(str, [1, *range(10, 26), last]))
        about = f"{{{values}}}, safe 1"
        assert len(about) == (81 if is_cut else 80)
        few = program_of(f"policy few\naction u : {{{values}}} = 1")
        shown = f"{about[:76]} ..." if is_cut else about
        assert structure(texts(few)[0], "few_action") == [f"int u; /* {shown} */"]


def test_numbers_have_the_narrowest_type_that_every_c99_gives_them():
    assert [discrete_type((0, n)) for n in (2**15 - 1, 1 - 2**15)] == ["int", "int"]
    assert [discrete_type((0, n)) for n in (2**15, -(2**15), 2**31 - 1)] == ["long"] * 3
    assert [discrete_type((0, n)) for n in (2**31, -(2**31))] == ["long long"] * 2
    assert discrete_type(()) == "int"


@pytest.mark.skipif(not COMPILERS, reason="no gcc and no clang on this machine")
@pytest.mark.parametrize(
    ("limit", "type_", "size"),
    [
        (2**16 - 1, "unsigned", 16),
        (2**16, "unsigned long", 24),
        (2**32 - 1, "unsigned long", 24),
        (2**32, "unsigned long long", 24),
    ],
)
def test_counters_are_as_wide_as_their_limit(limit, type_, size, tmp_path):
    program = program_of(
        "policy counted\n"
        "sensor x : [0, 1] = 0 missing hold 1 then fail\n"
        "action u : [0, 1] safe 0 = peek(x, -1)"
    )
    sensor = replace(program.interface.sensors[0], missing=Hold(limit))
    program = replace(program, interface=replace(program.interface, sensors=(sensor,)))
    header = texts(program)[0]
    assert f"{type_} x_missing; /* readings missing in a row, at most {limit} */" in header
    assert f"State: {size} bytes an instance" in header
    assert compiled(program, tmp_path, level="-O0").state_size == size


@pytest.mark.skipif(not COMPILERS, reason="no gcc and no clang on this machine")
@pytest.mark.parametrize("value", [1, 2**15, 2**31 - 1])
@pytest.mark.parametrize("real", ["double", "float"])
def test_the_size_of_remembered_discrete_actions(value, real, tmp_path):
    program = program_of(
        "policy kept\n"
        "sensor x : [0, 1] = 0\n"
        f"action u : {{0, {value}}} = if peek(x, -1) > 0.5 then {value} else previous(u)"
    )
    size = compiled(program, tmp_path, real, level="-O0").state_size
    assert f"State: {size} bytes an instance" in texts(program, real)[0]


def test_python_tells_what_it_was_made_from():
    program = program_of(TOLD)
    text = program_text(program)
    for real, precision in (("double", "binary64"), ("float", "binary32")):
        python = texts(program, real)[2]
        head = python.partition('"""')[0]
        assert f"# told: a controller, written by pirlc {pirlc.__version__}." in head
        assert sha256(text.encode()).hexdigest() in head
        for line in text.splitlines():
            assert f"#     {line}".rstrip() in head.splitlines()
        assert f"computes in {precision}." in python
        assert ("import ctypes" in python) == (real == "float")
    assert "Returns a tuple, by the environment's components." in python
    single = texts(load_program("cartpole"))[2]
    assert "missing reading. Returns an int.\n" in single
    ints = program_of("policy two\naction u : {0, 1} = 1\naction v : {0, 1} = 0")
    assert "Returns a tuple of ints, by the environment's components." in texts(ints)[2]


def test_the_module_lists_what_the_program_reads_and_gives():
    module: dict[str, object] = {"__name__": "told"}
    exec(compile(texts()[2], "told.py", "exec"), module)
    assert module["PARAMS"] == {"k": 2.0, "j": 3.0}
    assert module["SENSORS"] == {"x": 2, "y": 0, "z": 1, "w": 3}
    assert module["ACTIONS"] == ("u", "v")
    assert [module[name] for name in ("MISSING", "OUT_OF_RANGE", "SAFE_USED")] == [1, 2, 4]


def test_the_source_names_its_header_and_its_version():
    _, source, _ = texts()
    assert f"told: a controller, written by pirlc {pirlc.__version__}. See told.h." in source


@needs_gcc
def test_the_header_may_be_included_twice(tmp_path):
    emit_to(program_of(TOLD), tmp_path, ["c"])
    (tmp_path / "use.c").write_text(
        '#include "told.h"\n#include "told.h"\nint main(void){return 0;}'
    )
    subprocess.run(["gcc", "-std=c99", "-fsyntax-only", "use.c"], cwd=tmp_path, check=True)


USE = """\
#include <stdio.h>
#include "told.h"
int main(void)
{
    told_params p = told_default_params;
    told_state s;
    told_observation in = {4.0, 0.5, 0.25, 2.0};
    told_action out;
    unsigned status;
    told_reset(&s);
    p.j = -7.0;
    status = told_step(&p, &s, &in, &out);
    printf("%u %g %ld", status == told_OUT_OF_RANGE, (double)out.u, out.v);
    return 0;
}
"""


@needs_gcc
def test_the_header_is_all_that_a_caller_needs(tmp_path):
    emit_to(program_of(TOLD), tmp_path, ["c"])
    (tmp_path / "use.c").write_text(USE)
    command = ["gcc", *FLAGS, *WARNINGS, "-o", "use", "use.c", "told.c"]
    subprocess.run(command, cwd=tmp_path, check=True)
    answer = subprocess.run([tmp_path / "use"], capture_output=True, text=True, check=True).stdout
    # 2 * 4 + 12 * 0.25 - 7, clipped.
    assert answer == "1 1 3"


@needs_gcc
def test_windows_exports_what_is_called_from_outside(tmp_path):
    controller = lower(program_of(TOLD))
    (tmp_path / "bridge.c").write_text(bridge_text(controller, "told").replace("#include", "//"))
    command = ["gcc", "-E", "-P", "-D_WIN32", "bridge.c"]
    found = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    exported = re.findall(r"^__declspec\(dllexport\) .*?(bridge_\w+)\(", found, re.MULTILINE)
    kinds = ["state_size", "default_params", "reset", "flags", "step"]
    assert exported == [f"bridge_{kind}" for kind in kinds]


@needs_gcc
@pytest.mark.parametrize(
    ("real", "words"),
    [
        ("double", "double must be IEEE binary64 (or emit with --real float)"),
        ("float", "float must be IEEE binary32"),
    ],
)
def test_a_foreign_format_is_refused_with_what_is_needed(real, words, tmp_path):
    emit_to(program_of(TOLD), tmp_path, ["c"], real)
    command = ["gcc", "-std=c99", "-w", "-D__FLT_RADIX__=16", "-fsyntax-only", "told.c"]
    found = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert f'#error "told.c: {words}"' in found.stderr


@needs_gcc
@pytest.mark.parametrize("real", ["double", "float"])
def test_what_a_compiler_may_say_of_its_arithmetic(real, tmp_path):
    """Evaluation methods that widen what a program computes in, and other formats, are refused."""
    emit_to(program_of(TOLD), tmp_path, ["c"], real)

    def refused(name: str, value: int) -> bool:
        command = ["gcc", "-std=c99", "-w", f"-D{name}={value}", "-fsyntax-only", "told.c"]
        found = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        assert (found.returncode != 0) == ("#error" in found.stderr), found.stderr
        return found.returncode != 0

    accepted = [m for m in (-2, -1, 0, 1, 2, 15, 16, 17) if not refused("__FLT_EVAL_METHOD__", m)]
    assert accepted == ([0, 1, 16] if real == "double" else [0, 16])
    prefix, digits, exponent = ("DBL", 53, 1024) if real == "double" else ("FLT", 24, 128)
    for name, right in ((f"__{prefix}_MANT_DIG__", digits), (f"__{prefix}_MAX_EXP__", exponent)):
        assert [refused(name, value) for value in (right - 1, right, right + 1)] == [1, 0, 1]
    assert [refused("__FLT_RADIX__", radix) for radix in (2, 10)] == [False, True]


@pytest.mark.parametrize("real", ["double", "float"])
def test_lines_are_no_longer_than_they_must_be(real):
    for name in NAMES:
        for text in texts(load_program(name), real):
            for line in text.splitlines():
                comment = line.startswith((" *", "#")) or "/*" in line
                assert comment or len(line) <= WIDTH or name == "hostile", line
                assert line == line.rstrip()


def test_long_lines_of_c_are_continued_deeper():
    words = " + ".join(["number"] * 18)
    first, second = wrapped_c(f"    const double total = {words};")
    assert first.startswith("    const double total = number")
    assert second.startswith("        number")
    assert len(first) <= WIDTH < len(f"{first} number")
    assert f"{first.strip()} {second.strip()}" == f"const double total = {words};"


@pytest.mark.parametrize(
    ("line", "first", "last"),
    [
        ("    if {}:", "    if (", "    ):"),
        ("    elif {}:", "    elif (", "    ):"),
        ("    total = {}", "    total = (", "    )"),
        ("    return {}", "    return (", "    )"),
        ("    {} = self._state", "    (", "    ) = self._state"),
    ],
)
def test_long_statements_of_python_are_put_in_parentheses(line, first, last):
    words = ", ".join(["number"] * 16)
    written = wrapped_python(line.format(words))
    assert (written[0], written[-1]) == (first, last)
    assert all(part.startswith("        number") for part in written[1:-1])
    assert " ".join(part.strip() for part in written[1:-1]) == words


def test_a_line_is_wrapped_only_where_it_is_too_long():
    for wrap in (wrapped_c, wrapped_python):
        start = "x = " if wrap is wrapped_python else ""
        for length in (WIDTH - 1, WIDTH, WIDTH + 1):
            half = (length - len(start)) // 2
            line = f"{start}{'a' * half} {'b' * (length - len(start) - half - 1)}"
            assert len(line) == length
            assert (len(wrap(line)) > 1) == (length > WIDTH)
    assert wrapped_python("a" * 200) == ["a" * 200]
    assert wrapped_c(f"    {'a' * 150} = {'b' * 120};") == [
        f"    {'a' * 150}",
        "        =",
        f"        {'b' * 120};",
    ]
