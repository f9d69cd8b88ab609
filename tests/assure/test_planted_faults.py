"""Each checker of `make assure` finds a fault that is planted in emitted C, and none without it."""

from __future__ import annotations

import random
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.assure import analyzers, compilers, misra, sanitizers, targets, tools
from benchmarks.assure.deviations import DEVIATIONS, Report, allowed
from benchmarks.assure.driving import CORTEX_M4F, S390X
from benchmarks.assure.subjects import Subject, emitted
from pirlc.backend.toolchain import FLAGS
from tests.backend.helpers import program_of

TEXT = """
policy planted
sensor speed : [0, 80] = 0
sensor level : [-1, 1] = 1 missing hold 2 then fail
window 5
param gain = 0.5
action u : [-1, 1] safe 0 = if peek(speed, -1) > 40 then gain * fold(+, level) else peek(level, -2)
"""

CLEAN = "    unsigned status = 0u;\n"


def needs(*wanted: tools.Tool):
    missing = [tool for tool in wanted if not tool.installed]
    return pytest.mark.skipif(
        bool(missing), reason=f"needs {', '.join(tool.package for tool in missing)}"
    )


@pytest.fixture
def subject(tmp_path: Path) -> Subject:
    """The emitted C of a program with a window, a guard and a sensor that may fail, in binary32."""
    made = emitted(iter([("planted", program_of(TEXT))]), tmp_path / "emitted", is_example=True)
    return made[1]


def plant(subject: Subject, lines: str, where: str = CLEAN) -> None:
    """Adds lines behind a place in the C source, which is there once."""
    text = subject.source.read_text(encoding="ascii")
    assert text.count(where) == 1
    subject.source.write_text(text.replace(where, where + lines), encoding="ascii")


@pytest.fixture
def work(tmp_path: Path) -> Path:
    place = tmp_path / "work"
    place.mkdir()
    return place


@needs(tools.GCC, tools.CLANG)
def test_a_warning(subject, work):
    assert compilers.check(subject, work).findings == ()
    plant(subject, "    int narrowed = in->speed;\n    status += 0u * (unsigned)narrowed;\n")
    found = compilers.check(subject, work).findings
    assert len(found) == 4
    assert all("conversion" in finding for finding in found)
    assert {finding.split(":")[0] for finding in found} == {
        f"{compiler} {level}" for compiler in ("gcc", "clang") for level in ("-O0", "-O2")
    }


@needs(tools.GCC)
def test_a_fault_for_gcc_analyzer(subject, work):
    assert analyzers.gcc_analyzer(subject, work).findings == ()
    plant(
        subject,
        "    const float *nowhere = 0;\n"
        "    if (in->speed > 1.0f) { nowhere = &p->gain; }\n"
        "    status += *nowhere > 2.0f ? 8u : 0u;\n",
    )
    (found,) = analyzers.gcc_analyzer(subject, work).findings
    assert "-Wanalyzer-null-dereference" in found


@needs(tools.CLANG_TIDY)
def test_a_fault_for_clang_tidy(subject, work):
    assert analyzers.clang_tidy(subject, work).findings == ()
    plant(subject, "    if (in->speed > 1.0f) { status = 0u; } else { status = 0u; }\n")
    (found,) = analyzers.clang_tidy(subject, work).findings
    assert "bugprone-branch-clone" in found
    in_random = analyzers.clang_tidy(replace(subject, is_example=False), work)
    assert in_random.findings == ()
    assert in_random.accepted == {"clang-tidy bugprone-branch-clone": 1}


@needs(tools.CPPCHECK)
def test_a_deviation_that_the_table_does_not_have(subject, work):
    before = misra.check(subject, work)
    assert before.findings == ()
    assert before.accepted["cppcheck multiCondition"] == 1
    plant(subject, "    if (status != 0u) { goto out; }\nout:\n")
    found = misra.check(subject, work).findings
    assert any("cppcheck MISRA 15.1" in finding for finding in found)


@needs(tools.CPPCHECK)
def test_precedence_is_still_checked_where_it_is_not_a_choice(subject, work):
    plant(subject, "    status = status + 2u * status;\n")
    (found,) = misra.check(subject, work).findings
    assert "cppcheck MISRA 12.1" in found


@needs(tools.GCC, tools.CLANG_SANITIZERS)
@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (
            ("s->level[oldest_of_5] = level;", "s->level[oldest_of_5 + 1u] = level;"),
            "index 5 out of bounds",
        ),
        (
            (CLEAN, f"{CLEAN}    status |= 0u * (unsigned)(2147483647 - (int)in->level + 2);\n"),
            "signed integer overflow",
        ),
        (("    s->oldest_of_5 = 0u;\n", ""), "use-of-uninitialized-value"),
        ((CLEAN, f"{CLEAN}    status += 0u * (status - 1u);\n"), "unsigned integer overflow"),
    ],
)
def test_faults_for_the_sanitizers(subject, work, monkeypatch, fault, said):
    monkeypatch.setattr(sanitizers, "EXAMPLE_STEPS", 500)
    text = subject.source.read_text(encoding="ascii")
    assert text.count(fault[0]) == 1, text
    subject.source.write_text(text.replace(*fault), encoding="ascii")
    found = sanitizers.check(subject, work).findings
    assert any(said in finding for finding in found), found


@needs(tools.GCC, tools.CLANG_SANITIZERS)
def test_nothing_for_the_sanitizers(subject, work, monkeypatch):
    monkeypatch.setattr(sanitizers, "EXAMPLE_STEPS", 2_000)
    outcome = sanitizers.check(subject, work)
    assert outcome.findings == ()
    assert outcome.counts["steps"] == 2_000
    assert outcome.counts["steps with a missing reading"] > 100
    assert outcome.counts["steps with a safe value"] > 10


BYTES = (
    "    const unsigned char *bytes = (const unsigned char *)&in->speed;\n"
    "    status |= bytes[0] > 100u ? 8u : 0u;\n"
)


@needs(tools.GCC, *S390X.tools)
def test_a_dependence_on_the_order_of_bytes(subject, work, monkeypatch):
    monkeypatch.setattr(targets, "EXAMPLE_STEPS", 500)
    assert targets.check(subject, work, (S390X,)).findings == ()
    plant(subject, BYTES)
    (found,) = targets.check(subject, work, (S390X,)).findings
    assert found.startswith("s390x: ")
    assert "steps differ" in found


@needs(tools.S390X_GCC)
def test_where_float_is_computed_in_double_the_c_is_refused(subject, work):
    command = [tools.S390X_GCC.command, *FLAGS, "-c", subject.source, "-o", work / "o"]
    refused = tools.run(command)
    assert refused.returncode != 0
    assert "s390x: -fexcess-precision=fast" in refused.stderr
    assert tools.run([*command, "-fexcess-precision=fast"]).returncode == 0


@needs(tools.GCC, *CORTEX_M4F.tools)
def test_a_dependence_on_the_machine(subject, work, monkeypatch):
    monkeypatch.setattr(targets, "EXAMPLE_STEPS", 500)
    assert targets.check(subject, work, (CORTEX_M4F,)).findings == ()
    plant(subject, "    status |= (sizeof(void *) == 4u && in->level > 0.5f) ? 8u : 0u;\n")
    (found,) = targets.check(subject, work, (CORTEX_M4F,)).findings
    assert found.startswith("Cortex-M4F: ")


def test_examples_have_no_use_of_what_is_allowed_to_random_programs():
    rows = [deviation for deviation in DEVIATIONS if deviation.random_only]
    assert rows
    for row in rows:
        report = Report(row.rule, "x == x", 3)
        assert allowed(row.tool, report, is_example=True) is None
        assert allowed(row.tool, report, is_example=False) is row


def test_a_rule_is_deviated_from_in_its_place_only():
    at_choice = Report("12.1", "a = (b > c) ? b : c;", 13)
    at_sum = Report("12.1", "a = b + c * d;", 7)
    chosen = Report("10.6", "int a =", 7, "int a =\n    (b > c) ? 2 : 0;")
    computed = Report("10.6", "int a =", 7, "int a = d * e;")
    assert allowed("cppcheck MISRA", at_choice, is_example=True) is not None
    assert allowed("cppcheck MISRA", at_sum, is_example=True) is None
    assert allowed("cppcheck MISRA", chosen, is_example=True) is not None
    assert allowed("cppcheck MISRA", computed, is_example=True) is None


def test_streams_are_the_same_for_the_same_seed_and_hold_missing_readings():
    import numpy as np

    from benchmarks.assure.streams import stream
    from tests.support.programs import random_program

    program = random_program(random.Random(3))
    once, again, other = (stream(program, 3_000, seed) for seed in (1, 1, 2))
    assert np.array_equal(once, again, equal_nan=True)
    assert not np.array_equal(once, other, equal_nan=True)
    assert 0.02 < 1.0 - np.isfinite(once).mean() < 0.2
