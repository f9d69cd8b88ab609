"""What a property depends on; the rest of a program need not be asked about."""

from __future__ import annotations

from dataclasses import replace

from pirlc.ir.policy import Program, Property
from pirlc.ir.terms import ActionRef, PreviousAction, SensorRef, subterms


def concerned(program: Program, claim: Property) -> frozenset[str]:
    """The sensors and actions that a property, or what it depends on, mentions."""
    bodies = {
        spec.name: body
        for spec, body in zip(program.interface.actions, program.bodies, strict=True)
    }
    found: set[str] = set()
    waiting = [claim.body]
    while waiting:
        for term in subterms(waiting.pop()):
            match term:
                case SensorRef(name):
                    found.add(name)
                case ActionRef(name) | PreviousAction(name):
                    if name not in found:
                        found.add(name)
                        waiting.append(bodies[name])
                case _:
                    pass
    return frozenset(found)


def part_of(program: Program, claim: Property) -> Program:
    """The program with nothing but the actions that a property concerns."""
    names = concerned(program, claim)
    pairs = zip(program.interface.actions, program.bodies, strict=True)
    kept = [(spec, body) for spec, body in pairs if spec.name in names]
    interface = replace(program.interface, actions=tuple(spec for spec, _ in kept))
    bodies = tuple(body for _, body in kept)
    return replace(program, interface=interface, bodies=bodies, properties=(claim,))
