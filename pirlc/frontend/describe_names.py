"""E02xx in words: names and declarations."""

from __future__ import annotations

from typing import assert_never

from pirlc.diagnostics import Diagnostic, Label
from pirlc.frontend import problems_names as problems
from pirlc.frontend.problems_names import NameProblem
from pirlc.source import SourceText


def describe_name(problem: NameProblem, source: SourceText) -> Diagnostic:
    match problem:
        case problems.DuplicateName(span, name, first):
            return Diagnostic(
                "E0201",
                f"`{name}` is declared twice",
                source,
                Label(span, "declared again"),
                (Label(first, "first declared here"),),
            )
        case problems.UnknownName(span, name, wanted, close):
            return Diagnostic(
                "E0202",
                f"no {wanted} `{name}` is declared",
                source,
                Label(span, "not known"),
                help=f"did you mean `{close}`?" if close else None,
            )
        case problems.BadIdentifier(span, name):
            return Diagnostic(
                "E0203",
                f"`{_shown(name)}` cannot be a name",
                source,
                Label(span),
                help="a name is a letter from a to z, then letters, digits and `_`",
            )
        case problems.NameTooLong(span, name, limit):
            return Diagnostic(
                "E0204",
                f"the name `{_shown(name)}` is longer than {limit} characters",
                source,
                Label(span, f"{len(name)} characters"),
            )
        case problems.ReservedName(span, name):
            return Diagnostic(
                "E0205",
                f"`{name}` is the name of a built-in function",
                source,
                Label(span, "choose another name"),
            )
        case problems.HiddenName(span, name, kind, first):
            return Diagnostic(
                "E0206",
                f"the local name `{name}` would hide {kind}",
                source,
                Label(span, "choose another name"),
                (Label(first, "declared here"),),
            )
        case problems.RepeatedDeclaration(span, keyword, first):
            return Diagnostic(
                "E0207",
                f"`{keyword}` is given twice",
                source,
                Label(span, "given again"),
                (Label(first, "first given here"),),
            )
        case problems.MissingDeclaration(span, keyword):
            examples = {
                "policy": "begin the file with `policy name`",
                "action": "add `action name : [low, high] = expression`",
            }
            return Diagnostic(
                "E0208",
                f"the file declares no {keyword}",
                source,
                Label(span, "the file ends here"),
                help=examples[keyword],
            )
        case problems.EmptyRange(span, lower, upper, point_allowed):
            relation = "must not be above" if point_allowed else "must be below"
            return Diagnostic(
                "E0209",
                f"the range [{lower}, {upper}] is empty",
                source,
                Label(span, f"the first number {relation} the second"),
            )
        case problems.OutOfLimits(span, what, text, allowed):
            return Diagnostic(
                "E0210",
                f"{what} cannot be {_shown(text)}",
                source,
                Label(span, f"must be {allowed}"),
            )
        case problems.NotWhole(span, what, text):
            return Diagnostic(
                "E0211",
                f"{what} must be a whole number",
                source,
                Label(span, f"`{text}` is not written as one"),
            )
        case problems.SafeOutside(span, action, text, domain, domain_span):
            return Diagnostic(
                "E0212",
                f"the safe value {text} is not an action of {action}",
                source,
                Label(span, f"not in {domain}"),
                (Label(domain_span, "the actions there are"),),
            )
        case problems.GuessOutside(span, name, text, bounds, bounds_span):
            others = () if bounds_span == span else (Label(bounds_span, "its bounds"),)
            return Diagnostic(
                "E0213",
                f"the guess {text} for `{name}` is outside its bounds",
                source,
                Label(span, f"not in {bounds}"),
                others,
                help=None if others else f"give bounds: `?({name} in [low, high] = {text})`",
            )
        case problems.HoleConflict(span, name, first):
            return Diagnostic(
                "E0214",
                f"the hole `?{name}` is given in two different ways",
                source,
                Label(span, "other bounds or another guess"),
                (Label(first, "given here"),),
                notes=("a hole's name stands for one parameter throughout its alternative",),
                help=f"write `?{name}` for another mention of it, or choose another name",
            )
        case problems.RepeatedValue(span, text, first):
            return Diagnostic(
                "E0215",
                f"the value {text} is listed twice",
                source,
                Label(span, "listed again"),
                (Label(first, "first listed here"),),
            )
        case problems.WrongArgumentCount(span, name, usage, given):
            number = {0: "without arguments", 1: "with 1 argument"}.get(
                given, f"with {given} arguments"
            )
            return Diagnostic(
                "E0216",
                f"`{name}` cannot be used {number}",
                source,
                Label(span),
                help=f"it is used as `{usage}`",
            )
        case problems.WrongKind(span, name, kind, wanted):
            subject = f"`{name}` is {kind}" if name else f"this is {kind}"
            return Diagnostic("E0217", f"{subject}, where {wanted} belongs", source, Label(span))
        case problems.HoleInProperty(span, name):
            return Diagnostic(
                "E0218",
                f"a property cannot have the hole `?{name}`",
                source,
                Label(span, "nothing is left open in a property"),
                help=f"declare `param {name} in [low, high]` to share a parameter with it",
            )
        case problems.RuleInProperty(span, name):
            return Diagnostic(
                "E0219",
                f"a property cannot use the rule `{name}`",
                source,
                Label(span, "a rule is a choice, and nothing is left open in a property"),
                help="write out what is meant, with `let` where it repeats",
            )
        case problems.ActionAsValue(span, name):
            return Diagnostic(
                "E0220",
                f"the action `{name}` has no value yet here",
                source,
                Label(span, "only properties speak of an action's value"),
                help=f"`previous({name})` is its value in the step before",
            )
        case problems.UnknownWord(span, keyword, word, known, close):
            quoted = [f"`{one}`" for one in known]
            words = " or ".join([", ".join(quoted[:-1]), quoted[-1]] if quoted[1:] else quoted)
            return Diagnostic(
                "E0221",
                f"`{keyword}` is followed by {words}, not by `{_shown(word)}`",
                source,
                Label(span),
                help=f"did you mean `{close}`?" if close else None,
            )
        case problems.OnlyInProperties(span, name):
            return Diagnostic(
                "E0222",
                f"`{name}` can be used in properties only",
                source,
                Label(span),
                help="`previous(action)` is an action's value in the step before",
            )
        case problems.MisshapenAction(span, action, reason):
            return Diagnostic(
                "E0223",
                f"the action `{action}` cannot be read: {reason}",
                source,
                Label(span),
                help="write `action name : [low, high] = component safe value = expression`; "
                "`= component` and `safe value` may be left out",
            )
        case problems.MisplacedArgument(span, what):
            return Diagnostic(
                "E0224",
                f"{what} can only be the first argument of `fold`",
                source,
                Label(span),
            )
        case _:
            assert_never(problem)


def _shown(text: str) -> str:
    plain = "".join(c if c.isprintable() else "?" for c in text)
    return plain if len(plain) <= 40 else plain[:37] + "..."
