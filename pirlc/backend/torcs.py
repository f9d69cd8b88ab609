"""Controllers as robots of TORCS: the C of target `c`, and a module around it."""

from __future__ import annotations

from pirlc.backend.c import c_files
from pirlc.backend.files import GeneratedFile, Provenance
from pirlc.backend.names import file_stem
from pirlc.backend.numbers import RealType
from pirlc.backend.problems import (
    DiscreteCommand,
    NoSuchCommand,
    NoSuchReading,
    NotSteered,
    describe,
)
from pirlc.backend.rendering import render, runtime_text
from pirlc.backend.toolchain import bridge_text
from pirlc.diagnostics import PirlcError
from pirlc.ir.controller import Controller, Kind
from pirlc.simulation.torcs.readings import ACTIONS, FIRST_BEAM, READINGS

CAR = "car1-trb1"
"""The car of the reference experiments, which robots drive unless their xml is changed."""

_SUPPORT = ("driving.h", "readings.h", "readings.cpp")


def torcs_files(
    controller: Controller, real: RealType, provenance: Provenance
) -> tuple[GeneratedFile, ...]:
    """The controller's C, and a robot module named like it; its Makefile builds it.

    Sensors read the component of TORCS's 29 readings that they name, actions are steer, accel and
    brake by theirs. Raises `PirlcError` E0535 to E0538 for a controller that does not fit.
    """
    check_fit(controller)
    stem = file_stem(controller.name)
    outputs = sorted(controller.outputs, key=lambda output: output.component)
    context = {
        "name": stem,
        "version": provenance.version,
        "sha256": provenance.sha256,
        "car": CAR,
        "params": len(controller.parameters),
        "beams": reads_beams(controller),
        "sensors": [(c.name, c.index, READINGS[c.index]) for c in controller.channels],
        "actions": [(output.name, ACTIONS[output.component]) for output in outputs],
    }
    return (
        *c_files(controller, real, provenance),
        GeneratedFile.of(f"{stem}_robot.cpp", render("torcs", "robot.cpp.j2", context)),
        GeneratedFile.of(f"{stem}.xml", render("torcs", "robot.xml.j2", context)),
        GeneratedFile.of("torcs/bridge.c", bridge_text(controller, stem)),
        *(GeneratedFile.of(f"torcs/{n}", runtime_text("torcs", n) + "\n") for n in _SUPPORT),
        GeneratedFile.of("Makefile", render("torcs", "Makefile.j2", context)),
        GeneratedFile.of("README.md", render("torcs", "README.md.j2", context)),
    )


def reads_beams(controller: Controller) -> bool:
    """Whether the controller uses a range finder: they are most of the work of a step."""
    return any(channel.index >= FIRST_BEAM for channel in controller.channels)


def check_fit(controller: Controller) -> None:
    """Raises `PirlcError` with all that TORCS does not offer to a controller."""
    found: list[NoSuchReading | NoSuchCommand | NotSteered | DiscreteCommand] = [
        NoSuchReading(c.name, c.index, len(READINGS))
        for c in controller.channels
        if c.index >= len(READINGS)
    ]
    for output in controller.outputs:
        if output.component >= len(ACTIONS):
            found.append(NoSuchCommand(output.name, output.component))
        elif output.kind is not Kind.REAL:
            found.append(DiscreteCommand(output.name, ACTIONS[output.component]))
    given = {output.component for output in controller.outputs}
    missing = tuple(ACTIONS[component] for component in (0, 1) if component not in given)
    if missing:
        found.append(NotSteered(missing))
    if found:
        raise PirlcError([describe(problem) for problem in found])
