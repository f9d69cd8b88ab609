"""A problem of several actions taken apart: actions that share no parameter are tuned alone.

The distance is a norm over the actions, so parameters that bring each action close bring all close.
An action's part is a smaller problem, and the same one in every template that has the same term for
that action.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from pirlc.ir.policy import FreeParameter
from pirlc.ir.terms import Literal, ParameterRef, subterms
from pirlc.tune.problem import Score, Tuned, TuningProblem


def separate(problem: TuningProblem) -> tuple[TuningProblem, ...]:
    """The parts, one for each group of actions that share free parameters.

    In a part every other action is its safe value, which is right in all histories. A problem that
    does not come apart, or has nothing to tune, is its only part; an action without free parameters
    is in none.
    """
    groups = _groups(problem)
    if not groups or len(groups[0][0]) == len(problem.template.bodies):
        return (problem,)
    return tuple(_part(problem, actions, names) for actions, names in groups)


def joined(problem: TuningProblem, parts: Iterable[Mapping[str, float]]) -> Tuned:
    """The whole problem with the parameters that were found for its parts."""
    values = {name: value for part in parts for name, value in part.items()}
    theta = np.array([values[name] for name in problem.names], dtype=np.float64)
    return Score(problem).tuned(theta)


def _groups(problem: TuningProblem) -> list[tuple[set[int], set[str]]]:
    """Actions (by position) that share free parameters, with those parameters."""
    free = set(problem.names)
    groups: list[tuple[set[int], set[str]]] = []
    for number, body in enumerate(problem.template.bodies):
        names = {s.name for s in subterms(body) if isinstance(s, ParameterRef)} & free
        if not names:
            continue
        actions = {number}
        apart = []
        for other_actions, other_names in groups:
            if names & other_names:
                actions, names = actions | other_actions, names | other_names
            else:
                apart.append((other_actions, other_names))
        groups = [*apart, (actions, names)]
    return sorted(groups, key=lambda group: min(group[0]))


def _part(problem: TuningProblem, actions: set[int], names: set[str]) -> TuningProblem:
    template, labels = problem.template, problem.labels.copy()
    bodies = list(template.bodies)
    for number, spec in enumerate(template.interface.actions):
        if number not in actions:
            bodies[number] = Literal(spec.safe)
            labels[:, number] = spec.safe
    parameters = tuple(
        p for p in template.parameters if not isinstance(p, FreeParameter) or p.name in names
    )
    return TuningProblem(
        replace(template, parameters=parameters, bodies=tuple(bodies), properties=()),
        problem.histories,
        labels,
        {name: value for name, value in problem.start.items() if name in names},
    )
