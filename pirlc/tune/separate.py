"""A problem of several actions taken apart: actions that share no parameter are tuned alone.

The distance is a norm over the actions, so parameters that bring each action close bring all close.
An action's part is a smaller problem, and the same one in every template that has the same term for
that action.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from pirlc.ir.policy import FreeParameter, ProgramTemplate
from pirlc.ir.terms import Literal, ParameterRef, subterms
from pirlc.tune.problem import Score, Tuned, TuningProblem


def separate(problem: TuningProblem) -> tuple[TuningProblem, ...]:
    """The parts, one for each group of actions that share free parameters.

    In a part every other action is its safe value, which is right in all histories. A problem that
    does not come apart, or has nothing to tune, is its only part; an action without free parameters
    is in none.
    """
    groups = _groups(problem.template)
    if not groups or len(groups[0][0]) == len(problem.template.bodies):
        return (problem,)
    return tuple(_part(problem, actions, names) for actions, names in groups)


def separate_templates(template: ProgramTemplate) -> tuple[ProgramTemplate, ...]:
    """The templates of the parts of any problem with this template."""
    groups = _groups(template)
    if not groups or len(groups[0][0]) == len(template.bodies):
        return (template,)
    return tuple(_template_part(template, actions, names) for actions, names in groups)


def joined(problem: TuningProblem, parts: Iterable[Mapping[str, float]]) -> Tuned:
    """The whole problem with the parameters that were found for its parts."""
    values = {name: value for part in parts for name, value in part.items()}
    theta = np.array([values[name] for name in problem.names], dtype=np.float64)
    return Score(problem).tuned(theta)


def _groups(template: ProgramTemplate) -> list[tuple[set[int], set[str]]]:
    """Actions (by position) that share free parameters, with those parameters."""
    free = {parameter.name for parameter in template.free}
    groups: list[tuple[set[int], set[str]]] = []
    for number, body in enumerate(template.bodies):
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
    labels = problem.labels.copy()
    for number, spec in enumerate(problem.template.interface.actions):
        if number not in actions:
            labels[:, number] = spec.safe
    return TuningProblem(
        _template_part(problem.template, actions, names),
        problem.histories,
        labels,
        {name: value for name, value in problem.start.items() if name in names},
    )


def _template_part(
    template: ProgramTemplate, actions: set[int], names: set[str]
) -> ProgramTemplate:
    bodies = tuple(
        body if number in actions else Literal(spec.safe)
        for number, (body, spec) in enumerate(
            zip(template.bodies, template.interface.actions, strict=True)
        )
    )
    parameters = tuple(
        p for p in template.parameters if not isinstance(p, FreeParameter) or p.name in names
    )
    return replace(template, parameters=parameters, bodies=bodies, properties=())
