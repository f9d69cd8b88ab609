"""The same policy as a function that CasADi generates, and a driver that counts for it.

CasADi's function takes full windows and gives the clipped actions: it keeps no windows, judges no
reading, knows nothing of missing ones. What the emitted controller does beyond that is not taken
off its figures.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from benchmarks.assure.subjects import Subject
from pirlc.ir.policy import Continuous


@dataclass(frozen=True)
class Twin:
    """`history` numbers are what its caller has to keep: windows as long as the function needs."""

    source: Path
    inputs: int
    outputs: int
    history: int


def generate(subject: Subject, folder: Path) -> Twin:
    """`twin.c` and `twin.h` in the folder."""
    import casadi as ca

    from pirlc.symbolic.casadi_form import Element, casadi_form

    folder.mkdir(parents=True, exist_ok=True)
    form = casadi_form(subject.program, 1)
    windows = [ca.SX.sym(f"x{i}") for i in range(len(form.inputs))]
    raw, _ = form.function.expand()(ca.SX.zeros(0), *windows)
    applied = []
    for value, action in zip(ca.vertsplit(raw), subject.program.interface.actions, strict=True):
        if isinstance(action.domain, Continuous):
            low, high = action.domain.lower, action.domain.upper
            value = ca.if_else(value < low, low, ca.if_else(value > high, high, value))
        applied.append(value)
    function = ca.Function("twin", [ca.vertcat(*windows)], [ca.vertcat(*applied)])
    generator = ca.CodeGenerator(
        "twin.c", {"with_header": True, "casadi_real": str(subject.real), "casadi_int": "int"}
    )
    generator.add(function)
    generator.generate(f"{folder}/")
    oldest: dict[str, int] = {}
    expression = function(ca.vertcat(*windows))
    used = [
        which
        for which, symbol in zip(form.inputs, windows, strict=True)
        if ca.depends_on(expression, symbol)
    ]
    for which in used:
        if isinstance(which, Element):
            oldest[which.sensor] = max(oldest.get(which.sensor, 0), -which.index)
    previous = sum(not isinstance(which, Element) for which in used)
    return Twin(
        source=folder / "twin.c",
        inputs=len(windows),
        outputs=len(applied),
        history=sum(oldest.values()) + previous,
    )
