"""A program, and what a run of the command line leaves behind, for tests of it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]

POLE = """policy pole

environment "CartPole-v1"

sensor Angle           : [-0.21, 0.21] = 2
sensor AngularVelocity : [-3.5, 3.5]   = 3

param k = 3

action Push : {0, 1} = if k * peek(Angle, -1) + peek(AngularVelocity, -1) > 0 then 1 else 0
"""

SKETCH = POLE.replace("param k = 3", "param k in [0, 10]")


@dataclass(frozen=True)
class Outcome:
    code: int
    out: str
    err: str

    @property
    def data(self) -> dict:
        def no_constant(name):
            raise AssertionError(f"{name} is no JSON")

        return json.loads(self.out, parse_constant=no_constant)

    @property
    def codes(self) -> list[str]:
        return [diagnostic["code"] for diagnostic in self.data["diagnostics"]]
