"""Mutants of a Python file.

mutmut brings the usual operators. Three of its own are left out, because they hardly ever make
code that still emits anything (None for an argument or a value) or spoil names and comments only
(strings in other capitals). What it lacks is what printers are made of: text in f-strings, lists
of lines, and the statements that add to them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import accumulate, pairwise
from pathlib import PurePosixPath
from typing import Any

import libcst as cst
from libcst.metadata import CodeRange, MetadataWrapper, WhitespaceInclusivePositionProvider
from mutmut.mutation import mutators

from benchmarks.mutation.code_text import Language, faults
from benchmarks.mutation.mutants import Mutant, distinct

Change = tuple[cst.CSTNode, cst.CSTNode | str]
"""A node of the file, and what stands in its place."""

Operator = Callable[[Any], Iterator[Change]]

_NOT_FROM_MUTMUT = (
    mutators.operator_string,
    mutators.operator_assignment,
    mutators.operator_arg_removal,
    mutators.operator_match,
)


def python_mutants(path: PurePosixPath, text: str, language: Language) -> list[Mutant]:
    """Every mutant, in the order of the file. `language` is that of the code in its strings."""
    wrapper = MetadataWrapper(cst.parse_module(text), unsafe_skip_copy=True)
    finder = _Finder(_operators(language))
    wrapper.visit(finder)
    ranges = wrapper.resolve(WhitespaceInclusivePositionProvider)
    starts = [0, *accumulate(map(len, text.splitlines(keepends=True)))]

    def offsets(span: CodeRange) -> tuple[int, int]:
        return (
            starts[span.start.line - 1] + span.start.column,
            starts[span.end.line - 1] + span.end.column,
        )

    made = []
    for within, fault, old, new in finder.found:
        start, end = offsets(ranges[old])
        code = new if isinstance(new, str) else wrapper.module.code_for_node(new)
        mutated = text[:start] + code + text[end:]
        if mutated != text:
            made.append(Mutant.of(path, within, fault, text, mutated))
    return distinct(made)


class _Finder(cst.CSTVisitor):
    """Collects where the operators apply, with the names of what is around."""

    def __init__(self, operators: Sequence[tuple[type, Operator]]) -> None:
        self.found: list[tuple[str, str, cst.CSTNode, cst.CSTNode | str]] = []
        self._operators = operators
        self._names: list[str] = []

    def on_visit(self, node: cst.CSTNode) -> bool:
        if isinstance(node, cst.FunctionDef | cst.ClassDef):
            self._names.append(node.name.value)
        if _says_nothing(node):
            return False
        for kind, operator in self._operators:
            if isinstance(node, kind):
                name = operator.__name__.removeprefix("operator_").replace("_", " ")
                for old, new in operator(node):
                    self.found.append((".".join(self._names), name, old, new))
        return True

    def on_leave(self, original_node: cst.CSTNode) -> None:
        if isinstance(original_node, cst.FunctionDef | cst.ClassDef):
            self._names.pop()


def _says_nothing(node: cst.CSTNode) -> bool:
    """What does not take part: types, imports, decorators, docstrings, and what cannot happen."""
    match node:
        case cst.Annotation() | cst.Import() | cst.ImportFrom() | cst.Decorator() | cst.Assert():
            return True
        case cst.Raise(exc=cst.Call(func=cst.Name("AssertionError"))):
            return True
        case cst.Expr(value=cst.SimpleString() | cst.ConcatenatedString()):
            return True
        case cst.Call(func=cst.Name("assert_never")):
            return True
        case cst.MatchCase(body=cst.IndentedBlock(body=[cst.SimpleStatementLine(body=[only])])):
            return _says_nothing(only.value if isinstance(only, cst.Expr) else only)
        case cst.If(test=cst.Name("TYPE_CHECKING")):
            return True
    return False


def _operators(language: Language) -> list[tuple[type, Operator]]:
    def emitted_text(node: cst.SimpleString | cst.FormattedStringText) -> Iterator[Change]:
        if isinstance(node, cst.FormattedStringText):
            for _, new in faults(node.value, language):
                yield node, new
        else:
            before = node.prefix + node.quote
            for _, new in faults(node.raw_value, language):
                yield node, before + new + node.quote

    return [
        *((kind, _in_place(o)) for kind, o in mutators.mutation_operators if _is_wanted(o)),
        (cst.SimpleString, emitted_text),
        (cst.FormattedStringText, emitted_text),
        (cst.FormattedString, swapped_parts),
        (cst.Integer, one_less),
        (cst.SimpleStatementLine, statement_lost),
        (cst.MatchCase, case_lost),
        (cst.List, element_lost),
        (cst.Call, argument_lost),
        (cst.Call, arguments_swapped),
        (cst.Slice, bound_lost),
        (cst.If, condition_negated),
        (cst.For, loop_skipped),
        (cst.CompFor, filter_lost),
        (cst.BooleanOperation, operand_lost),
    ]


def _is_wanted(operator: Callable[..., object]) -> bool:
    return operator not in _NOT_FROM_MUTMUT


def _in_place(operator: Callable[[Any], Any]) -> Operator:
    """An operator of mutmut, which yields what stands in the place of the node itself."""

    def changes(node: cst.CSTNode) -> Iterator[Change]:
        for new in operator(node):
            if not _is_same_number(node, new):
                yield node, new

    changes.__name__ = operator.__name__
    return changes


def _is_same_number(old: cst.CSTNode, new: cst.CSTNode) -> bool:
    """One more than 1e300 is 1e300."""
    numbers = isinstance(old, cst.BaseNumber) and isinstance(new, cst.BaseNumber)
    return numbers and old.evaluated_value == new.evaluated_value


def swapped_parts(node: cst.FormattedString) -> Iterator[Change]:
    """f"{a} < {b}" to f"{b} < {a}"."""
    places = [
        place
        for place, part in enumerate(node.parts)
        if isinstance(part, cst.FormattedStringExpression)
    ]
    for one, other in pairwise(places):
        parts = list(node.parts)
        parts[one], parts[other] = parts[other], parts[one]
        yield node, node.with_changes(parts=parts)


def one_less(node: cst.Integer) -> Iterator[Change]:
    if node.evaluated_value > 0:
        yield node, str(node.evaluated_value - 1)


def statement_lost(node: cst.SimpleStatementLine) -> Iterator[Change]:
    match node.body:
        case [cst.Expr(value=cst.Call()) | cst.Assign() | cst.AugAssign() as only]:
            yield only, "pass"


def case_lost(node: cst.MatchCase) -> Iterator[Change]:
    if not _says_nothing(node):
        yield node, ""


def element_lost(node: cst.List) -> Iterator[Change]:
    for place in range(len(node.elements)):
        rest = [*node.elements[:place], *node.elements[place + 1 :]]
        yield node, node.with_changes(elements=rest)


def argument_lost(node: cst.Call) -> Iterator[Change]:
    for place in range(len(node.args)):
        yield node, node.with_changes(args=[*node.args[:place], *node.args[place + 1 :]])


def arguments_swapped(node: cst.Call) -> Iterator[Change]:
    positional = [a for a in node.args if a.keyword is None and not a.star]
    for place in range(len(positional) - 1):
        args = list(node.args)
        one, other = args[place], args[place + 1]
        args[place] = one.with_changes(value=other.value)
        args[place + 1] = other.with_changes(value=one.value)
        yield node, node.with_changes(args=args)


def bound_lost(node: cst.Slice) -> Iterator[Change]:
    for bound in (node.lower, node.upper):
        if bound is not None:
            yield bound, ""


def condition_negated(node: cst.If) -> Iterator[Change]:
    inner = node.test.with_changes(lpar=[cst.LeftParen()], rpar=[cst.RightParen()])
    yield node.test, cst.UnaryOperation(cst.Not(), inner)


def loop_skipped(node: cst.For) -> Iterator[Change]:
    yield node.iter, "()"


def filter_lost(node: cst.CompFor) -> Iterator[Change]:
    for one in node.ifs:
        yield one, ""


def operand_lost(node: cst.BooleanOperation) -> Iterator[Change]:
    yield node, node.left
    yield node, node.right
