"""Every kind of mistake in a .pirl file, as a small value; `describe` puts them into words.

`span` is where the mistake is; other spans are places that explain it. Types are given as their
text (`str(type)`).
"""

from __future__ import annotations

from dataclasses import dataclass

from pirlc.source import Span

# E01xx: the text does not follow the grammar.


@dataclass(frozen=True)
class UnknownCharacter:
    span: Span
    character: str


@dataclass(frozen=True)
class Unexpected:
    """`expected` and `found` are in words; `inside` is the keyword of the declaration."""

    span: Span
    found: str
    expected: tuple[str, ...]
    inside: str | None
    help: str | None = None


@dataclass(frozen=True)
class UnclosedText:
    span: Span


@dataclass(frozen=True)
class UnclosedBracket:
    """`span` is the opening bracket, `end` the place where the closing one is missed."""

    span: Span
    bracket: str
    end: Span


@dataclass(frozen=True)
class TooDeep:
    span: Span
    limit: int


@dataclass(frozen=True)
class NotFinite:
    span: Span
    text: str


@dataclass(frozen=True)
class FileTooLong:
    length: int
    limit: int


@dataclass(frozen=True)
class ForeignSpelling:
    """Another language's spelling of something that this one has."""

    span: Span
    written: str
    meant: str


@dataclass(frozen=True)
class ChainedComparison:
    span: Span
    operator: str


@dataclass(frozen=True)
class IncompleteConditional:
    """`missing` is ``then`` or ``else``."""

    span: Span
    missing: str
    opening: Span


SyntaxProblem = (
    UnknownCharacter
    | Unexpected
    | UnclosedText
    | UnclosedBracket
    | TooDeep
    | NotFinite
    | FileTooLong
    | ForeignSpelling
    | ChainedComparison
    | IncompleteConditional
)

# E02xx: names and declarations.


@dataclass(frozen=True)
class DuplicateName:
    span: Span
    name: str
    first: Span


@dataclass(frozen=True)
class UnknownName:
    """`wanted` says what kind of name belongs there; `close` is a known name like it."""

    span: Span
    name: str
    wanted: str
    close: str | None


@dataclass(frozen=True)
class BadIdentifier:
    span: Span
    name: str


@dataclass(frozen=True)
class NameTooLong:
    span: Span
    name: str
    limit: int


@dataclass(frozen=True)
class ReservedName:
    span: Span
    name: str


@dataclass(frozen=True)
class HiddenName:
    """A `let`, a lambda or a rule's argument uses the name of a declaration."""

    span: Span
    name: str
    kind: str
    first: Span


@dataclass(frozen=True)
class RepeatedDeclaration:
    span: Span
    keyword: str
    first: Span


@dataclass(frozen=True)
class MissingDeclaration:
    """`keyword` is ``policy`` or ``action``; `span` is the end of the file."""

    span: Span
    keyword: str


@dataclass(frozen=True)
class EmptyRange:
    span: Span
    lower: str
    upper: str
    point_allowed: bool


@dataclass(frozen=True)
class OutOfLimits:
    """`allowed` says what numbers the place takes."""

    span: Span
    what: str
    text: str
    allowed: str


@dataclass(frozen=True)
class NotWhole:
    span: Span
    what: str
    text: str


@dataclass(frozen=True)
class SafeOutside:
    span: Span
    action: str
    text: str
    domain: str
    domain_span: Span


@dataclass(frozen=True)
class GuessOutside:
    span: Span
    name: str
    text: str
    bounds: str
    bounds_span: Span


@dataclass(frozen=True)
class HoleConflict:
    span: Span
    name: str
    first: Span


@dataclass(frozen=True)
class RepeatedValue:
    span: Span
    text: str
    first: Span


@dataclass(frozen=True)
class WrongArgumentCount:
    span: Span
    name: str
    usage: str
    given: int


@dataclass(frozen=True)
class WrongKind:
    """A known name where a name of another kind belongs."""

    span: Span
    name: str
    kind: str
    wanted: str


@dataclass(frozen=True)
class HoleInProperty:
    span: Span
    name: str


@dataclass(frozen=True)
class RuleInProperty:
    span: Span
    name: str


@dataclass(frozen=True)
class ActionAsValue:
    span: Span
    name: str


@dataclass(frozen=True)
class UnknownWord:
    """A word that the keyword before it does not know."""

    span: Span
    keyword: str
    word: str
    known: tuple[str, ...]
    close: str | None


@dataclass(frozen=True)
class OnlyInProperties:
    span: Span
    name: str


@dataclass(frozen=True)
class MisshapenAction:
    """`reason` says what is wrong with the `safe` and `=` parts of an action."""

    span: Span
    action: str
    reason: str


@dataclass(frozen=True)
class MisplacedArgument:
    """An operator or a lambda that is not the first argument of `fold`."""

    span: Span
    what: str


NameProblem = (
    DuplicateName
    | UnknownName
    | BadIdentifier
    | NameTooLong
    | ReservedName
    | HiddenName
    | RepeatedDeclaration
    | MissingDeclaration
    | EmptyRange
    | OutOfLimits
    | NotWhole
    | SafeOutside
    | GuessOutside
    | HoleConflict
    | RepeatedValue
    | WrongArgumentCount
    | WrongKind
    | HoleInProperty
    | RuleInProperty
    | ActionAsValue
    | UnknownWord
    | OnlyInProperties
    | MisshapenAction
    | MisplacedArgument
)

# E03xx: types.


@dataclass(frozen=True)
class TypeMismatch:
    """`role` says what the expression is there for, such as "the operand of `and`"."""

    span: Span
    expected: str
    found: str
    role: str
    help: str | None = None


@dataclass(frozen=True)
class LengthMismatch:
    span: Span
    left: Span
    left_length: int
    right: Span
    right_length: int


@dataclass(frozen=True)
class IndexOutside:
    span: Span
    index: int
    length: int
    sequence: Span


@dataclass(frozen=True)
class IndexNotLiteral:
    span: Span


@dataclass(frozen=True)
class NotAValue:
    span: Span
    text: str
    values: tuple[int, ...]


@dataclass(frozen=True)
class BranchNotAtom:
    span: Span
    found: str


@dataclass(frozen=True)
class NotFoldable:
    span: Span
    text: str


@dataclass(frozen=True)
class DiffTooShort:
    span: Span


@dataclass(frozen=True)
class Incomparable:
    span: Span
    left: Span
    left_type: str
    right: Span
    right_type: str


@dataclass(frozen=True)
class RawOfDiscrete:
    span: Span
    name: str


TypeProblem = (
    TypeMismatch
    | LengthMismatch
    | IndexOutside
    | IndexNotLiteral
    | NotAValue
    | BranchNotAtom
    | NotFoldable
    | DiffTooShort
    | Incomparable
    | RawOfDiscrete
)

# E04xx: the sketch as a whole.


@dataclass(frozen=True)
class EndlessRule:
    span: Span
    name: str


@dataclass(frozen=True)
class UnguardedRecursion:
    """Expanding `cycle` returns to its first rule without adding anything to the program."""

    span: Span
    cycle: tuple[str, ...]


@dataclass(frozen=True)
class NoProgram:
    span: Span
    action: str
    rule: str


@dataclass(frozen=True)
class SafeMissing:
    """`cause` says what may leave the action without a value, at `cause_span`."""

    span: Span
    action: str
    cause: str
    cause_span: Span


@dataclass(frozen=True)
class SameComponent:
    span: Span
    component: int
    first: Span
    first_name: str


@dataclass(frozen=True)
class TooManyInstances:
    span: Span
    name: str
    limit: int


@dataclass(frozen=True)
class UnusedRule:
    span: Span
    name: str


@dataclass(frozen=True)
class UnusedParameter:
    span: Span
    name: str


SketchProblem = (
    EndlessRule
    | UnguardedRecursion
    | NoProgram
    | SafeMissing
    | SameComponent
    | TooManyInstances
    | UnusedRule
    | UnusedParameter
)

Problem = SyntaxProblem | NameProblem | TypeProblem | SketchProblem


@dataclass(frozen=True)
class Found:
    """A problem, and for one inside a rule which use of the rule it is about (`context`)."""

    problem: Problem
    context: str | None = None


class Collector:
    """Gathers problems, each once: a rule is read once for each combination of types.

    Beyond `LIMIT` problems nobody reads on, and none is added.
    """

    LIMIT = 100

    def __init__(self) -> None:
        self.found: list[Found] = []
        self.context: str | None = None
        self._seen: set[tuple[type, object]] = set()

    def add(self, problem: Problem) -> None:
        key = (type(problem), getattr(problem, "span", None))
        if key not in self._seen and not self.full:
            self._seen.add(key)
            self.found.append(Found(problem, self.context))

    @property
    def full(self) -> bool:
        return len(self.found) >= self.LIMIT
