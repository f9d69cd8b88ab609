"""Expressions become typed terms: bidirectional checking, broadcasting, references.

A term that cannot be made is None; its problem has been reported, here or by `names`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from pirlc.frontend import problems_types as problems
from pirlc.frontend import syntax
from pirlc.frontend.discrete import discrete_use, undecided
from pirlc.frontend.guess import Guesser
from pirlc.frontend.instances import Instances
from pirlc.frontend.problems import Collector
from pirlc.frontend.scope import FOLD_CALLS, OPERATOR_CALLS, Scope
from pirlc.frontend.syntax import Expression, ungrouped
from pirlc.ir import terms
from pirlc.ir.operators import FOLDABLE, SIGNATURES, Operator
from pirlc.ir.policy import DEFAULT_BOUNDS, Choice, Property
from pirlc.ir.terms import Term, type_of
from pirlc.ir.types import Bool, Discrete, Real, Sequence, Type
from pirlc.source import Span


@dataclass(frozen=True)
class Context:
    """What an expression sees: local names, its holes, and the property it is in, if any."""

    locals: dict[str, Type]
    holes: dict[str, syntax.Hole]
    property: Property | None = None

    def binding(self, names: dict[str, Type]) -> Context:
        return replace(self, locals={**self.locals, **names})


@dataclass
class Expressions:
    """Reads the expressions of one file, asking `instances` for the rules they use."""

    scope: Scope
    collector: Collector
    guesser: Guesser
    instances: Instances

    # The two directions.

    def check(
        self, expression: Expression, expected: Type, context: Context, role: str
    ) -> Term | None:
        """The term of an expression that must have the expected type."""
        match expression:
            case syntax.Group(inner=inner):
                return self.check(inner, expected, context, role)
            case syntax.Number() if isinstance(expected, Discrete):
                return self._discrete(expression, expected, role)
            case syntax.Conditional():
                return self._conditional(expression, expected, context)
            case syntax.Binding(name=name, body=body, span=span):
                bound = self._bound(expression, expected, context)
                if bound is None:
                    return None
                inside = context.binding({name.text: type_of(bound)})
                inner_term = self.check(body, expected, inside, role)
                return inner_term and terms.Let(name.text, bound, inner_term, span)
            case syntax.Name(text=text) if self._is_rule(text, context):
                return self._rule(text, (), expected, expression.span)
            case syntax.Call(name=name, arguments=arguments) if self._is_rule(name.text, context):
                given = self._arguments(arguments, context)
                if given is None:
                    return None
                return self._rule(name.text, given, expected, expression.span)
            case _:
                term = self.infer(expression, context)
                return term and self._expect(term, expected, role)

    def infer(self, expression: Expression, context: Context) -> Term | None:
        """The term of an expression whose type its surroundings do not fix."""
        match expression:
            case syntax.Number(span=span):
                return terms.Literal(expression.value, span)
            case syntax.Hole():
                return _hole(expression, context)
            case syntax.Group(inner=inner):
                return self.infer(inner, context)
            case syntax.Name(text=text):
                return self._name(text, expression.span, context)
            case syntax.Unary(operator=Operator.NOT, operand=operand, span=span):
                inner_term = self.check(operand, Bool(), context, "the operand of `not`")
                return inner_term and terms.Apply(Operator.NOT, (inner_term,), span)
            case syntax.Unary(operator=operator, operand=operand, span=span):
                return self._arithmetic(operator, (operand,), span, context)
            case syntax.Binary():
                return self._binary(expression, context)
            case syntax.Call():
                return self._call(expression, context)
            case syntax.Conditional():
                guess = self._guess(expression, context) or Real()
                return self._conditional(expression, guess, context)
            case syntax.Binding(name=name, body=body, span=span):
                bound = self._bound(expression, None, context)
                if bound is None:
                    return None
                body_term = self.infer(body, context.binding({name.text: type_of(bound)}))
                return body_term and terms.Let(name.text, bound, body_term, span)
            case syntax.Lambda() | syntax.OperatorWord():
                return None

    def _expect(self, term: Term, expected: Type, role: str) -> Term | None:
        found = type_of(term)
        if found == expected:
            return term
        self.collector.add(
            problems.TypeMismatch(
                term.span, str(expected), str(found), role, _advice(expected, found)
            )
        )
        return None

    def _bound(
        self, binding: syntax.Binding, expected: Type | None, context: Context
    ) -> Term | None:
        """The value of a `let` whose body has the expected type, if that is known."""
        name, value = binding.name.text, binding.value
        if undecided(value):
            # The name itself must not settle what it is compared with.
            outside = replace(
                context, locals={n: t for n, t in context.locals.items() if n != name}
            )
            discrete = discrete_use(
                name, binding.body, expected, lambda side: self._guess(side, outside)
            )
            if discrete is not None:
                return self.check(value, discrete, context, f"the value of {name}")
        return self.infer(value, context)

    # Leaves.

    def _discrete(self, number: syntax.Number, expected: Discrete, role: str) -> Term | None:
        value = number.integer
        if value is None:
            advice = "write one of its values, as a whole number"
            self.collector.add(
                problems.TypeMismatch(number.span, str(expected), "real", role, advice)
            )
            return None
        if value not in expected.values:
            self.collector.add(problems.NotAValue(number.span, number.text, expected.values))
            return None
        return terms.DiscreteLiteral(value, expected, number.span)

    def _name(self, text: str, span: Span, context: Context) -> Term | None:
        scope, steps = self.scope, _steps(context)
        if text in context.locals:
            return terms.LocalRef(text, context.locals[text], span)
        if text in scope.sensors:
            return terms.SensorRef(text, steps or scope.window, span)
        if text in scope.parameters:
            return terms.ParameterRef(text, span)
        if text in scope.actions and context.property is not None:
            return terms.ActionRef(text, False, self._action_type(text, steps), span)
        if self._is_rule(text, context):
            return self._rule(text, (), None, span)
        return None

    def _action_type(self, name: str, steps: int | None) -> Type:
        """An action is an atom, and over several steps the sequence of its values."""
        return self.scope.actions[name].type if steps is None else Sequence(steps)

    # Operators.

    def _arithmetic(
        self, operator: Operator, operands: tuple[Expression, ...], span: Span, context: Context
    ) -> Term | None:
        arguments: list[Term] = []
        # Written flat: this is where deep expressions spend their stack.
        for operand in operands:
            term = self.infer(operand, context)
            if term is not None and self._is_numeric(term, operator):
                arguments.append(term)
        if len(arguments) < len(operands) or not self._same_lengths(arguments, span):
            return None
        return terms.Apply(operator, tuple(arguments), span)

    def _is_numeric(self, term: Term, operator: Operator) -> bool:
        found = type_of(term)
        if isinstance(found, Real | Sequence):
            return True
        name = "-" if operator is Operator.NEGATE else operator.value
        role = f"an operand of `{name}`"
        self.collector.add(problems.TypeMismatch(term.span, "real", str(found), role))
        return False

    def _same_lengths(self, arguments: list[Term], span: Span) -> bool:
        first: tuple[Term, int] | None = None
        for argument in arguments:
            type_ = type_of(argument)
            if not isinstance(type_, Sequence):
                continue
            if first is None:
                first = argument, type_.length
            elif first[1] != type_.length:
                self.collector.add(
                    problems.LengthMismatch(
                        span, first[0].span, first[1], argument.span, type_.length
                    )
                )
                return False
        return True

    def _binary(self, binary: syntax.Binary, context: Context) -> Term | None:
        operator, left, right = binary.operator, binary.left, binary.right
        if operator in (Operator.EQUAL, Operator.NOT_EQUAL):
            return self._equality(binary, context)
        signature = SIGNATURES[operator]
        if signature.result == Real():
            return self._arithmetic(operator, (left, right), binary.span, context)
        role = f"an operand of `{operator.value}`"
        left_term = self.check(left, signature.argument, context, role)
        right_term = self.check(right, signature.argument, context, role)
        if left_term is None or right_term is None:
            return None
        return terms.Apply(operator, (left_term, right_term), binary.span)

    def _equality(self, binary: syntax.Binary, context: Context) -> Term | None:
        sides = (binary.left, binary.right)
        guesses = [self._guess(side, context) for side in sides]
        discrete = [guess for guess in guesses if isinstance(guess, Discrete)]
        role = f"an operand of `{binary.operator.value}`"
        if len(set(discrete)) == 2 or (discrete and Bool() in guesses):
            left, right = map(str, guesses)
            self.collector.add(
                problems.Incomparable(binary.span, sides[0].span, left, sides[1].span, right)
            )
            return None
        wanted = discrete[0] if discrete else Real()
        made = [self.check(side, wanted, context, role) for side in sides]
        if made[0] is None or made[1] is None:
            return None
        return terms.Apply(binary.operator, (made[0], made[1]), binary.span)

    def _guess(self, expression: Expression, context: Context) -> Type | None:
        return self._guesser(context).type_of(expression, context.locals)

    def _guesser(self, context: Context) -> Guesser:
        if context.property is None:
            return self.guesser
        return Guesser(self.scope, in_property=True, steps=_steps(context))

    # Calls.

    def _call(self, call: syntax.Call, context: Context) -> Term | None:
        arguments, span = call.arguments, call.span
        match call.name.text:
            case "peek" if len(arguments) == 2:
                return self._peek(arguments[0], arguments[1], span, context)
            case "fold" if len(arguments) in (2, 3):
                return self._fold(call, context)
            case "diff" if len(arguments) == 1:
                return self._diff(arguments[0], span, context)
            case "previous" | "raw" if len(arguments) == 1:
                return self._action_call(call, context)
            case text if text in OPERATOR_CALLS:
                operator = OPERATOR_CALLS[text]
                if len(arguments) != SIGNATURES[operator].arity:
                    return None
                return self._arithmetic(operator, arguments, span, context)
            case text if self._is_rule(text, context):
                given = self._arguments(arguments, context)
                return None if given is None else self._rule(text, given, None, span)
            case _:
                return None

    def _sequence(self, expression: Expression, context: Context, role: str) -> Term | None:
        term = self.infer(expression, context)
        if term is None or isinstance(type_of(term), Sequence):
            return term
        found = str(type_of(term))
        self.collector.add(problems.TypeMismatch(term.span, "sequence", found, role))
        return None

    def _peek(
        self, sequence: Expression, position: Expression, span: Span, context: Context
    ) -> Term | None:
        term = self._sequence(sequence, context, "the first argument of `peek`")
        number = ungrouped(position)
        index = number.integer if isinstance(number, syntax.Number) else None
        if index is None:
            self.collector.add(problems.IndexNotLiteral(position.span))
        if term is None or index is None:
            return None
        type_ = type_of(term)
        assert isinstance(type_, Sequence)
        if not -type_.length <= index <= -1:
            self.collector.add(problems.IndexOutside(position.span, index, type_.length, term.span))
            return None
        return terms.Peek(term, index, span)

    def _diff(self, sequence: Expression, span: Span, context: Context) -> Term | None:
        term = self._sequence(sequence, context, "the argument of `diff`")
        if term is not None and type_of(term) == Sequence(1):
            self.collector.add(problems.DiffTooShort(span))
            return None
        return term and terms.Diff(term, span)

    def _fold(self, call: syntax.Call, context: Context) -> Term | None:
        first, sequence = ungrouped(call.arguments[0]), call.arguments[1]
        role = "the sequence of `fold`"
        match first:
            case syntax.Lambda() if len(call.arguments) == 3:
                real = {first.element.text: Real(), first.accumulator.text: Real()}
                body = self.check(
                    first.body, Real(), context.binding({**real}), "the body of a `fold`"
                )
                over = self._sequence(sequence, context, role)
                initial = self.check(
                    call.arguments[2], Real(), context, "the initial value of a `fold`"
                )
                if body is None or over is None or initial is None:
                    return None
                element, accumulator = first.element.text, first.accumulator.text
                return terms.FoldLambda(element, accumulator, body, over, initial, call.span)
            case syntax.OperatorWord(operator=operator) if operator in FOLDABLE:
                over = self._sequence(sequence, context, role)
                return over and terms.Fold(operator, over, call.span)
            case syntax.Name(text=text) if text in FOLD_CALLS and len(call.arguments) == 2:
                over = self._sequence(sequence, context, role)
                return over and terms.Fold(FOLD_CALLS[text], over, call.span)
            case syntax.Lambda():
                return None
            case syntax.OperatorWord(operator=operator):
                self.collector.add(problems.NotFoldable(first.span, operator.value))
            case syntax.Name(text=text):
                self.collector.add(problems.NotFoldable(first.span, text))
            case _:
                self.collector.add(problems.NotFoldable(first.span, "an expression"))
        return None

    def _action_call(self, call: syntax.Call, context: Context) -> Term | None:
        target = ungrouped(call.arguments[0])
        if not isinstance(target, syntax.Name) or target.text not in self.scope.actions:
            return None
        name, type_ = target.text, self._action_type(target.text, _steps(context))
        if call.name.text == "previous":
            return terms.PreviousAction(name, type_, call.span)
        if isinstance(self.scope.actions[name].domain, Choice):
            self.collector.add(problems.RawOfDiscrete(call.span, name))
            return None
        return terms.ActionRef(name, True, type_, call.span) if context.property else None

    def _conditional(
        self, conditional: syntax.Conditional, expected: Type, context: Context
    ) -> Term | None:
        condition = self.check(conditional.condition, Bool(), context, "the condition of an `if`")
        if isinstance(expected, Sequence):
            self.collector.add(problems.BranchNotAtom(conditional.span, str(expected)))
            return None
        role = "a branch of an `if`"
        consequent = self.check(conditional.consequent, expected, context, role)
        alternative = self.check(conditional.alternative, expected, context, role)
        if condition is None or consequent is None or alternative is None:
            return None
        return terms.If(condition, consequent, alternative, conditional.span)

    # Rules.

    def _is_rule(self, text: str, context: Context) -> bool:
        return text in self.scope.rules and text not in context.locals and not context.property

    def _arguments(
        self, arguments: tuple[Expression, ...], context: Context
    ) -> tuple[Term, ...] | None:
        made = [self.infer(argument, context) for argument in arguments]
        given = tuple(argument for argument in made if argument is not None)
        return given if len(given) == len(made) else None

    def _rule(
        self, name: str, arguments: tuple[Term, ...], result: Type | None, span: Span
    ) -> Term | None:
        rule = self.scope.rules[name]
        if len(arguments) != len(rule.formals):
            return None
        types = tuple(map(type_of, arguments))
        if result is None:
            result = self.guesser.rule(name, types) or Real()
        instance = self.instances.request(rule, types, result)
        if instance is None:
            return None
        return terms.RuleCall(instance.key, arguments, result, span)


def _steps(context: Context) -> int | None:
    """The length of every sensor and action in a property `over` several steps."""
    shell = context.property
    return shell.steps if shell is not None and shell.ranged else None


def _hole(hole: syntax.Hole, context: Context) -> Term | None:
    said = context.holes.get(hole.name.text)
    if said is None:
        return None
    lower, upper = DEFAULT_BOUNDS
    if said.bounds is not None:
        lower, upper = said.bounds.lower.value, said.bounds.upper.value
    guess = said.guess.value if said.guess else None
    return terms.Hole(hole.name.text, lower, upper, guess, hole.span)


def _advice(expected: Type, found: Type) -> str | None:
    match expected, found:
        case (Real(), Sequence()):
            return "take one element with `peek(..., -1)`, or all of them with `fold(+, ...)`"
        case (Discrete(), Real()):
            return "write `if ... then ... else ...` over its values, as whole numbers"
        case (Real(), Bool()):
            return "write `if ... then 1 else 0`"
        case (Bool(), Real()):
            return "write a comparison, such as `... > 0`"
        case _:
            return None
