"""Everything that can be proved about a program, in one call."""

from __future__ import annotations

from pirlc.ir.policy import Program
from pirlc.verify.bounds.actions import bounds
from pirlc.verify.bounds.tightening import tightened
from pirlc.verify.emitted.check import check_emitted
from pirlc.verify.findings import Verification
from pirlc.verify.properties.asking import DEFAULT_LIMITS, Limits
from pirlc.verify.properties.prove import prove
from pirlc.verify.remarks.collect import guard_margins, remarks


def verify(program: Program, limits: Limits = DEFAULT_LIMITS) -> Verification:
    """Properties, bounds, remarks, guards, and the emitted C in both precisions."""
    return Verification(
        program=program.interface.name,
        properties=tightened(program, prove(program, limits), limits),
        bounds=bounds(program, limits),
        remarks=remarks(program, limits),
        guards=guard_margins(program, limits),
        emitted=(check_emitted(program, "double"), check_emitted(program, "float")),
    )
