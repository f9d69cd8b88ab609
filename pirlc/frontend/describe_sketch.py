"""E04xx in words: the sketch as a whole."""

from __future__ import annotations

from typing import assert_never

from pirlc.diagnostics import Diagnostic, Label, Severity
from pirlc.frontend import problems_sketch as problems
from pirlc.frontend.problems_sketch import SketchProblem
from pirlc.source import SourceText


def describe_sketch(problem: SketchProblem, source: SourceText) -> Diagnostic:
    match problem:
        case problems.EndlessRule(span, name):
            return Diagnostic(
                "E0401",
                f"the rule `{name}` never ends",
                source,
                Label(span, "every alternative leads back to the rule"),
                help="add an alternative that does not",
            )
        case problems.UnguardedRecursion(span, cycle):
            return Diagnostic(
                "E0402",
                f"the rule `{cycle[0]}` is an alternative of itself",
                source,
                Label(span, "adds nothing to the program"),
                notes=(f"{' = '.join(cycle)}, without end",) if len(cycle) > 2 else (),
                help="leave this alternative out: what it allows, the others allow already",
            )
        case problems.NoProgram(span, action, rule):
            return Diagnostic(
                "E0403",
                f"no program is allowed for the action `{action}`",
                source,
                Label(span, f"its expression needs `{rule}`, which never ends"),
            )
        case problems.SafeMissing(span, action, cause, cause_span):
            return Diagnostic(
                "E0404",
                f"the action `{action}` needs a `safe` value",
                source,
                Label(span, "taken where the expression has no value"),
                (Label(cause_span, cause),),
                help=f"give one after its range: `action {action} : [low, high] safe value = ...`",
            )
        case problems.SameComponent(span, component, first, first_name):
            return Diagnostic(
                "E0405",
                f"two actions are component {component} of the environment's action",
                source,
                Label(span, f"component {component}"),
                (Label(first, f"{first_name} is component {component} too"),),
                help="without `= component` after the range, an action's place in the file counts",
            )
        case problems.TooManyInstances(span, name, limit):
            return Diagnostic(
                "E0406",
                f"the rule `{name}` is used at more than {limit} combinations of types",
                source,
                Label(span, "read once for each"),
                notes=("a sequence's length is part of its type",),
            )
        case problems.UnusedRule(span, name):
            return Diagnostic(
                "E0410",
                f"nothing uses the rule `{name}`",
                source,
                Label(span),
                severity=Severity.WARNING,
            )
        case problems.UnusedParameter(span, name):
            return Diagnostic(
                "E0411",
                f"nothing uses the parameter `{name}`",
                source,
                Label(span),
                notes=(f"`{name}` names this parameter; `?{name}` would be a hole of its own",),
                severity=Severity.WARNING,
            )
        case _:
            assert_never(problem)
