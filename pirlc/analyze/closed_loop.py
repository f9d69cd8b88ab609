"""A plant under the leaves of a program, as one linear map from step to step, in exact rationals.

The state is the plant's, then the older readings that some leaf weighs, then the actions of the
step before that some leaf recalls. All are deviations; saturation is left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import product

from pirlc.analyze.exact import Rational
from pirlc.analyze.findings import Leaf, Matrix, Plant
from pirlc.ir.evidence import Kind

MOST_MODES = 64


@dataclass(frozen=True)
class Mode:
    """One leaf for each action, by action; an action that is not there is held."""

    name: str
    leaves: Mapping[str, Leaf]


@dataclass(frozen=True)
class Shape:
    """The state that all modes share. `depth`: how many older readings of each output are kept
    (those of 1 to `depth` steps ago); `recalled`: the actions whose last value is kept."""

    plant: Plant
    latency: int
    depth: Mapping[str, int]
    recalled: tuple[str, ...]

    @property
    def states(self) -> tuple[str, ...]:
        older = [
            f"{name}, {age} step{'s' if age > 1 else ''} ago"
            for name in self.plant.outputs
            for age in range(1, self.depth[name] + 1)
        ]
        return (*self.plant.states, *older, *(f"previous({name})" for name in self.recalled))

    def reading(self, sensor: str, age: int) -> list[Fraction]:
        """The reading of `age` steps ago as a row over the state."""
        row = [Fraction(0)] * len(self.states)
        n = len(self.plant.states)
        if age == 0:
            row[:n] = map(Fraction, self.plant.c[self.plant.outputs.index(sensor)])
            return row
        at = n
        for name in self.plant.outputs:
            if name == sensor:
                row[at + age - 1] = Fraction(1)
            at += self.depth[name]
        return row

    def recall(self, action: str) -> list[Fraction]:
        """The action of the step before as a row over the state."""
        row = [Fraction(0)] * len(self.states)
        row[len(row) - len(self.recalled) + self.recalled.index(action)] = Fraction(1)
        return row


def within(plant: Plant, leaves: Sequence[Leaf]) -> tuple[tuple[Leaf, ...], tuple[str, ...]]:
    """The leaves of the plant's inputs, with what the plant answers and takes, and notes on the
    rest: it stays at rest."""
    kept, notes = [], []
    for leaf in leaves:
        if leaf.action not in plant.inputs:
            continue
        lost = [f.sensor for f in leaf.filters if f.sensor not in plant.outputs]
        lost += [r.action for r in leaf.recalls if r.action not in plant.inputs]
        notes += [f"{name}, on which {leaf.name} depends, is no part of the plant" for name in lost]
        filters = tuple(f for f in leaf.filters if f.sensor in plant.outputs)
        recalls = tuple(r for r in leaf.recalls if r.action in plant.inputs)
        kept.append(replace(leaf, filters=filters, recalls=recalls))
    return tuple(kept), tuple(notes)


def why_not(plant: Plant, leaves: Sequence[Leaf]) -> str | None:
    """Why leaves `within` a plant make no linear loop with it; None where they do."""
    for leaf in leaves:
        if leaf.evidence.kind is Kind.UNKNOWN:
            return f"{leaf.name} is not linear: {leaf.evidence.reason}"
    if any(value != 0.0 for row in plant.d for value in row):
        return "the plant's readings depend on the action of the same step"
    return None


def parts_of(plant: Plant, leaves: Sequence[Leaf]) -> tuple[tuple[Plant, tuple[Leaf, ...]], ...]:
    """The plant and the leaves taken apart into what has nothing to do with each other.

    In the order of the plant's inputs; parts that no leaf acts on are left out.
    """
    n, m, p = len(plant.states), len(plant.inputs), len(plant.outputs)
    size = n + m + p
    linked = [{i} for i in range(size)]

    def link(i: int, j: int) -> None:
        if linked[i] is not linked[j]:
            linked[i] |= linked[j]
            for k in linked[j]:
                linked[k] = linked[i]

    for first, second, matrix in ((0, 0, plant.a), (0, n, plant.b), (n + m, 0, plant.c)):
        for i, row in enumerate(matrix):
            for j, value in enumerate(row):
                if value:
                    link(first + i, second + j)
    for leaf in leaves:
        if leaf.action not in plant.inputs:
            continue
        at = n + plant.inputs.index(leaf.action)
        for part in leaf.filters:
            if part.sensor in plant.outputs:
                link(at, n + m + plant.outputs.index(part.sensor))
        for recall in leaf.recalls:
            if recall.action in plant.inputs:
                link(at, n + plant.inputs.index(recall.action))
    found: list[tuple[Plant, tuple[Leaf, ...]]] = []
    done: set[int] = set()
    for j, name in enumerate(plant.inputs):
        members = linked[n + j]
        if n + j in done or not any(leaf.action == name for leaf in leaves):
            continue
        done |= members
        states, inputs, outputs = (
            [i for i in range(count) if first + i in members]
            for first, count in ((0, n), (n, m), (n + m, p))
        )
        names = {plant.inputs[i] for i in inputs}
        part_plant = replace(
            plant,
            a=_cut(plant.a, states, states),
            b=_cut(plant.b, states, inputs),
            c=_cut(plant.c, outputs, states),
            d=_cut(plant.d, outputs, inputs),
            states=tuple(plant.states[i] for i in states),
            inputs=tuple(plant.inputs[i] for i in inputs),
            outputs=tuple(plant.outputs[i] for i in outputs),
        )
        found.append((part_plant, tuple(leaf for leaf in leaves if leaf.action in names)))
    return tuple(found)


def _cut(matrix: Matrix, rows: Sequence[int], columns: Sequence[int]) -> Matrix:
    return tuple(tuple(matrix[i][j] for j in columns) for i in rows)


def shape_of(plant: Plant, leaves: Sequence[Leaf], latency: int) -> Shape:
    depth = dict.fromkeys(plant.outputs, 0)
    for leaf in leaves:
        for part in leaf.filters:
            oldest = max((j for j, c in enumerate(part.coefficients) if c), default=0)
            depth[part.sensor] = max(depth[part.sensor], latency + oldest)
    names = {recall.action for leaf in leaves for recall in leaf.recalls}
    return Shape(plant, latency, depth, tuple(name for name in plant.inputs if name in names))


def modes_of(plant: Plant, leaves: Sequence[Leaf]) -> tuple[Mode, ...]:
    """Every combination of one leaf an action, in their order, at most `MOST_MODES` + 1 of them."""
    by_action = [
        [leaf for leaf in leaves if leaf.action == action]
        for action in plant.inputs
        if any(leaf.action == action for leaf in leaves)
    ]
    found: list[Mode] = []
    for chosen in product(*by_action):
        name = " + ".join(leaf.name for leaf in chosen)
        found.append(Mode(name, {leaf.action: leaf for leaf in chosen}))
        if len(found) > MOST_MODES:
            break
    return tuple(found)


def law(shape: Shape, leaf: Leaf) -> list[Fraction]:
    """A leaf's action as a row over the state."""
    total = [Fraction(0)] * len(shape.states)

    def add(weight: Fraction, row: list[Fraction]) -> None:
        for i, value in enumerate(row):
            total[i] += weight * value

    for part in leaf.filters:
        for j, weight in enumerate(part.coefficients):
            if weight:
                add(weight, shape.reading(part.sensor, shape.latency + j))
    for recall in leaf.recalls:
        add(recall.coefficient, shape.recall(recall.action))
    return total


def closed_loop(shape: Shape, mode: Mode) -> Rational:
    """The matrix M with z(k+1) = M z(k): plant, kept readings and recalled actions."""
    plant = shape.plant
    size, n = len(shape.states), len(plant.states)
    actions = {name: law(shape, leaf) for name, leaf in mode.leaves.items()}
    nothing = [Fraction(0)] * size
    rows: list[list[Fraction]] = []
    for i in range(n):
        row = [Fraction(value) for value in plant.a[i]] + [Fraction(0)] * (size - n)
        for j, name in enumerate(plant.inputs):
            weight = Fraction(plant.b[i][j])
            if weight and name in actions:
                row = [old + weight * more for old, more in zip(row, actions[name], strict=True)]
        rows.append(row)
    for sensor in plant.outputs:
        rows += [shape.reading(sensor, age) for age in range(shape.depth[sensor])]
    rows += [actions.get(name, nothing) for name in shape.recalled]
    return tuple(tuple(row) for row in rows)
