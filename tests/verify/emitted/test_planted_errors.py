"""Each kind of planted fault is caught, and the part that it spoils is named.

A fault is a change of the template, the printer or the lowering. That the same program without it
is proved is checked each time, so that a checker which accepts or refuses everything fails here.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import Any

import pytest

from pirlc.backend import c as printer
from pirlc.backend import c_expressions, numbers
from pirlc.backend.c import CPrinter, c_files
from pirlc.backend.emit import emit
from pirlc.backend.files import Provenance
from pirlc.backend.numbers import RealType
from pirlc.diagnostics import PirlcError, render
from pirlc.frontend import parse_sketch
from pirlc.ir.evidence import PROVED, Kind
from pirlc.ir.expansion import close
from pirlc.ir.policy import Program
from pirlc.lower import lower, lowering
from pirlc.lower.lowering import _Lowering
from pirlc.source import SourceText
from pirlc.verify.emitted import check_emitted
from pirlc.verify.emitted.gate import compared
from tests.support.planted import plant, plant_in_template

TEXT = r"""policy bench

sensor x : [-1, 1.1]  = 2
sensor y : [0.1, 0.3] = 0 missing zero
sensor z : [-5, 5]    = 1 missing hold 2 then fail
sensor w : [-2, 1]    = 3 missing fail
window 4
latency 1

param kp = 0.1234567891
param ki = 0.05
param kd = 4.998

action u : [-1, 0.7] safe 0.25 =
  let e = kp - x in
  kp * peek(e, -1) + ki * fold(+, e) + kd * (peek(x, -2) - peek(x, -1))
  - (previous(u) - previous(v)) * 0.5 + fold(\a acc -> a * 0.5 + acc, x, 0)
action v : [-10, 10] safe 1 =
  if peek(x, -1) > 0.2 and not (peek(z, -1) <= peek(y, -1)) or peek(w, -1) == 0
  then let m = min(peek(y, -1), peek(z, -1)) in clip(m, -peek(z, -2), 1) + sign(peek(w, -1) / m)
  else if fold(max, z) < 1 then sqrt(abs(peek(w, -1))) else exp(peek(y, -3)) - tanh(peek(x, -4))
action mode : {0, 1, 3} safe 1 =
  if previous(mode) == 3 and peek(x, -1) < 0.3 then 0 else if peek(z, -1) > ki then 3 else 1
"""

SHORT = """policy short
sensor x : [-1, 1] = 0
action v : [-1, 1] = if peek(x, -1) > 0.5 then 0.25 else peek(x, -1)
"""

LONG = """policy long_fold
sensor x : [-1, 1] = 0
sensor y : [-1, 1] = 1
window 12
action u : [-1, 1] safe 0 = fold(+, x) * peek(y, -1) + fold(*, x - y)
"""


@cache
def _program(text: str = TEXT) -> Program:
    program = close(parse_sketch(SourceText("bench.pirl", text)))
    assert program is not None
    return program


@dataclass(frozen=True)
class Fault:
    """`part`: a pattern of which some difference's part must be; `refuted`: a run shows it."""

    owners: Any
    function: str
    old: str
    new: str
    part: str
    refuted: bool = True
    real: RealType = "double"
    text: str = TEXT


C, X, L = CPrinter, c_expressions, _Lowering

FAULTS = {
    # Readings taken in
    "range too narrow": Fault(C, "_take_in", "{x} >= {low}", "{x} > {low}", "^status"),
    "range without its upper end": Fault(C, "_take_in", " && ({x} <= {high})", "", "^status"),
    "range of the file, not the widened one": Fault(
        C, "_take_in", "min(c.high, LARGEST[self.real])", "c.upper", "^status"
    ),
    "NaN test removed": Fault(C, "_take_in", "({x} - {x}) != {zero}", "0", "^status"),
    "NaN test that misses infinities": Fault(
        C, "_take_in", "({x} - {x}) != {zero}", "{x} != {x}", "^status"
    ),
    "hold pushes NaN": Fault(
        C, "_take_in", 'absent.append(f"{x} = {self._stand_in(c)};")', "pass", "state x"
    ),
    "hold gives the oldest": Fault(C, "_stand_in", "({head} - 1u)]", "({head} - 2u)]", "^step$"),
    "zero for hold": Fault(C, "_stand_in", "isinstance(c.missing, Hold)", "False", "state x"),
    "zero before the first reading": Fault(
        C,
        "_stand_in",
        "(s->{self.seen[c.name]} != 0u) ? {zero} : {start}",
        "{zero}",
        "state y",
        refuted=False,
    ),
    "flags not stored": Fault(
        C, "_take_in", 'absent = [f"{flags} = {missing};"]', "absent = []", "x_flags"
    ),
    "flags kept from the step before": Fault(
        C, "_step", '[f"s->{flags} = 0u;" for flags in self.flags.values()]', "[]", "."
    ),
    "status bit lost": Fault(C, "_take_in", '        f"    status |= {flags};",\n', "", "^status"),
    "status overwritten": Fault(C, "_take_in", "status |= ", "status = ", "^status"),
    "missing counter off by one": Fault(
        C, "_take_in", "if ({count} < {c.limit}u)", "if ({count} + 1u < {c.limit}u)", "."
    ),
    "missing counter one too late": Fault(
        C, "_take_in", "if ({count} < {c.limit}u)", "if ({count} <= {c.limit}u)", "."
    ),
    "missing counter never starts again": Fault(
        C, "_take_in", "{local} = 0u;", "{local} = {count};", "z_missing"
    ),
    "missing counter not stored": Fault(
        C,
        "_take_in",
        'lines.append(f"s->{self.counts[c.name]} = {self.count_locals[c.name]};")',
        "pass",
        "z_missing",
    ),
    "failure forgotten": Fault(C, "_take_in", '"    failed = 1u;",', "", "action u"),
    "failure of a limit of none forgotten": Fault(
        C, "_take_in", 'absent.append("failed = 1u;")', "pass", "action u"
    ),
    "first reading not noted": Fault(C, "_push", "{seen} = 1u", "{seen} = 0u", "x_seen"),
    "first reading does not fill": Fault(C, "_push", "{buffer}[k] = {x};", ";", "state x"),
    "first reading fills all but one": Fault(C, "_push", "k < {c.kept}u", "k < {c.kept - 1}u", "."),
    "a missing reading counts as the first": Fault(
        C, "_push", "({seen} == 0u) && ({flags} != {self.stem}_MISSING)", "{seen} == 0u", "x_seen"
    ),
    "ring head off by one": Fault(
        C, "_push", "next_in_ring(head, c.kept)", "next_in_ring(head, c.kept - 1)", "."
    ),
    "ring head stands still": Fault(
        X, "next_in_ring", "({place} + 1u)", "{place}", "state x|^step$"
    ),
    "ring written after its head": Fault(
        C, "_push", "{buffer}[{head}] = {x};", "{buffer}[{head} + 1u] = {x};", "^step$"
    ),
    "shifted the wrong way": Fault(
        C,
        "_push",
        "[{k}] = {buffer}[{k + 1}]",
        "[{k + 1}] = {buffer}[{k}]",
        "state x",
        text="policy two\nsensor x : [-1, 1] = 0\nwindow 2\naction u : [-1, 1] = fold(+, x)\n",
    ),
    # Reset
    "wrong initial value": Fault(C, "_reset", "c.initial", "c.lower", "after reset, state x"),
    "one reading not initialised": Fault(
        C, "_reset", "k < {c.kept}u", "k < {c.kept - 1}u", "after reset, state x"
    ),
    "previous action not initialised": Fault(
        C, "_reset", "{self._safe(output)}", "0", "after reset, state previous_u"
    ),
    "notes not initialised": Fault(C, "_reset", "*self.seen.values(),", "", "after reset, .*_seen"),
    # Actions
    "lost clip above": Fault(C, "_clip", "({raw} > {high}) ? {high} : {raw}", "{raw}", "action u"),
    "lost clip below": Fault(C, "_clip", "{out} = {low};", "{out} = {raw};", "action u"),
    "wrong comparison in the clip": Fault(
        C, "_clip", "if ({raw} >= {low})", "if ({raw} > {low})", "action u", refuted=False
    ),
    "NaN clipped, not safe": Fault(
        C, "_clip", "else if ({raw} < {low})", "else if (!({raw} >= {low}))", "action v"
    ),
    "safe value wrong": Fault(
        C, "_safe", "constant(output.safe,", "constant(output.safe + 0.5,", "action u"
    ),
    "safe not told": Fault(
        C, "_clip", '        f"    status |= {self.stem}_SAFE_USED;",\n', "", "^status"
    ),
    "failure not told": Fault(C, "_step", ', f"status |= {self.stem}_SAFE_USED;"', "", "^status"),
    "previous not stored": Fault(
        C,
        "_step",
        'lines.append(f"s->{member} = out->{self.actions[name]};")',
        "pass",
        "state previous_u",
    ),
    "previous stored before clipping": Fault(
        C,
        "_step",
        "s->{member} = out->{self.actions[name]};",
        "s->{member} = {name};",
        "^step$",
        False,
    ),
    # Expressions
    "swapped index": Fault(
        X, "_reading", "place = channel.depth - 1 - age", "place = age", "action u"
    ),
    "index one too old": Fault(
        X,
        "_reading",
        "place = channel.depth - 1 - age",
        "place = max(0, channel.depth - 2 - age)",
        "action u",
    ),
    "ring index wraps late": Fault(
        X, "along_ring", "{head} < {wraps}u)", "{head} <= {wraps}u)", "."
    ),
    "ring index without wrapping": Fault(
        X,
        "along_ring",
        "({head} < {wraps}u) ? ({head} + {steps}u) : ({head} - {wraps}u)",
        "{head} + {steps}u",
        "^step$",
    ),
    "operands of - swapped": Fault(
        X,
        "joined",
        "{first} {operator} {right.at(NEGATION)}",
        "{right.at(NEGATION)} {operator} {first}",
        "action u",
    ),
    "parentheses lost": Fault(X, "joined", "right.at(NEGATION)", "right.code", "action u"),
    "operands of min swapped": Fault(
        X,
        "_operation",
        'chosen(joined("<", COMPARE, x, y), x, y)',
        'chosen(joined("<", COMPARE, y, x), y, x)',
        "action v",
        refuted=False,
    ),
    "min with <=": Fault(
        X,
        "_operation",
        'joined("<", COMPARE, x, y)',
        'joined("<=", COMPARE, x, y)',
        "action v",
        False,
    ),
    "max for min": Fault(
        X, "_operation", 'joined("<", COMPARE, x, y)', 'joined(">", COMPARE, x, y)', "action v"
    ),
    "sign of NaN is 0": Fault(
        X, "_operation", 'chosen(joined("==", COMPARE, x, zero), zero, x)', "zero", "action v"
    ),
    "and for or": Fault(
        X, "_operation", 'joined("||", OR, x, y)', 'joined("&&", OR, x, y)', "action v"
    ),
    "not lost": Fault(
        X, "_operation", 'return Text(f"!{x.at(NEGATION)}", NEGATION)', "return x", "action v"
    ),
    "fabs lost": Fault(
        X,
        "_operation",
        "_MATH_CALLS[operator]",
        "_MATH_CALLS[operator] if operator is not Operator.ABS else str()",
        "action v",
    ),
    "exp for tanh": Fault(
        X,
        "_operation",
        "_MATH_CALLS[operator]",
        "_MATH_CALLS[Operator.EXP if operator is Operator.TANH else operator]",
        "action v",
    ),
    "wrong component": Fault(
        C, "_observation", "component {c.index}", "component {c.index + 1}", "component of x", False
    ),
    "sides of an if swapped": Fault(
        X,
        "_branch",
        "statements(scope, branch.consequent)",
        "statements(scope, branch.alternative or branch.consequent)",
        "action (v|mode)",
    ),
    "sides of a ?: swapped": Fault(
        X,
        "expression",
        "chosen(test, left, right)",
        "chosen(test, right, left)",
        "action v",
        text=SHORT,
    ),
    "wrong discrete value": Fault(
        X,
        "expression",
        "discrete_constant(value,",
        "discrete_constant(min(value, 2),",
        "action mode",
    ),
    "constant printed with %.6f": Fault(
        (numbers, X), "shortest", "return repr(rounded)", 'return f"{rounded:.6f}"', "default kp"
    ),
    "default parameter left out of place": Fault(
        C,
        "_defaults",
        "for _, v in self.controller.parameters]",
        "for _, v in self.controller.parameters[::-1]]",
        "default k",
    ),
    # Precisions
    "float for double": Fault(
        C, "_take_in", "const '}{self.real} {x} =", "const '}float {x} =", "action u|state x"
    ),
    "double in float code": Fault(
        C,
        "_take_in",
        "const '}{self.real} {x} =",
        "const '}double {x} =",
        ".",
        real="float",
        refuted=False,
    ),
    "double literals in float code": Fault(
        (X, printer),
        "constant",
        '"f" if real == "float" else ""',
        '""',
        ".",
        real="float",
    ),
    "fabs for fabsf": Fault(
        X,
        "_operation",
        '"f" if scope.real == "float" else ""',
        '""',
        "action v",
        real="float",
    ),
    "constant of a float rounded twice": Fault(
        numbers, "_shortest_binary32", "range(1, 10)", "range(1, 6)", "default kp", real="float"
    ),
    # Lowering
    "latency off by one": Fault(
        L,
        "_reading",
        "self._interface.latency + length",
        "self._interface.latency + length - 1",
        "action u",
    ),
    "latency forgotten": Fault(L, "_reading", "self._interface.latency + ", "", "action u"),
    "wrong sensor": Fault(
        L,
        "_reading",
        "Reading(sensor, age)",
        'Reading("x" if sensor == "z" else sensor, age)',
        "action v",
    ),
    "fold order reversed": Fault(
        L, "_fold", "[element, folded]", "[folded, element]", "action u", refuted=False
    ),
    "fold from newest to oldest": Fault(
        L, "_fold", "At(place)", "At(sequence.length - 1 - place)", "action u"
    ),
    "fold from 0": Fault(
        L,
        "_fold",
        "folded = sequence.element(At(0), block)",
        "folded = self._operation("
        "Operator.ADD, [Constant(0.0), sequence.element(At(0), block)], block)",
        "action",
        refuted=False,
    ),
    "loop one short": Fault(
        L, "_fold", "sequence.length - 1)\n", "sequence.length - 2)\n", "action u", text=LONG
    ),
    "loop starts at the second": Fault(
        L, "_fold", "At(1, index)", "At(0, index)", "action u", text=LONG
    ),
    "loop's cursor stands still": Fault(
        X, "_loop", "steps.append(next_in_ring(name, cursor.length))", "pass", "action u", text=LONG
    ),
    "loop's cursor runs over": Fault(
        X,
        "_loop",
        "next_in_ring(name, cursor.length)",
        "next_in_ring(name, cursor.length + 1)",
        "^step$",
        text=LONG,
    ),
    "initial value of a fold lost": Fault(
        L, "_fold_lambda", "folded = initial\n", "folded = Constant(1.0)\n", "action u"
    ),
    "differences older minus newer": Fault(
        L,
        "_sequence",
        "[newer, older]",
        "[older, newer]",
        "action u",
        text="policy d\nsensor x : [-1, 1] = 0\nwindow 3\naction u : [-1, 1] = fold(+, diff(x))\n",
    ),
    "an if without its else": Fault(
        L,
        "_into",
        "self._into(target, term.alternative, scope, alternative)",
        "pass",
        "^step$",
    ),
    "buffer one too short": Fault(lowering, "_depths", "part.age + 1", "max(1, part.age)", "."),
    "widened range lost": Fault(
        L,
        "_channel",
        "widened(sensor.lower, sensor.upper)",
        "(sensor.lower, sensor.upper)",
        "^status",
    ),
    "middle of the range lost": Fault(
        L, "_channel", "middle(sensor.lower, sensor.upper)", "sensor.upper", "after reset, state x"
    ),
}


def _caught(program: Program, fault: Fault) -> None:
    finding = check_emitted(program, fault.real)
    assert finding.evidence.kind is (Kind.REFUTED if fault.refuted else Kind.UNKNOWN), finding
    parts = [difference.part for difference in finding.differences]
    assert any(re.search(fault.part, part) for part in parts), parts


@cache
def _right(text: str, real: RealType) -> list[str]:
    """The C without a fault, which is proved."""
    program = _program(text)
    assert check_emitted(program, real).evidence == PROVED
    return _texts(program, real)


def _texts(program: Program, real: RealType) -> list[str]:
    return [file.text for file in c_files(lower(program), real, Provenance("bench"))]


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_of_printer_or_lowering_is_caught(name, monkeypatch):
    fault = FAULTS[name]
    program = _program(fault.text)
    right = _right(fault.text, fault.real)
    plant(monkeypatch, fault.owners, fault.function, fault.old, fault.new)
    assert _texts(program, fault.real) != right
    _caught(program, fault)


TEMPLATE_FAULTS = {
    "float for double in the header": (
        "controller.h.j2",
        "typedef {{ real }}",
        "typedef float",
        "^source$",
    ),
    "status bits exchanged": ("controller.h.j2", "_SAFE_USED 4u", "_SAFE_USED 2u", "status"),
    "missing is another bit": ("controller.h.j2", "_MISSING 1u", "_MISSING 8u", "status"),
    "status starts at 1": (
        "controller.c.j2",
        "unsigned status = 0u",
        "unsigned status = 1u",
        "status",
    ),
    "failed from the start": (
        "controller.c.j2",
        "unsigned failed = 0u",
        "unsigned failed = 1u",
        "action u",
    ),
    "nothing returned": ("controller.c.j2", "return status;", "return 0u;", "status"),
    "step does nothing": (
        "controller.c.j2",
        '{{ step | code("    ") }}',
        "",
        "^step$|not set|action u",
    ),
    "reset does nothing": ("controller.c.j2", '{{ reset | code("    ") }}', "", "after reset"),
    "excess precision admitted": (
        "controller.c.j2",
        "#if !defined(FLT_EVAL_METHOD) || FLT_EVAL_METHOD < 0 || ",
        "#if 0 && ",
        "platform",
    ),
    "any double admitted": (
        "controller.c.j2",
        "#if FLT_RADIX != 2 ||",
        "#if FLT_RADIX != 2 &&",
        "platform",
    ),
    "fast math admitted": ("controller.c.j2", "{{ ieee754 }}", "", "platform"),
    "a variable that outlives the step": (
        "controller.c.j2",
        "unsigned status = 0u;",
        "static unsigned status = 0u;",
        "^step$",
    ),
    "a second function": (
        "controller.c.j2",
        "unsigned {{ name }}_step(",
        "void {{ name }}_more({{ name }}_state *s) { s->x_flags = 0u; }\nunsigned {{ name }}_step(",
        "^source$",
    ),
}


@pytest.mark.parametrize("name", TEMPLATE_FAULTS)
def test_a_fault_of_a_template_is_caught(name, monkeypatch, tmp_path):
    file, old, new, part = TEMPLATE_FAULTS[name]
    program = _program()
    assert _right(TEXT, "double")
    plant_in_template(monkeypatch, tmp_path, file, old, new)
    finding = check_emitted(program)
    assert finding.evidence.kind in (Kind.REFUTED, Kind.UNKNOWN)
    parts = [difference.part for difference in finding.differences]
    assert any(re.search(part, found) for found in parts), finding.differences


def test_contraction_admitted_is_caught(monkeypatch):
    text_of = printer.runtime_text
    program = _program(SHORT)
    monkeypatch.setattr(
        printer, "runtime_text", lambda *a: text_of(*a).replace("#pragma STDC FP_CONTRACT OFF", "")
    )
    parts = [(d.part, d.emitted) for d in check_emitted(program).differences]
    assert parts == [
        ("platform", "lets other compilers fuse operations: no #pragma STDC FP_CONTRACT OFF"),
        (
            "platform",
            "lets __GNUC__ 14, __clang__ 1 fuse operations: no #pragma STDC FP_CONTRACT OFF",
        ),
    ]


def test_nothing_wrong_is_written(monkeypatch):
    program = _program(SHORT)
    files = emit(program, ["c", "python"])
    finding = compared(program, files)
    assert finding is not None and finding.evidence == PROVED
    assert compared(program, emit(program, ["python"])) is None
    plant(monkeypatch, C, "_clip", "({raw} > {high}) ? {high} : {raw}", "{raw}")
    broken = SHORT.replace("[-1, 1] =", "[-1, 0.1] =")
    changed = _program(broken)
    with pytest.raises(PirlcError) as caught:
        compared(changed, emit(changed, ["c"]))
    message = render(caught.value.diagnostics[0])
    assert re.fullmatch(EXPECTED, message), message


EXPECTED = r"""error\[E0915\]: the C emitted for short \(double\) is not shown to be the program
  = note: action v, step \d+ after reset at x [-0-9.e]+: C has 0\.\d+, the program 0\.1
  = note: action v: C has .*\(where .*\), the program .*
  = help: this is a fault of pirlc, not of your file: please report it with the program; """ + (
    "nothing was written"
)
