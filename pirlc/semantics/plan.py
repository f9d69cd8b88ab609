"""Terms as straight-line code over arrays: the compiler of the vectorised evaluator.

Goals: each operation once for all histories; each operation once for the whole window where its
arguments look alike from every step (`setpoint - h` over the readings of `h` serves all windows
that a reading lies in); no operation twice on the same arguments; operations on parameters alone
out of the loop. Non-goals: any change of a result bit, so nothing is reassociated or folded.

A value is held in a *register*: a single number, or an array over the histories. A sequence is
either *shifted*, one array in which element j of the histories begins at place j, or *rows*, an
atom for each element.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import assert_never

from pirlc.ir.operators import SIGNATURES, Operator
from pirlc.ir.policy import FixedParameter, Program, ProgramTemplate
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
)
from pirlc.ir.types import Bool, Discrete, Type
from pirlc.semantics.histories import Layout


class Number(Enum):
    """What a register holds: reals in the working precision, discrete values in binary64, bits."""

    REAL = "real"
    DISCRETE = "discrete"
    BOOL = "bool"


@dataclass(frozen=True, slots=True)
class Constant:
    value: float


@dataclass(frozen=True, slots=True)
class ParameterValue:
    name: str


@dataclass(frozen=True, slots=True)
class SensorReadings:
    """A sensor's flat array, or with `row` one row of a gathered one."""

    name: str
    row: int | None = None


@dataclass(frozen=True, slots=True)
class PreviousActions:
    name: str


Source = Constant | ParameterValue | SensorReadings | PreviousActions


@dataclass(frozen=True, slots=True)
class Atom:
    """A register, seen from `offset` places on."""

    register: int
    offset: int = 0


@dataclass(frozen=True, slots=True)
class Shifted:
    """A sequence whose element j is `Atom(register, j)`."""

    register: int
    length: int


Rows = tuple[Atom, ...]
Value = Atom | Shifted | Rows


class Select(Enum):
    """The one operation that is no `Operator`: condition, consequent, alternative."""

    SELECT = "if"


Operation = Operator | Select


@dataclass(frozen=True, slots=True)
class Register:
    """`single`: one number for all histories. `extra`: so many places more than histories."""

    number: Number
    single: bool
    extra: int = 0
    source: Source | None = None


@dataclass(frozen=True, slots=True)
class Instruction:
    operation: Operation
    operands: tuple[Atom, ...]
    result: int


@dataclass(frozen=True)
class Code:
    """`prelude` runs once for each parameter vector, `body` for each block of histories."""

    registers: tuple[Register, ...]
    prelude: tuple[Instruction, ...]
    body: tuple[Instruction, ...]
    outputs: tuple[Atom, ...]


def compile_code(template: ProgramTemplate | Program, layout: Layout) -> Code:
    """The code that computes the raw result of every action."""
    builder = _Builder(layout)
    for parameter in template.parameters:
        if isinstance(parameter, FixedParameter):
            builder.fixed[parameter.name] = parameter.value
    outputs = []
    for body in template.bodies:
        output = builder.value(body, {})
        assert isinstance(output, Atom)
        outputs.append(output)
    return _without_dead_code(builder, tuple(outputs))


def _number(type_: Type) -> Number:
    match type_:
        case Bool():
            return Number.BOOL
        case Discrete():
            return Number.DISCRETE
        case _:
            return Number.REAL


@dataclass
class _Builder:
    layout: Layout
    fixed: dict[str, float] = field(default_factory=dict)
    registers: list[Register] = field(default_factory=list)
    instructions: list[Instruction] = field(default_factory=list)
    known: dict[object, int] = field(default_factory=dict)

    def value(self, term: Term, scope: Mapping[str, Value]) -> Value:
        match term:
            case Literal(number):
                return self.constant(number, Number.REAL)
            case DiscreteLiteral(number):
                return self.constant(float(number), Number.DISCRETE)
            case ParameterRef(name):
                if name in self.fixed:
                    return self.constant(self.fixed[name], Number.REAL)
                return self.load(Register(Number.REAL, True, source=ParameterValue(name)))
            case SensorRef(name, length):
                return self.sensor(name, length)
            case LocalRef(name):
                return scope[name]
            case PreviousAction(action, type_):
                source = PreviousActions(action)
                return self.load(Register(_number(type_), False, source=source))
            case Apply(operator, arguments):
                return self.apply(operator, [self.value(a, scope) for a in arguments])
            case Peek(sequence, index):
                elements = self.elements(self.value(sequence, scope))
                return elements[index]
            case Fold(operator, sequence):
                folded, *rest = self.elements(self.value(sequence, scope))
                for element in rest:
                    folded = self.emit(operator, (element, folded))
                return folded
            case FoldLambda(element_name, accumulator_name, body, sequence, initial):
                accumulator = self.value(initial, scope)
                for element in self.elements(self.value(sequence, scope)):
                    inner = {**scope, element_name: element, accumulator_name: accumulator}
                    accumulator = self.value(body, inner)
                return accumulator
            case Diff(sequence):
                return self.differences(self.value(sequence, scope))
            case If(condition, consequent, alternative):
                return self.emit(
                    Select.SELECT,
                    tuple(self.atom(part, scope) for part in (condition, consequent, alternative)),
                )
            case Let(name, value, body):
                return self.value(body, {**scope, name: self.value(value, scope)})
            case Hole() | RuleCall() | ActionRef():
                raise AssertionError("a program template's actions hold no choice")
            case _:
                assert_never(term)

    def atom(self, term: Term, scope: Mapping[str, Value]) -> Atom:
        value = self.value(term, scope)
        assert isinstance(value, Atom)
        return value

    def constant(self, value: float, number: Number) -> Atom:
        return self.load(Register(number, True, source=Constant(value)))

    def load(self, register: Register) -> Atom:
        source = register.source
        # Zeros of either sign compare equal, and must not become one.
        key = (register.number, _constant_key(source) if isinstance(source, Constant) else source)
        if key not in self.known:
            self.known[key] = len(self.registers)
            self.registers.append(register)
        return Atom(self.known[key])

    def sensor(self, name: str, length: int) -> Value:
        match self.layout:
            case Layout.FLAT:
                register = Register(Number.REAL, False, length - 1, SensorReadings(name))
                return Shifted(self.load(register).register, length)
            case Layout.GATHERED:
                return tuple(
                    self.load(Register(Number.REAL, False, source=SensorReadings(name, row)))
                    for row in range(length)
                )

    def elements(self, sequence: Value) -> Rows:
        match sequence:
            case Shifted(register, length):
                return tuple(Atom(register, j) for j in range(length))
            case tuple():
                return sequence
            case Atom():
                raise AssertionError("an atom where a sequence belongs")
            case _:
                assert_never(sequence)

    def apply(self, operator: Operator, arguments: list[Value]) -> Value:
        atoms = [a for a in arguments if isinstance(a, Atom)]
        if len(atoms) == len(arguments):
            return self.emit(operator, tuple(atoms))
        shifted = [a for a in arguments if isinstance(a, Shifted)]
        if len(shifted) + len(atoms) == len(arguments) and all(
            self.registers[a.register].single for a in atoms
        ):
            length = shifted[0].length
            operands = tuple(
                a if isinstance(a, Atom) else Atom(a.register)
                for a in arguments
                if not isinstance(a, tuple)
            )
            return Shifted(self.emit(operator, operands, length - 1).register, length)
        rows = [a if isinstance(a, Atom) else self.elements(a) for a in arguments]
        length = next(len(row) for row in rows if not isinstance(row, Atom))
        return tuple(
            self.emit(operator, tuple(r if isinstance(r, Atom) else r[j] for r in rows))
            for j in range(length)
        )

    def differences(self, sequence: Value) -> Value:
        if isinstance(sequence, Shifted):
            operands = (Atom(sequence.register, 1), Atom(sequence.register))
            length = sequence.length - 1
            return Shifted(self.emit(Operator.SUBTRACT, operands, length - 1).register, length)
        elements = self.elements(sequence)
        return tuple(
            self.emit(Operator.SUBTRACT, (elements[j + 1], elements[j]))
            for j in range(len(elements) - 1)
        )

    def emit(self, operation: Operation, operands: tuple[Atom, ...], extra: int = 0) -> Atom:
        key = (operation, operands, extra)
        if key not in self.known:
            used = [self.registers[operand.register] for operand in operands]
            match operation:
                case Select():
                    number = used[1].number
                case Operator():
                    number = _number(SIGNATURES[operation].result)
            self.known[key] = len(self.registers)
            self.instructions.append(Instruction(operation, operands, len(self.registers)))
            self.registers.append(Register(number, all(r.single for r in used), extra))
        return Atom(self.known[key])


def _constant_key(constant: Constant) -> str:
    return constant.value.hex()


def _without_dead_code(builder: _Builder, outputs: tuple[Atom, ...]) -> Code:
    """Only what the outputs need, the registers numbered anew."""
    needed = {output.register for output in outputs}
    kept = []
    for instruction in reversed(builder.instructions):
        if instruction.result in needed:
            kept.append(instruction)
            needed.update(operand.register for operand in instruction.operands)
    kept.reverse()
    number = {old: new for new, old in enumerate(sorted(needed))}

    def renumbered(atom: Atom) -> Atom:
        return Atom(number[atom.register], atom.offset)

    instructions = [
        Instruction(i.operation, tuple(map(renumbered, i.operands)), number[i.result]) for i in kept
    ]
    registers = tuple(builder.registers[old] for old in sorted(needed))
    return Code(
        registers=registers,
        prelude=tuple(i for i in instructions if registers[i.result].single),
        body=tuple(i for i in instructions if not registers[i.result].single),
        outputs=tuple(map(renumbered, outputs)),
    )
