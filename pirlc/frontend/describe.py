"""Problems in words: one `match` for each group of codes, and the note on a rule's instance."""

from __future__ import annotations

from dataclasses import replace
from typing import assert_never

from pirlc.diagnostics import Diagnostic
from pirlc.frontend import problems
from pirlc.frontend.describe_names import describe_name
from pirlc.frontend.describe_sketch import describe_sketch
from pirlc.frontend.describe_syntax import describe_syntax
from pirlc.frontend.describe_types import describe_type
from pirlc.frontend.problems import Found, Problem
from pirlc.source import SourceText


def describe(found: Found, source: SourceText) -> Diagnostic:
    """The diagnostic of a problem in `source`."""
    diagnostic = describe_problem(found.problem, source)
    if found.context is None:
        return diagnostic
    return replace(diagnostic, notes=(*diagnostic.notes, found.context))


def describe_problem(problem: Problem, source: SourceText) -> Diagnostic:
    match problem:
        case (
            problems.UnknownCharacter()
            | problems.Unexpected()
            | problems.UnclosedText()
            | problems.UnclosedBracket()
            | problems.TooDeep()
            | problems.NotFinite()
            | problems.FileTooLong()
            | problems.ForeignSpelling()
            | problems.ChainedComparison()
            | problems.IncompleteConditional()
        ):
            return describe_syntax(problem, source)
        case (
            problems.TypeMismatch()
            | problems.LengthMismatch()
            | problems.IndexOutside()
            | problems.IndexNotLiteral()
            | problems.NotAValue()
            | problems.BranchNotAtom()
            | problems.NotFoldable()
            | problems.DiffTooShort()
            | problems.Incomparable()
            | problems.RawOfDiscrete()
        ):
            return describe_type(problem, source)
        case (
            problems.EndlessRule()
            | problems.UnguardedRecursion()
            | problems.NoProgram()
            | problems.SafeMissing()
            | problems.SameComponent()
            | problems.TooManyInstances()
            | problems.UnusedRule()
            | problems.UnusedParameter()
        ):
            return describe_sketch(problem, source)
        case (
            problems.DuplicateName()
            | problems.UnknownName()
            | problems.BadIdentifier()
            | problems.NameTooLong()
            | problems.ReservedName()
            | problems.HiddenName()
            | problems.RepeatedDeclaration()
            | problems.MissingDeclaration()
            | problems.EmptyRange()
            | problems.OutOfLimits()
            | problems.NotWhole()
            | problems.SafeOutside()
            | problems.GuessOutside()
            | problems.HoleConflict()
            | problems.RepeatedValue()
            | problems.WrongArgumentCount()
            | problems.WrongKind()
            | problems.HoleInProperty()
            | problems.RuleInProperty()
            | problems.ActionAsValue()
            | problems.UnknownWord()
            | problems.OnlyInProperties()
            | problems.MisshapenAction()
            | problems.MisplacedArgument()
        ):
            return describe_name(problem, source)
        case _:
            assert_never(problem)
