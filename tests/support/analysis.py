"""Programs from text, plants and loops, for tests of the analysis."""

from __future__ import annotations

import numpy as np

from pirlc.analyze.findings import Origin, Plant
from pirlc.analyze.realisation import Realisation
from pirlc.frontend import check
from pirlc.ir.evidence import unknown
from pirlc.ir.expansion import close
from pirlc.source import SourceText


def program_of(text):
    sketch, _ = check(SourceText("test.pirl", text))
    program = close(sketch)
    assert program is not None
    return program


def plant_of(a, b, c, inputs, outputs, sample_time=None, operating=None):
    rows = [tuple(map(tuple, np.atleast_2d(np.array(m, dtype=float)).tolist())) for m in (a, b, c)]
    return Plant(
        name="test", origin=Origin.GIVEN, a=rows[0], b=rows[1], c=rows[2],
        d=tuple((0.0,) * len(inputs) for _ in outputs),
        states=tuple(f"x{i}" for i in range(len(rows[0]))),
        inputs=tuple(inputs), outputs=tuple(outputs), sample_time=sample_time,
        operating=operating or {}, evidence=unknown("a test"),
    )  # fmt: skip


def realised(num, den, taps=(1.0,), latency=0):
    """num(z)/den(z), strictly proper, times a finite impulse response behind a delay."""
    den = np.asarray(den, dtype=float) / den[0]
    n = len(den) - 1
    row = np.concatenate([np.zeros(n - len(num)), num])
    depth = latency + len(taps) - 1
    a = np.zeros((n + depth, n + depth))
    a[0, :n] = -den[1:]
    a[1:n, : n - 1] = np.eye(n - 1)
    if depth:
        a[n, :n] = row
    for i in range(1, depth):
        a[n + i, n + i - 1] = 1.0
    b = np.zeros(n + depth)
    b[0] = 1.0
    c = np.zeros(n + depth)
    for age, tap in enumerate(taps):
        lag = latency + age
        if lag:
            c[n + lag - 1] += tap
        else:
            c[:n] += tap * row
    return Realisation(a, b, c)


def response_of(num, den, taps=(1.0,), latency=0):
    """The same as a function of z, from its polynomials."""

    def at(z):
        with np.errstate(all="ignore"):
            plant = np.polyval(num, z) / np.polyval(den, z)
            return plant * sum(tap * z ** -(latency + age) for age, tap in enumerate(taps))

    return at
