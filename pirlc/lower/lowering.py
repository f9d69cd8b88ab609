"""Program to controller.

Goals: buffers as long as the program looks back and no longer; a fold is one pass over a buffer
(a loop, or written out when it is short), never a running sum; every operation is the program's,
in its order; `if` becomes a branch; `let` becomes a named local.
Non-goals: simplifying terms, sharing common subterms, constant folding (compilers do what may be
done without changing a bit).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import assert_never

from pirlc.ir.controller import (
    Branch,
    Channel,
    Constant,
    Controller,
    Declare,
    DiscreteConstant,
    Element,
    Expression,
    Kind,
    Local,
    Loop,
    LoopIndex,
    Operation,
    Output,
    Parameter,
    Previous,
    Reading,
    Select,
    Set,
    Statement,
    expressions,
)
from pirlc.ir.operators import SIGNATURES, Operator
from pirlc.ir.policy import Fill, Interface, Program, Sensor
from pirlc.ir.terms import (
    ActionRef,
    Apply,
    Diff,
    DiscreteLiteral,
    Fold,
    FoldLambda,
    Hole,
    If,
    Let,
    Literal,
    LocalRef,
    ParameterRef,
    Peek,
    PreviousAction,
    RuleCall,
    SensorRef,
    Term,
    size,
    subterms,
    type_of,
)
from pirlc.ir.types import Bool, Discrete, Type
from pirlc.ir.types import Sequence as SequenceType
from pirlc.lower.blocks import At, Block, Names, Sequence, height, shared
from pirlc.lower.unused import without_unused
from pirlc.semantics.precision import middle, widened

UNROLLED = 8
"""Folds over at most so many elements are written out: cheaper than a loop, and still short."""

_TALLEST = 20
"""Expressions are cut into named parts at this height; compilers limit their nesting."""

_LONGEST_SELECT = 12
"""An `if` with larger sides (in nodes) becomes a branch, which is easier to read."""

_MENTIONED_TWICE = (Operator.MIN, Operator.MAX, Operator.CLIP, Operator.SIGN)

_ACCUMULATOR = {
    Operator.ADD: "sum",
    Operator.MULTIPLY: "product",
    Operator.MIN: "least",
    Operator.MAX: "greatest",
}

Value = Expression | Sequence
Scope = Mapping[str, Value]


def lower(program: Program) -> Controller:
    """The controller of a program."""
    return _Lowering(program.interface).lower(program)


def _kind(type_: Type) -> Kind:
    match type_:
        case Bool():
            return Kind.BOOL
        case Discrete():
            return Kind.DISCRETE
        case _:
            return Kind.REAL


class _Lowering:
    """The walk over one program's terms."""

    def __init__(self, interface: Interface) -> None:
        self._interface = interface

    def lower(self, program: Program) -> Controller:
        interface = self._interface
        taken = [
            *(sensor.name for sensor in interface.sensors),
            *(parameter.name for parameter in program.parameters),
        ]
        names = Names(taken)
        raws = [Local(names.fresh(a.name), _kind(a.type)) for a in interface.actions]
        block = Block(names)
        for raw, body in zip(raws, program.bodies, strict=True):
            self._result(body, raw, block)
        kept = {
            sub.action
            for body in program.bodies
            for sub in subterms(body)
            if isinstance(sub, PreviousAction)
        }
        statements = without_unused(tuple(block.statements), {raw.name for raw in raws})
        depths = _depths(statements)
        return Controller(
            name=interface.name,
            channels=tuple(self._channel(s, depths.get(s.name, 0)) for s in interface.sensors),
            parameters=tuple((p.name, p.value) for p in program.parameters),
            statements=statements,
            outputs=tuple(
                Output(
                    name=action.name,
                    component=action.component,
                    domain=action.domain,
                    safe=action.safe,
                    raw=raw,
                    keeps_previous=action.name in kept,
                )
                for action, raw in zip(interface.actions, raws, strict=True)
            ),
        )

    def _channel(self, sensor: Sensor, depth: int) -> Channel:
        low, high = widened(sensor.lower, sensor.upper)
        fill = self._interface.fill
        return Channel(
            name=sensor.name,
            index=sensor.index,
            lower=sensor.lower,
            upper=sensor.upper,
            low=low,
            high=high,
            missing=sensor.missing,
            fill=fill,
            initial=middle(sensor.lower, sensor.upper) if fill is Fill.FIRST else 0.0,
            depth=depth,
        )

    def _result(self, body: Term, local: Local, block: Block) -> None:
        """Computes an action's value into its local."""
        scope: Scope = {}
        while isinstance(body, Let):
            scope = self._bind(body, scope, block)
            body = body.body
        if isinstance(body, If) and not _is_short(body):
            block.statements.append(Declare(local))
            self._into(local, body, scope, block)
        else:
            block.statements.append(Declare(local, self._atom(body, scope, block)))

    def _named(self, term: Term, wish: str, scope: Scope, block: Block) -> Expression:
        """The atom as a leaf: a name, or what needs none."""
        while isinstance(term, Let):
            scope = self._bind(term, scope, block)
            term = term.body
        kind = _kind(type_of(term))
        if isinstance(term, If) and not _is_short(term):
            result = Local(block.names.fresh(wish), kind)
            block.statements.append(Declare(result))
            self._into(result, term, scope, block)
            return result
        return block.leaf(self._atom(term, scope, block), wish, kind)

    def _into(self, target: Local, term: Term, scope: Scope, block: Block) -> None:
        """Sets the local to the term's value."""
        while isinstance(term, Let):
            scope = self._bind(term, scope, block)
            term = term.body
        if isinstance(term, If) and not _is_short(term):
            condition = self._atom(term.condition, scope, block)
            consequent, alternative = block.inner(), block.inner()
            self._into(target, term.consequent, scope, consequent)
            self._into(target, term.alternative, scope, alternative)
            block.statements.append(
                Branch(condition, tuple(consequent.statements), tuple(alternative.statements))
            )
        else:
            value = self._atom(term, scope, block)
            if value != target:
                block.statements.append(Set(target, value))

    def _bind(self, term: Let, scope: Scope, block: Block) -> Scope:
        value: Value
        if _is_sequence(term.value):
            value = shared(self._sequence(term.value, scope, block), term.name)
        else:
            value = self._named(term.value, term.name, scope, block)
        return {**scope, term.name: value}

    def _atom(self, term: Term, scope: Scope, block: Block) -> Expression:
        """The value of a term that is not a sequence."""
        match term:
            case Literal(value):
                return Constant(value)
            case DiscreteLiteral(value):
                return DiscreteConstant(value)
            case ParameterRef(name):
                return Parameter(name)
            case LocalRef(name):
                bound = scope[name]
                assert not isinstance(bound, Sequence)
                return bound
            case PreviousAction(action, type_):
                return Previous(action, _kind(type_))
            case Apply(operator, arguments):
                return self._operation(
                    operator, [self._atom(a, scope, block) for a in arguments], block
                )
            case Peek(inner, index):
                sequence = self._sequence(inner, scope, block)
                return sequence.element(At(sequence.length + index), block)
            case Fold(operator, inner):
                return self._fold(operator, self._sequence(inner, scope, block), block)
            case FoldLambda():
                return self._fold_lambda(term, scope, block)
            case If():
                return self._select(term, scope, block)
            case Let():
                return self._atom(term.body, self._bind(term, scope, block), block)
            case SensorRef() | Diff():
                raise AssertionError("a sequence stands where an atom belongs")
            case ActionRef() | Hole() | RuleCall():
                raise AssertionError("a program's actions hold no choice and no action's name")
            case _:
                assert_never(term)

    def _operation(
        self, operator: Operator, arguments: list[Expression], block: Block
    ) -> Expression:
        most = 0 if operator in _MENTIONED_TWICE else _TALLEST
        cut = tuple(
            block.leaf(a, "part", _kind_of(a)) if height(a) > most else a for a in arguments
        )
        return Operation(operator, cut, 1 + max(map(height, cut)))

    def _select(self, term: If, scope: Scope, block: Block) -> Expression:
        condition = self._atom(term.condition, scope, block)
        if height(condition) > _TALLEST:
            condition = block.leaf(condition, "holds", Kind.BOOL)
        left, right = block.inner(), block.inner()
        consequent = self._atom(term.consequent, scope, left)
        alternative = self._atom(term.alternative, scope, right)
        tallest = max(height(condition), height(consequent), height(alternative))
        if not left.statements and not right.statements and tallest <= _TALLEST:
            return Select(condition, consequent, alternative, 1 + tallest)
        result = Local(block.names.fresh("chosen"), _kind(type_of(term)))
        block.statements.append(Declare(result))
        left.statements.append(Set(result, consequent))
        right.statements.append(Set(result, alternative))
        block.statements.append(Branch(condition, tuple(left.statements), tuple(right.statements)))
        return result

    def _sequence(self, term: Term, scope: Scope, block: Block) -> Sequence:
        match term:
            case SensorRef(name, length):
                return Sequence(length, lambda at, _: self._reading(name, length, at))
            case LocalRef(name):
                bound = scope[name]
                assert isinstance(bound, Sequence)
                return bound
            case Diff(inner):
                whole = shared(self._sequence(inner, scope, block), "element")

                def difference(at: At, inside: Block) -> Expression:
                    older, newer = whole.element(at, inside), whole.element(at.next(), inside)
                    return self._operation(Operator.SUBTRACT, [newer, older], inside)

                return Sequence(whole.length - 1, difference)
            case Apply(operator, arguments):
                # Atoms are computed here, once, and not again for each element.
                parts: list[Value] = [
                    self._sequence(a, scope, block)
                    if _is_sequence(a)
                    else block.leaf(self._atom(a, scope, block), "part", _kind(type_of(a)))
                    for a in arguments
                ]

                def elementwise(at: At, inside: Block) -> Expression:
                    values = [
                        part.element(at, inside) if isinstance(part, Sequence) else part
                        for part in parts
                    ]
                    return self._operation(operator, values, inside)

                lengths = [part.length for part in parts if isinstance(part, Sequence)]
                return Sequence(lengths[0], elementwise)
            case Let():
                return self._sequence(term.body, self._bind(term, scope, block), block)
            case _:
                raise AssertionError("an atom stands where a sequence belongs")

    def _reading(self, sensor: str, length: int, at: At) -> Expression:
        age = self._interface.latency + length - 1 - at.offset
        if at.index is None:
            return Reading(sensor, age)
        return Element(sensor, at.index, age)

    def _fold(self, operator: Operator, sequence: Sequence, block: Block) -> Expression:
        wish = _ACCUMULATOR[operator]
        folded = sequence.element(At(0), block)
        if sequence.length <= UNROLLED:
            for place in range(1, sequence.length):
                element = sequence.element(At(place), block)
                if operator in _MENTIONED_TWICE:
                    folded = block.leaf(folded, wish)
                folded = self._operation(operator, [element, folded], block)
            return folded
        accumulator = Local(block.names.fresh(wish), Kind.REAL)
        block.statements.append(Declare(accumulator, folded))
        index = LoopIndex(block.names.fresh("i"), sequence.length - 1)
        body = block.inner()
        element = sequence.element(At(1, index), body)
        step = self._operation(operator, [element, accumulator], body)
        body.statements.append(Set(accumulator, step))
        block.statements.append(Loop(index, tuple(body.statements)))
        return accumulator

    def _fold_lambda(self, term: FoldLambda, scope: Scope, block: Block) -> Expression:
        # The program text has the sequence before the initial value.
        sequence = self._sequence(term.sequence, scope, block)
        initial = self._named(term.initial, term.accumulator, scope, block)
        nested = any(isinstance(sub, Fold | FoldLambda) for sub in subterms(term.body))
        if sequence.length == 1 or (sequence.length <= UNROLLED and not nested):
            folded = initial
            for place in range(sequence.length):
                element = block.leaf(sequence.element(At(place), block), term.element)
                inner = {**scope, term.element: element, term.accumulator: folded}
                folded = self._named(term.body, term.accumulator, inner, block)
            return folded
        accumulator = Local(block.names.fresh(term.accumulator), Kind.REAL)
        block.statements.append(Declare(accumulator, initial))
        index = LoopIndex(block.names.fresh("i"), sequence.length)
        body = block.inner()
        element = body.leaf(sequence.element(At(0, index), body), term.element)
        inner = {**scope, term.element: element, term.accumulator: accumulator}
        self._into(accumulator, term.body, inner, body)
        block.statements.append(Loop(index, tuple(body.statements)))
        return accumulator


def _depths(statements: tuple[Statement, ...]) -> dict[str, int]:
    """How far back the controller looks at each sensor, the newest reading included."""
    depths: dict[str, int] = {}
    for part in expressions(statements):
        if isinstance(part, Reading | Element):
            depths[part.sensor] = max(depths.get(part.sensor, 0), part.age + 1)
    return depths


def _is_sequence(term: Term) -> bool:
    return isinstance(type_of(term), SequenceType)


def _is_short(term: If) -> bool:
    """Whether an `if` reads well as one expression."""
    below = [*subterms(term.consequent), *subterms(term.alternative)]
    return not any(isinstance(sub, If | Let | Fold | FoldLambda) for sub in below) and (
        size(term.consequent) + size(term.alternative) <= _LONGEST_SELECT
    )


def _kind_of(expression: Expression) -> Kind:
    match expression:
        case Local(_, kind) | Previous(_, kind):
            return kind
        case DiscreteConstant():
            return Kind.DISCRETE
        case Operation(operator):
            return _kind(SIGNATURES[operator].result)
        case Select(_, consequent):
            return _kind_of(consequent)
        case _:
            return Kind.REAL
