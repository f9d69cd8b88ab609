"""Programs as policies: something that is reset and then acts on observations."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pirlc.ir.policy import Program
from pirlc.semantics.interpreter import State, initial_state, step
from pirlc.semantics.precision import BINARY64, Precision

if TYPE_CHECKING:
    from pirlc.ir.observation import Observation


class InterpretedPolicy:
    """A program run by the reference interpreter."""

    def __init__(self, program: Program, precision: Precision = BINARY64) -> None:
        self.program = program
        self.precision = precision
        actions = program.interface.actions
        self._order = sorted(range(len(actions)), key=lambda i: actions[i].component)
        self.state: State = initial_state(program, precision)
        self.status = 0

    def reset(self) -> None:
        self.state = initial_state(self.program, self.precision)
        self.status = 0

    def act(self, observation: Observation) -> tuple[float, ...]:
        """The applied actions in the order of the environment's components."""
        result = step(self.program, self.state, observation, self.precision)
        self.state, self.status = result.state, result.status
        return tuple(result.actions[i] for i in self._order)
