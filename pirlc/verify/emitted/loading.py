"""A translation unit as the comparison and its examples use it."""

from __future__ import annotations

from dataclasses import dataclass

from pirlc.backend.c import CPrinter
from pirlc.backend.numbers import RealType
from pirlc.ir.controller import Kind
from pirlc.verify.emitted.graph import Graph
from pirlc.verify.emitted.machine import Machine
from pirlc.verify.emitted.memory import Memory
from pirlc.verify.emitted.nodes import NotUnderstood
from pirlc.verify.emitted.preprocess import preprocessed
from pirlc.verify.emitted.relation import (
    INPUT,
    OUTPUT,
    PARAMETERS,
    STATE,
    check_struct,
)
from pirlc.verify.emitted.syntax import CType, Unit, read


@dataclass(frozen=True)
class Loaded:
    """A translation unit, and the names that it must have."""

    unit: Unit
    stem: str

    def struct(self, kind: str) -> str:
        return f"{self.stem}_{kind}"

    def objects(self) -> dict[str, str]:
        """The memory's object for each struct."""
        kinds = ("params", PARAMETERS), ("state", STATE), ("observation", INPUT), ("action", OUTPUT)
        return {self.struct(kind): object_ for kind, object_ in kinds}


def load(header: str, source: str, printer: CPrinter, real: RealType) -> Loaded:
    """The unit, with the structs and signatures of the contract. Raises `NotUnderstood`."""
    loaded = Loaded(read(preprocessed(header, source, printer.stem)), printer.stem)
    unit, type_, controller = loaded.unit, CType(real), printer.controller
    names = [printer.inputs[c.name] for c in controller.channels]
    check_struct(unit, loaded.struct("observation"), tuple((name, type_) for name in names))
    check_struct(
        unit,
        loaded.struct("action"),
        tuple(
            (printer.actions[o.name], type_ if o.kind is Kind.REAL else CType(printer.discrete))
            for o in controller.outputs
        ),
    )
    parameters = [printer.parameters[name] for name, _ in controller.parameters]
    check_struct(unit, loaded.struct("params"), tuple((name, type_) for name in parameters))
    if loaded.struct("state") not in unit.structs:
        raise NotUnderstood(f"there is no {loaded.struct('state')}")
    params, state, observation, action = loaded.objects()
    signatures = {
        f"{loaded.stem}_reset": ("void", ((state, False),)),
        f"{loaded.stem}_step": (
            "unsigned",
            ((params, True), (state, False), (observation, True), (action, False)),
        ),
    }
    if set(unit.functions) != set(signatures):
        raise NotUnderstood("functions other than reset and step: " + ", ".join(unit.functions))
    for name, (result, wanted) in signatures.items():
        function = unit.functions[name]
        declared = unit.prototypes.get(name, ("", ()))
        for what, parameters_ in (
            (function.result, function.parameters),
            (declared[0], declared[1]),
        ):
            have = tuple((struct, constant) for _, struct, constant in parameters_)
            if (what, have) != (result, wanted):
                raise NotUnderstood(f"the signature of {name}")
    return loaded


def defaults(graph: Graph, loaded: Loaded) -> Memory:
    """The parameters' default values, as an object in memory."""
    name, struct = loaded.struct("default_params"), loaded.struct("params")
    if set(loaded.unit.constants) != {name} or loaded.unit.constants[name][0] != struct:
        raise NotUnderstood(f"constants other than {name}")
    if name not in loaded.unit.declared:
        raise NotUnderstood(f"{name} is not in the header")
    members, values = loaded.unit.structs[struct], loaded.unit.constants[name][1].exprs
    if len(members) != len(values):
        raise NotUnderstood(f"{name} has {len(values)} values for {len(members)} members")
    machine = Machine(graph, loaded.unit, {})
    return {
        (PARAMETERS, member.name): machine.constant_of(value, member.type)
        for member, value in zip(members, values, strict=True)
    }
