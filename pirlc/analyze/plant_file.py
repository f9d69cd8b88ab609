"""A plant that the user gives: data in a TOML or JSON file, nothing that runs.

::

    sample_time = 0.02              # seconds; left out: the program's
    inputs = ["Accel"]              # actions of the program
    outputs = ["RPM"]               # sensors of the program
    a = [[0.98]]                    # x(k+1) = a x(k) + b u(k), y(k) = c x(k)
    b = [[0.01]]
    c = [[1.0]]
    continuous = false              # true: dx/dt = a x + b u, sampled with a zero-order hold
    [operating]                     # optional: where it was linearised
    RPM = 0.5

or, instead of `a`, `b`, `c`, transfer functions by falling powers of z (of s, if continuous)::

    [[channels]]
    input = "Accel"
    output = "RPM"
    num = [0.01]
    den = [1.0, -0.98]
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirlc.analyze.findings import Matrix, Origin, Plant
from pirlc.analyze.problems import (
    BadPlantFile,
    DirectPath,
    OtherSampleTime,
    UnknownName,
    error,
)
from pirlc.diagnostics import suggestion
from pirlc.ir.evidence import unknown
from pirlc.ir.policy import Program
from pirlc.source import SourceText

Real = NDArray[np.float64]

_MOST_STATES = 60
_KEYS = (
    "name", "sample_time", "inputs", "outputs", "states", "a", "b", "c", "d", "channels",
    "continuous", "operating", "notes",
)  # fmt: skip
_CHANNEL_KEYS = ("input", "output", "num", "den")


def read_plant(source: SourceText, program: Program) -> Plant:
    """The plant that a text describes, with the program's names.

    Raises PirlcError E0920 (no such description), E0922 (other names), E0923 (D is not zero) and
    E0926 (another sample time).
    """
    return _Reader(source.name, program).plant(_parsed(source))


def _parsed(source: SourceText) -> Mapping[str, Any]:
    try:
        if source.text.lstrip().startswith("{"):
            data = json.loads(source.text)
        else:
            data = tomllib.loads(source.text)
    except (ValueError, RecursionError) as e:
        raise error(BadPlantFile(source.name, f"it is neither TOML nor JSON ({e})")) from None
    assert isinstance(data, dict)
    return data


class _Reader:
    """Holds the file's name, for what is said of its mistakes."""

    def __init__(self, place: str, program: Program) -> None:
        self.place = place
        self.program = program

    def refuse(self, reason: str) -> Exception:
        return error(BadPlantFile(self.place, reason))

    def plant(self, data: Mapping[str, Any]) -> Plant:
        self.known(data, _KEYS, "")
        interface = self.program.interface
        seconds = self.sample_time(data)
        continuous = data.get("continuous", False)
        if not isinstance(continuous, bool):
            raise self.refuse("`continuous` is not true or false")
        if "channels" in data:
            inputs, outputs, system = self.channels(data)
        else:
            inputs, outputs, system = self.matrices(data)
        self.named("input", inputs, tuple(a.name for a in interface.actions), "action")
        self.named("output", outputs, tuple(s.name for s in interface.sensors), "sensor")
        a, b, c, d = system
        if continuous:
            if seconds is None:
                raise self.refuse("a continuous plant needs a `sample_time`")
            a, b = _held(a, b, seconds)
        for i, j in np.argwhere(d != 0.0):
            raise error(DirectPath(self.place, outputs[i], inputs[j]))
        states = self.texts(data, "states", tuple(f"x{i + 1}" for i in range(len(a))))
        if len(states) != len(a):
            raise self.refuse(f"`states` names {len(states)} of {len(a)} states")
        return Plant(
            name=str(data.get("name", self.place)),
            origin=Origin.GIVEN,
            a=_rows(a), b=_rows(b), c=_rows(c), d=_rows(d),
            states=states, inputs=inputs, outputs=outputs,
            sample_time=seconds,
            operating=self.operating(data),
            evidence=unknown("the file's word"),
            notes=self.texts(data, "notes", ()),
        )  # fmt: skip

    def known(self, data: Mapping[str, Any], keys: Sequence[str], where: str) -> None:
        for key in data:
            if key not in keys:
                close = suggestion(key, keys)
                hint = f"; did you mean `{close}`?" if close else ""
                raise self.refuse(f"`{where}{key}` means nothing here{hint}")

    def sample_time(self, data: Mapping[str, Any]) -> float | None:
        own = self.program.interface.sample_time
        if "sample_time" not in data:
            return own
        seconds = self.number(data["sample_time"], "sample_time")
        if seconds <= 0.0:
            raise self.refuse("`sample_time` is not above 0")
        if own is not None and not math.isclose(seconds, own, rel_tol=1e-9):
            raise error(OtherSampleTime(self.place, seconds, own))
        return seconds

    def matrices(
        self, data: Mapping[str, Any]
    ) -> tuple[tuple[str, ...], tuple[str, ...], tuple[Real, Real, Real, Real]]:
        inputs, outputs = self.texts(data, "inputs"), self.texts(data, "outputs")
        a = self.matrix(data, "a")
        n = len(a)
        b, c = self.matrix(data, "b"), self.matrix(data, "c")
        d = self.matrix(data, "d") if "d" in data else np.zeros((len(outputs), len(inputs)))
        for name, matrix, shape in (
            ("a", a, (n, n)),
            ("b", b, (n, len(inputs))),
            ("c", c, (len(outputs), n)),
            ("d", d, (len(outputs), len(inputs))),
        ):
            if matrix.shape != shape:
                rows, columns = matrix.shape
                raise self.refuse(
                    f"`{name}` is {rows} by {columns}; with {n} states, {len(inputs)} inputs and "
                    f"{len(outputs)} outputs it would be {shape[0]} by {shape[1]}"
                )
        return inputs, outputs, (a, b, c, d)

    def channels(
        self, data: Mapping[str, Any]
    ) -> tuple[tuple[str, ...], tuple[str, ...], tuple[Real, Real, Real, Real]]:
        channels = data["channels"]
        if not isinstance(channels, list) or not channels:
            raise self.refuse("`channels` is not a list of channels")
        found = []
        for i, channel in enumerate(channels):
            where = f"channels[{i}]."
            if not isinstance(channel, dict):
                raise self.refuse(f"`channels[{i}]` is no table")
            self.known(channel, _CHANNEL_KEYS, where)
            for key in _CHANNEL_KEYS:
                if key not in channel:
                    raise self.refuse(f"`{where}{key}` is missing")
            num, den = (self.vector(channel[key], where + key) for key in ("num", "den"))
            den = np.trim_zeros(den, "f")
            num = np.trim_zeros(num, "f")
            if not len(den):
                raise self.refuse(f"`{where}den` is zero")
            if len(num) > len(den):
                raise self.refuse(f"`{where}num` is of a higher degree than `den`")
            found.append(
                (str(channel["input"]), str(channel["output"]), num / den[0], den / den[0])
            )
        inputs = tuple(dict.fromkeys(channel[0] for channel in found))
        outputs = tuple(dict.fromkeys(channel[1] for channel in found))
        n = sum(len(den) - 1 for *_, den in found)
        if not 0 < n <= _MOST_STATES:
            raise self.refuse(f"it has {n} states; 1 to {_MOST_STATES} are possible")
        a, b = np.zeros((n, n)), np.zeros((n, len(inputs)))
        c, d = np.zeros((len(outputs), n)), np.zeros((len(outputs), len(inputs)))
        start = 0
        for input_, output, num, den in found:
            block = slice(start, start + len(den) - 1)
            own = _channel(num, den, 0 if data.get("continuous", False) else 1)
            j, i = inputs.index(input_), outputs.index(output)
            a[block, block], b[block, j], c[i, block] = own[:3]
            d[i, j] += own[3]
            start = block.stop
        return inputs, outputs, (a, b, c, d)

    def operating(self, data: Mapping[str, Any]) -> dict[str, float]:
        given = data.get("operating", {})
        if not isinstance(given, dict):
            raise self.refuse("`operating` is no table")
        interface = self.program.interface
        known = (*(s.name for s in interface.sensors), *(a.name for a in interface.actions))
        self.named("operating", tuple(given), known, "sensor or action")
        return {name: self.number(value, f"operating.{name}") for name, value in given.items()}

    def named(self, what: str, names: tuple[str, ...], known: tuple[str, ...], kind: str) -> None:
        if len(set(names)) != len(names):
            raise self.refuse(f"an {what} is named twice")
        for name in names:
            if name not in known:
                raise error(UnknownName(self.place, kind, name, known, suggestion(name, known)))

    def texts(
        self, data: Mapping[str, Any], key: str, default: tuple[str, ...] | None = None
    ) -> tuple[str, ...]:
        if key not in data:
            if default is None:
                raise self.refuse(f"`{key}` is missing")
            return default
        value = data[key]
        if not isinstance(value, list) or not all(isinstance(entry, str) for entry in value):
            raise self.refuse(f"`{key}` is not a list of names")
        if default is None and not value:
            raise self.refuse(f"`{key}` is empty")
        return tuple(value)

    def number(self, value: Any, key: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.refuse(f"`{key}` is no number")
        if not abs(value) < 1e300:
            raise self.refuse(f"`{key}` is not finite")
        return float(value)

    def vector(self, value: Any, key: str) -> Real:
        if not isinstance(value, list) or len(value) > _MOST_STATES + 1:
            raise self.refuse(f"`{key}` is not a list of at most {_MOST_STATES + 1} numbers")
        return np.array([self.number(entry, key) for entry in value], dtype=np.float64)

    def matrix(self, data: Mapping[str, Any], key: str) -> Real:
        if key not in data:
            raise self.refuse(f"`{key}` is missing (or `channels`)")
        value = data[key]
        if not isinstance(value, list) or not 0 < len(value) <= _MOST_STATES:
            raise self.refuse(f"`{key}` is not a list of 1 to {_MOST_STATES} rows")
        rows = [self.vector(row, key) for row in value]
        if len({len(row) for row in rows}) != 1:
            raise self.refuse(f"the rows of `{key}` differ in length")
        return np.array(rows)


def _channel(num: Real, den: Real, around: int) -> tuple[Real, Real, Real, float]:
    """num/den as (a, b, c, d) in controllable form, in powers of z - `around`.

    A plant that is sampled fast has all its poles close to z = 1, and powers of z would lose them
    among the rounding of large coefficients that cancel.
    """
    order = len(den) - 1
    whole = [Fraction(0)] * (order + 1 - len(num)) + [Fraction(x) for x in num]
    below = [Fraction(x) for x in den]
    through = whole[0] / below[0]
    above = _shifted([x - through * y for x, y in zip(whole, below, strict=True)], around)
    below = _shifted(below, around)
    if not order:
        return np.zeros((0, 0)), np.zeros(0), np.zeros(0), float(through)
    sizes = [float(abs(x / below[0])) ** (1.0 / k) for k, x in enumerate(below) if k and x]
    # The poles are about this far from `around`; a power of two rounds nothing.
    scale = 2.0 ** round(math.log2(max(sizes, default=1.0)))
    powers = scale ** -np.arange(order, dtype=np.float64)
    a = scale * np.eye(order, k=-1) + around * np.eye(order)
    a[0] -= np.array([float(x / below[0]) for x in below[1:]]) * powers
    c = np.array([float(x / below[0]) for x in above[1:]]) * powers
    return a, np.eye(order)[:, 0], c, float(through)


def _shifted(coefficients: list[Fraction], around: int) -> list[Fraction]:
    """A polynomial by falling powers of z, in powers of z - `around`: Horner's scheme, repeated."""
    found, rest = [], list(coefficients)
    while rest:
        for i in range(1, len(rest)):
            rest[i] += around * rest[i - 1]
        found.append(rest.pop())
    return found[::-1]


def _held(a: Real, b: Real, seconds: float) -> tuple[Real, Real]:
    """The zero-order hold: exp of [[a, b], [0, 0]] times the sample time."""
    import scipy.linalg

    n, m = b.shape
    whole = np.zeros((n + m, n + m))
    whole[:n, :n], whole[:n, n:] = a, b
    held = np.asarray(scipy.linalg.expm(whole * seconds), dtype=np.float64)
    return held[:n, :n], held[:n, n:]


def _rows(matrix: Real) -> Matrix:
    return tuple(tuple(float(x) for x in row) for row in matrix)
