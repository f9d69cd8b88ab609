"""Mutants are made where they matter, and survive in a copy of a tree where no test looks."""

from __future__ import annotations

import ast
import json
from pathlib import Path, PurePosixPath

import pytest

from benchmarks.mutation import documentation
from benchmarks.mutation.__main__ import BAR, RESULTS, ROOT, summary_of
from benchmarks.mutation.code_text import faults
from benchmarks.mutation.equivalent import equivalents, stale
from benchmarks.mutation.mutants import Mutant
from benchmarks.mutation.python_source import python_mutants
from benchmarks.mutation.selection import TARGETS, mutants_of, ordinary_tests, shuffled
from benchmarks.mutation.templates import template_mutants
from benchmarks.mutation.trees import Emitter, Tree


def changed(text: str, language: str) -> set[str]:
    return {new for _, new in faults(text, language)}


def test_faults_in_a_line_of_c():
    assert changed("if (!(x >= 0.5f)) { /* NaN or 1 */", "c") == {
        "if ((x >= 0.5f)) { /* NaN or 1 */",
        "if (!(x > 0.5f)) { /* NaN or 1 */",
        "if (!(x <= 0.5f)) { /* NaN or 1 */",
        "if (!(x >= 1.5f)) { /* NaN or 1 */",
    }
    assert changed("status |= {stem}_SAFE_USED;", "c") == {
        "status = {stem}_SAFE_USED;",
        "status &= {stem}_SAFE_USED;",
        "status |= {stem}_MISSING;",
    }


def test_faults_in_a_line_of_python():
    assert changed('elif a and "b and c":  # or', "python") == {
        'elif not a and "b and c":  # or',
        'elif a or "b and c":  # or',
    }


TEMPLATE = """\
/* {{ name }} and nothing else
 * that matters */
{% if shared %}
static double a = {{ first }};
{% endif %}
{% for value in values %}
v[{{ loop.index0 }}] = {{ value }};
{% endfor %}
"""


def test_mutants_of_a_template():
    made = template_mutants(PurePosixPath("a.c.j2"), TEMPLATE, "c")
    assert {(m.was, m.becomes) for m in made} >= {
        ("static double a = {{ first }};", ""),
        ("static double a = {{ first }};", "static float a = {{ first }};"),
        ("static double a = {{ first }};", "static double a = {{ loop.index0 }};"),
        ("{% if shared %}", "{% if not (shared) %}"),
        ("{% if shared %}\nstatic double a = {{ first }};\n{% endif %}", ""),
        ("{% for value in values %}", "{% for value in values[1:] %}"),
        ("v[{{ loop.index0 }}] = {{ value }};", "v[{{ loop.index }}] = {{ value }};"),
    }
    assert not any("that matters" in m.was for m in made)


SOURCE = '''\
def clipped(x: float, low: float = 0.0) -> str:
    """What is larger: not touched, 1 < 2."""
    lines = ["if (x < 1.0f) {", f"    {x} = {low};", "}"]
    if x > low and lines:
        lines.append("}")
    return "".join(lines[1:])
'''


def test_mutants_of_python_with_emitted_code_in_it():
    made = python_mutants(PurePosixPath("a.py"), SOURCE, "c")
    found = {(m.within, m.becomes) for m in made}
    assert found >= {
        ("clipped", 'lines = ["if (x <= 1.0f) {", f"    {x} = {low};", "}"]'),
        ("clipped", 'lines = ["if (x < 1.0f) {", f"    {low} = {x};", "}"]'),
        ("clipped", 'lines = ["if (x < 1.0f) {", "}"]'),
        ("clipped", "if x >= low and lines:"),
        ("clipped", "if x > low:"),
        ("clipped", "if not (x > low and lines):"),
        ("clipped", "pass"),
        ("clipped", 'return "".join(lines[:])'),
        ("clipped", 'return "".join(lines[2:])'),
    }
    assert all('"""What' not in m.was for m in made)
    for mutant in made:
        ast.parse(mutant.text)


def test_files_of_the_tree_have_mutants_and_a_fixed_sample_of_them():
    for target in TARGETS:
        made = mutants_of(target, ROOT)
        assert len(made) > 50, target.path
        assert len({m.key for m in made}) == len(made)
        assert shuffled(made, target, 1) == shuffled(made, target, 1) != shuffled(made, target, 2)


def test_every_equivalent_mutant_is_still_a_mutant():
    made = {m.key for target in TARGETS for m in mutants_of(target, ROOT)}
    listed = equivalents()
    assert stale(listed, made) == []
    assert all(len(reason) > 20 for reason in listed.values())
    assert stale([("a", "b", "c", "d", 1)], made) == [("a", "b", "c", "d", 1)]


@pytest.fixture
def small(tmp_path) -> Path:
    source = tmp_path / "source"
    (source / "tests").mkdir(parents=True)
    (source / "small.py").write_text(
        "def larger(a, b):\n    if a > b:\n        return a\n    return b\n\n\n"
        "def waits(n):\n    while n > 0:\n        n = n - 1\n    return n\n"
    )
    (source / "tests" / "test_small.py").write_text(
        "from small import larger, waits\n"
        "def test_larger():\n    assert larger(2, 1) == 2 == larger(1, 2)\n"
        "def test_waits():\n    assert waits(3) == 0\n"
    )
    return source


def test_a_survivor_is_told_from_what_is_caught(small, tmp_path):
    tree = Tree(small, tmp_path / "copy")
    text = (small / "small.py").read_text()
    assert tree.test(["tests"], 60).failed is None
    verdicts = {}
    for mutant in python_mutants(PurePosixPath("small.py"), text, "both"):
        with tree.holding(mutant.path, mutant.text):
            verdicts[mutant.becomes] = tree.test(["tests"], 4)
    assert (tree.folder / "small.py").read_text() == text
    survived = {becomes for becomes, verdict in verdicts.items() if verdict.failed is None}
    assert survived == {"if a >= b:"}, "which is larger does not matter where both are equal"
    caught = verdicts["if not (a > b):"]
    assert caught.failed == "tests/test_small.py::test_larger"
    assert "assert" in caught.why
    assert verdicts["n = n + 1"].failed == "the time limit"


def test_a_copy_of_this_tree_emits_differently_with_a_fault(tmp_path):
    tree = Tree(ROOT, tmp_path / "copy")
    emitter = Emitter(tree)
    path = PurePosixPath("templates/c/controller.c.j2")
    text = (ROOT / path).read_text()
    original = emitter.answer()
    assert original == emitter.answer() and original.startswith("ok ")
    with tree.holding(path, text.replace("unsigned status = 0u;", "unsigned status = 1u;")):
        assert emitter.answer().startswith("ok ") and emitter.answer() != original
    with tree.holding(path, text.replace("    return status;\n}", "    return status;\n")):
        assert emitter.answer().startswith("refused ValueError: C that does not compile")
    with tree.holding(path, text.replace("{{ step", "{{ steps")):
        assert emitter.answer() == "refused UndefinedError: 'steps' is undefined"
    assert emitter.answer() == original
    emitter.close()


def test_golden_files_are_not_among_the_ordinary_tests():
    tests = ordinary_tests(ROOT)
    assert not any("golden" in path for path in tests)
    assert len(set(tests)) == len(tests) > 15
    assert all((ROOT / path).is_file() for path in tests)


def test_rates_leave_out_what_is_refused_or_equivalent():
    verdicts = ["caught"] * 6 + ["survived"] * 2 + ["refused"] * 5 + ["equivalent"]
    rows = [{"part": "lower", "verdict": verdict} for verdict in verdicts]
    rows[6]["golden"] = True
    found = summary_of(rows, "lower")
    assert (found["tried"], found["caught"], found["caught_with_golden"]) == (8, 0.75, 0.875)
    assert summary_of(rows, "printers")["tried"] == 0


def test_mutants_that_look_alike_are_numbered():
    text = "{% if a %}\nx = 1;\n{% endif %}\nx = 1;\n"
    made = template_mutants(PurePosixPath("a.c.j2"), text, "c")
    alike = [m for m in made if m.becomes == "x = 2;"]
    assert [m.number for m in alike] == [1, 2]
    assert isinstance(alike[0], Mutant) and [m.line for m in alike] == [2, 4]


def test_the_documentation_shows_the_stored_results_and_they_meet_the_bar():
    results = json.loads(RESULTS.read_text(encoding="utf-8"))
    page = documentation.PLACE.read_text(encoding="utf-8")
    assert documentation.filled(page, documentation.tables(results, equivalents())) == page
    parts = {target.part for target in TARGETS}
    for part in (*parts, "all"):
        found = summary_of(results["mutants"], None if part == "all" else part)
        assert found == results["summary"][part]
        assert found["tried"] > 40 and found["caught"] >= BAR
