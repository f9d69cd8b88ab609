"""What a translation unit of emitted C declares: types, constants, two functions."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

from pirlc.semantics.precision import BINARY32, BINARY64, Precision
from pirlc.verify.emitted.nodes import NotUnderstood

if TYPE_CHECKING:
    from pycparser import c_ast


class CType(Enum):
    """The arithmetic types that emitted C uses."""

    DOUBLE = "double"
    FLOAT = "float"
    BOOL = "_Bool"
    UNSIGNED_CHAR = "unsigned char"
    INT = "int"
    UNSIGNED = "unsigned int"
    LONG = "long"
    UNSIGNED_LONG = "unsigned long"
    LONG_LONG = "long long"
    UNSIGNED_LONG_LONG = "unsigned long long"

    @property
    def precision(self) -> Precision | None:
        return {CType.DOUBLE: BINARY64, CType.FLOAT: BINARY32}.get(self)


LEAST_RANGE = {
    CType.BOOL: (0, 1),
    CType.UNSIGNED_CHAR: (0, 2**8 - 1),
    CType.INT: (-(2**15 - 1), 2**15 - 1),
    CType.UNSIGNED: (0, 2**16 - 1),
    CType.LONG: (-(2**31 - 1), 2**31 - 1),
    CType.UNSIGNED_LONG: (0, 2**32 - 1),
    CType.LONG_LONG: (-(2**63 - 1), 2**63 - 1),
    CType.UNSIGNED_LONG_LONG: (0, 2**64 - 1),
}
"""What every C99 can hold."""

USUAL_RANGE = {
    **LEAST_RANGE,
    CType.INT: (-(2**31 - 1), 2**31 - 1),
    CType.UNSIGNED: (0, 2**32 - 1),
}
"""The same where `int` has 32 bits."""

_SPELLINGS = {
    "double": CType.DOUBLE,
    "float": CType.FLOAT,
    "_Bool": CType.BOOL,
    "unsigned char": CType.UNSIGNED_CHAR,
    "int": CType.INT,
    "unsigned": CType.UNSIGNED,
    "unsigned int": CType.UNSIGNED,
    "long": CType.LONG,
    "unsigned long": CType.UNSIGNED_LONG,
    "long long": CType.LONG_LONG,
    "unsigned long long": CType.UNSIGNED_LONG_LONG,
}


@dataclass(frozen=True)
class Member:
    """Of a struct; `length` is None for what is no array."""

    name: str
    type: CType
    length: int | None


@dataclass(frozen=True)
class Function:
    """`parameters` are names with the structs that they point to, and whether those are const."""

    name: str
    result: str
    parameters: tuple[tuple[str, str, bool], ...]
    body: c_ast.Compound


@dataclass
class Unit:
    """A translation unit. `defaults` holds the values of the one constant, `declared` the
    functions and objects that are known without a definition."""

    structs: dict[str, tuple[Member, ...]] = field(default_factory=dict)
    types: dict[str, CType] = field(default_factory=dict)
    functions: dict[str, Function] = field(default_factory=dict)
    constants: dict[str, tuple[str, c_ast.InitList]] = field(default_factory=dict)
    declared: set[str] = field(default_factory=set)
    prototypes: dict[str, tuple[str, tuple[tuple[str, str, bool], ...]]] = field(
        default_factory=dict
    )

    def type_named(self, names: list[str]) -> CType:
        spelled = " ".join(names)
        known = self.types.get(spelled) or _SPELLINGS.get(spelled)
        if known is None:
            raise NotUnderstood(f"the type {spelled}")
        return known


def read(text: str) -> Unit:
    """The declarations of preprocessed C. Raises `NotUnderstood` for anything else in it."""
    from pycparser import c_ast, c_parser

    try:
        tree = c_parser.CParser().parse(text)
    except c_parser.ParseError as error:
        raise NotUnderstood(f"not C: {error}") from None
    unit = Unit()
    for node in tree.ext:
        match node:
            case c_ast.Pragma():
                _check_pragma(node.string)
            case c_ast.Typedef():
                _typedef(unit, node)
            case c_ast.FuncDef():
                if node.param_decls or node.decl.storage or node.decl.funcspec:
                    raise NotUnderstood(f"how {node.decl.name} is declared")
                result, parameters = _signature(node.decl.type)
                name = node.decl.name
                if name in unit.functions:
                    raise NotUnderstood(f"two definitions of {name}")
                unit.functions[name] = Function(name, result, parameters, node.body)
            case c_ast.Decl():
                _declaration(unit, node)
            case _:
                raise NotUnderstood(f"{type(node).__name__} outside of functions")
    return unit


def _check_pragma(words: str) -> None:
    """Pragmas that forbid fusing, or speak of warnings, change no meaning."""
    plain = " ".join(words.split())
    if plain not in ("STDC FP_CONTRACT OFF",) and not plain.startswith("GCC diagnostic ignored"):
        raise NotUnderstood(f"#pragma {plain}")


def _typedef(unit: Unit, node: c_ast.Typedef) -> None:
    from pycparser import c_ast

    match node.type:
        case c_ast.TypeDecl(type=c_ast.Struct(name=None) as struct) if struct.decls:
            unit.structs[node.name] = tuple(_member(unit, decl) for decl in struct.decls)
        case c_ast.TypeDecl(type=c_ast.IdentifierType() as plain):
            unit.types[node.name] = unit.type_named(plain.names)
        case _:
            raise NotUnderstood(f"the type {node.name}")


def _member(unit: Unit, decl: c_ast.Decl) -> Member:
    from pycparser import c_ast

    match decl.type:
        case c_ast.TypeDecl(type=c_ast.IdentifierType() as plain) if not decl.bitsize:
            return Member(decl.name, unit.type_named(plain.names), None)
        case c_ast.ArrayDecl(
            type=c_ast.TypeDecl(type=c_ast.IdentifierType() as plain),
            dim=c_ast.Constant() as length,
        ):
            return Member(decl.name, unit.type_named(plain.names), int(length.value, 0))
        case _:
            raise NotUnderstood(f"the member {decl.name}")


def _signature(function: c_ast.FuncDecl) -> tuple[str, tuple[tuple[str, str, bool], ...]]:
    """The result's type, and each parameter with what it points to ("" where it is no pointer)."""
    from pycparser import c_ast

    parameters = []
    for parameter in function.args.params if function.args else ():
        match parameter:
            case c_ast.Decl(
                type=c_ast.PtrDecl(
                    type=c_ast.TypeDecl(type=c_ast.IdentifierType(names=[name])) as target
                )
            ):
                parameters.append((parameter.name, name, "const" in target.quals))
            case c_ast.Typename(type=c_ast.TypeDecl(type=c_ast.IdentifierType(names=names))):
                parameters.append(("", " ".join(names), False))
            case _:
                raise NotUnderstood("a parameter that points to no struct")
    match function.type:
        case c_ast.TypeDecl(type=c_ast.IdentifierType(names=names)):
            return " ".join(names), tuple(parameters)
        case _:
            raise NotUnderstood("what a function returns")


def _declaration(unit: Unit, node: c_ast.Decl) -> None:
    from pycparser import c_ast

    match node.type:
        case c_ast.FuncDecl() if node.init is None:
            unit.prototypes[node.name] = _signature(node.type)
        case c_ast.TypeDecl(type=c_ast.IdentifierType()) if "extern" in node.storage:
            if node.init is not None or "const" not in node.quals:
                raise NotUnderstood(f"the declaration of {node.name}")
            unit.declared.add(node.name)
        case c_ast.TypeDecl(type=c_ast.IdentifierType(names=[struct])) if (
            "const" in node.quals and not node.storage and isinstance(node.init, c_ast.InitList)
        ):
            if node.name in unit.constants:
                raise NotUnderstood(f"two definitions of {node.name}")
            unit.constants[node.name] = struct, node.init
        case _:
            raise NotUnderstood(f"{node.name}, a variable outside of functions")
