"""Plant and leaves put together as one state space, exactly.

The state is the plant's, then the past readings that leaves look back to (latency included), then
the previous actions that they recall.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from pirlc.analyze.findings import Leaf, Plant
from pirlc.analyze.realisation import Complex, Real, Realisation

Rows = list[list[Fraction]]

_ROUNDING = 1e-12
"""What is left of a vector by no more than this share is nothing but rounding."""


@dataclass(frozen=True)
class Assembly:
    """x(k+1) = a x + b v, the action w = row x, of the loop broken between w and v.

    `c` are the plant's outputs. `inner` is what a change of the leaf's offset moves besides v: the
    recalled action.
    """

    a: Rows
    b: list[Fraction]
    row: list[Fraction]
    inner: list[Fraction]
    c: Rows

    @property
    def loop(self) -> Realisation:
        """L = -w / v."""
        a, b, row = (np.array(part, dtype=np.float64) for part in (self.a, self.b, self.row))
        return Realisation(a, b, -row)

    @property
    def closed(self) -> Rows:
        """The matrix of the closed loop."""
        return [
            [x + gain * y for x, y in zip(line, self.row, strict=True)]
            for line, gain in zip(self.a, self.b, strict=True)
        ]

    def hidden(self) -> tuple[Realisation, Complex]:
        """The part of the loop that v moves and w shows, and the poles of the rest."""
        whole = self.loop
        part = visible(whole)
        return part, _without(whole.poles, part.poles)


def visible(whole: Realisation) -> Realisation:
    """The part that its input moves and its output shows; no state where there is none."""
    a, b, c = _reachable(whole.a, whole.b, whole.c)
    back, c_turned, b_turned = _reachable(a.T, c, b)
    return Realisation(back.T, b_turned, c_turned, whole.d)


def _reachable(a: Real, b: Real, c: Real) -> tuple[Real, Real, Real]:
    """(a, b, c) on the smallest invariant subspace that holds b (Arnoldi's iteration)."""
    n = len(b)
    size = float(np.linalg.norm(b))
    if not size:
        return np.zeros((0, 0)), np.zeros(0), np.zeros(0)
    basis = [b / size]
    while len(basis) < n:
        new = a @ basis[-1]
        largest = float(np.linalg.norm(np.abs(a) @ np.abs(basis[-1])))
        q = np.array(basis)
        for _ in range(2):
            new = new - q.T @ (q @ new)
        rest = float(np.linalg.norm(new))
        if rest <= _ROUNDING * largest:
            break
        basis.append(new / rest)
    q = np.array(basis)
    return q @ a @ q.T, q @ b, q @ c


def _without(whole: Complex, part: Complex) -> Complex:
    """The numbers of `whole` that are left when those nearest to `part` are taken away."""
    left = list(whole)
    for number in part:
        left.pop(int(np.argmin([abs(number - other) for other in left])))
    return np.array(left, dtype=np.complex128)


def assemble(plant: Plant, leaf: Leaf, others: Sequence[Leaf], latency: int) -> Assembly:
    """The loop of `leaf` broken at its action; the leaves of `others` stay closed.

    The plant's D must be zero. Readings that the plant does not have, and actions that it does not
    take, stay at rest.
    """
    every = [leaf, *others]
    a, b, c = (_exact(matrix) for matrix in (plant.a, plant.b, plant.c))
    depth: dict[str, int] = {}
    for law in every:
        for filter_ in law.filters:
            if filter_.sensor in plant.outputs:
                last = latency + len(filter_.coefficients) - 1
                depth[filter_.sensor] = max(last, depth.get(filter_.sensor, 0))
    recalled = [law.action for law in every if any(law.action in _recalls(o) for o in every)]
    n = len(a)
    start: dict[str, int] = {}
    for sensor, steps in depth.items():
        start[sensor] = n
        n += steps
    memory = {action: n + i for i, action in enumerate(recalled)}
    n += len(memory)

    rows = {law.action: _row(law, plant, c, start, memory, latency, n) for law in every}
    nothing = Fraction(0)
    whole = [[*line, *[nothing] * (n - len(line))] for line in a]
    whole += [[nothing] * n for _ in range(n - len(a))]
    for sensor, steps in depth.items():
        if steps:
            whole[start[sensor]][: len(a)] = c[plant.outputs.index(sensor)]
        for i in range(1, steps):
            whole[start[sensor] + i][start[sensor] + i - 1] = Fraction(1)
    for action, place in memory.items():
        whole[place] = list(rows[action])
    for law in others:
        column = plant.inputs.index(law.action)
        for i in range(len(a)):
            gain = b[i][column]
            whole[i] = [x + gain * y for x, y in zip(whole[i], rows[law.action], strict=True)]
    own = plant.inputs.index(leaf.action)
    inner = [nothing] * n
    if leaf.action in memory:
        inner[memory[leaf.action]] = Fraction(1)
    return Assembly(
        whole,
        [b[i][own] if i < len(a) else nothing for i in range(n)],
        rows[leaf.action],
        inner,
        [[*line, *[nothing] * (n - len(a))] for line in c],
    )


def _exact(matrix: Sequence[Sequence[float]]) -> Rows:
    return [[Fraction(x) for x in line] for line in matrix]


def _recalls(leaf: Leaf) -> Mapping[str, Fraction]:
    return {recall.action: recall.coefficient for recall in leaf.recalls}


def _row(
    leaf: Leaf,
    plant: Plant,
    c: Rows,
    start: Mapping[str, int],
    memory: Mapping[str, int],
    latency: int,
    n: int,
) -> list[Fraction]:
    """What the leaf makes of the state."""
    row = [Fraction(0)] * n
    for filter_ in leaf.filters:
        if filter_.sensor not in plant.outputs:
            continue
        for age, weight in enumerate(filter_.coefficients):
            lag = latency + age
            if lag:
                row[start[filter_.sensor] + lag - 1] += weight
                continue
            for i, x in enumerate(c[plant.outputs.index(filter_.sensor)]):
                row[i] += weight * x
    for action, weight in _recalls(leaf).items():
        if action in memory:
            row[memory[action]] += weight
    return row


def composed(plant: Plant, leaf: Leaf, others: Sequence[Leaf], latency: int, z: Complex) -> Complex:
    """L at points z (N,), from the plant's response and the leaves' polynomials in 1/z: nothing
    but the formulas of `assemble` is shared."""
    every = [leaf, *others]
    a, b, c = (np.array(m, dtype=np.float64) for m in (plant.a, plant.b, plant.c))
    count, k = len(z), len(every)
    columns = [plant.inputs.index(law.action) for law in every]
    right = np.broadcast_to(b[:, columns].astype(np.complex128), (count, len(a), k))
    responses = c @ _solve(z[:, None, None] * np.eye(len(a)) - a, right)
    filters = np.zeros((count, k, len(plant.outputs)), dtype=np.complex128)
    system = np.zeros((count, k, k), dtype=np.complex128)
    for i, law in enumerate(every):
        for filter_ in law.filters:
            if filter_.sensor in plant.outputs:
                j = plant.outputs.index(filter_.sensor)
                weights = [float(weight) for weight in filter_.coefficients]
                filters[:, i, j] += np.polynomial.polynomial.polyval(1.0 / z, weights)
        for j, other in enumerate(every):
            system[:, i, j] = float(i == j) - float(_recalls(law).get(other.action, 0)) / z
    answers = filters @ responses / (z**latency)[:, None, None]
    # The others' actions act on the plant; the leaf's own goes nowhere, v acts in its place.
    system[:, :, 1:] -= answers[:, :, 1:]
    return -_solve(system, answers[:, :, :1])[:, 0, 0]


def _solve(left: Complex, right: Complex) -> Complex:
    """Stacked systems; nan where a matrix is singular."""
    try:
        return np.asarray(np.linalg.solve(left, right), dtype=np.complex128)
    except np.linalg.LinAlgError:
        out = np.full(right.shape, np.nan, dtype=np.complex128)
        for i, matrix in enumerate(left):
            if np.linalg.cond(matrix) < 1e15:
                out[i] = np.linalg.solve(matrix, right[i])
        return out
