"""Problems in words: one function for each group of codes, and the note on a rule's instance."""

from __future__ import annotations

from dataclasses import replace
from typing import assert_never

from pirlc.diagnostics import Diagnostic
from pirlc.frontend.describe_names import describe_name
from pirlc.frontend.describe_sketch import describe_sketch
from pirlc.frontend.describe_syntax import describe_syntax
from pirlc.frontend.describe_types import describe_type
from pirlc.frontend.problems import Found, Problem
from pirlc.frontend.problems_names import NameProblem
from pirlc.frontend.problems_sketch import SketchProblem
from pirlc.frontend.problems_syntax import SyntaxProblem
from pirlc.frontend.problems_types import TypeProblem
from pirlc.source import SourceText


def describe(found: Found, source: SourceText) -> Diagnostic:
    """The diagnostic of a problem in `source`."""
    diagnostic = describe_problem(found.problem, source)
    if found.context is None:
        return diagnostic
    return replace(diagnostic, notes=(*diagnostic.notes, found.context))


def describe_problem(problem: Problem, source: SourceText) -> Diagnostic:
    if isinstance(problem, SyntaxProblem):
        return describe_syntax(problem, source)
    if isinstance(problem, NameProblem):
        return describe_name(problem, source)
    if isinstance(problem, TypeProblem):
        return describe_type(problem, source)
    if isinstance(problem, SketchProblem):
        return describe_sketch(problem, source)
    assert_never(problem)
