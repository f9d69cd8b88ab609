"""Rules at the types they are used with: which instances a sketch needs."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from pirlc.frontend import problems_sketch as problems
from pirlc.frontend import syntax
from pirlc.frontend.problems import Collector
from pirlc.ir.types import Type

INSTANCE_LIMIT = 1_000
"""Of one rule."""


@dataclass(frozen=True)
class Instance:
    """A rule to be read with these types for its arguments and its result."""

    key: str
    rule: syntax.Rule
    arguments: tuple[Type, ...]
    result: Type


@dataclass
class Instances:
    """The instances asked for so far; `waiting` are those not read yet, oldest first."""

    collector: Collector
    waiting: deque[Instance] = field(default_factory=deque)
    _count: dict[str, int] = field(default_factory=dict)
    _known: dict[tuple[str, tuple[Type, ...], Type], Instance] = field(default_factory=dict)

    def request(
        self, rule: syntax.Rule, arguments: tuple[Type, ...], result: Type
    ) -> Instance | None:
        """The instance of a rule at these types; None if there are too many already."""
        name = rule.name.text
        instance = self._known.get((name, arguments, result))
        if instance is not None:
            return instance
        number = self._count.get(name, 0) + 1
        if number > INSTANCE_LIMIT:
            self.collector.add(problems.TooManyInstances(rule.name.span, name, INSTANCE_LIMIT))
            return None
        self._count[name] = number
        instance = Instance(name if number == 1 else f"{name}#{number}", rule, arguments, result)
        self._known[name, arguments, result] = instance
        self.waiting.append(instance)
        return instance
