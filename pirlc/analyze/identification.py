"""Models from data: ARX by least squares, the order chosen on data held out from it.

    y(k) = sum over i of A_i y(k - i) + sum over j of B_j u(k - j) + c + e(k),   i, j = 1, ..., n

for deviations from the estimation data's means, of which the constant c makes a state of rest
(Ljung, System Identification, second edition, sections 4.2, 10.1 and 16.4). Readings y(k) are taken
before the action u(k).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

MOST_ORDER = 8

SMALL = 1e-3
"""A loss that no larger order need improve: errors of a thirtieth of a step's change."""

_LAGS = 100
"""Steps of the dither that serve as instruments, at most."""

_WEAK = 3.0


@dataclass(frozen=True)
class Record:
    """Consecutive steps: readings y (T, p), applied actions u (T, m), and of the latter what was
    drawn at random (T, m), whatever the readings were (None: nothing is known to be)."""

    y: Vector
    u: Vector
    dither: Vector | None = None

    def __len__(self) -> int:
        return len(self.y)


@dataclass(frozen=True)
class Arx:
    """`a` (n, p, p) and `b` (n, p, m) weigh past readings and actions, the newest first.

    `y_mean` (p,) and `u_mean` (m,): where the deviations are measured from; `constant` (p,) is c.
    """

    a: Vector
    b: Vector
    y_mean: Vector
    u_mean: Vector
    constant: Vector

    @property
    def order(self) -> int:
        return len(self.a)

    def state_space(self) -> tuple[Vector, Vector, Vector]:
        """A (np, np), B (np, m), C (p, np) in observer form: the first p states are readings."""
        n, p, m = self.order, self.a.shape[1], self.b.shape[2]
        a, b, c = np.zeros((n * p, n * p)), np.zeros((n * p, m)), np.zeros((p, n * p))
        for i in range(n):
            block = slice(i * p, (i + 1) * p)
            a[block, :p] = self.a[i]
            b[block] = self.b[i]
            if i + 1 < n:
                a[block, (i + 1) * p : (i + 2) * p] = np.eye(p)
        c[:, :p] = np.eye(p)
        return a, b, c


def regression(record: Record, order: int, y_mean: Vector, u_mean: Vector) -> tuple[Vector, Vector]:
    """Rows of past readings, past actions and a 1 (T - n, n (p + m) + 1), and what they explain."""
    y, u = record.y - y_mean, record.u - u_mean
    steps = len(record)
    past = [y[order - i : steps - i] for i in range(1, order + 1)]
    past += [u[order - i : steps - i] for i in range(1, order + 1)]
    past.append(np.ones((steps - order, 1)))
    return np.concatenate(past, axis=1), y[order:]


def fit_arx(records: Sequence[Record], order: int) -> Arx:
    """Least squares over all records, each column scaled to its size."""
    y_mean = np.mean(np.concatenate([record.y for record in records]), axis=0)
    u_mean = np.mean(np.concatenate([record.u for record in records]), axis=0)
    parts = [regression(record, order, y_mean, u_mean) for record in records]
    rows = np.concatenate([part[0] for part in parts])
    goal = np.concatenate([part[1] for part in parts])
    return _arx(_solved(rows, goal), order, y_mean, u_mean)


def fit_by_instruments(records: Sequence[Record], order: int) -> Arx | None:
    """The same by two-stage least squares, the dithers of the last steps being the instruments.

    In a closed loop what disturbs the readings reaches the actions too, and least squares takes
    some of its effect for theirs. Only what the dither explains of the past is regressed on here,
    which no disturbance has a part in (Soderstrom and Stoica, Instrumental Variable Methods for
    System Identification, 1983). None where there is no dither.
    """
    if any(record.dither is None or not np.any(record.dither) for record in records):
        return None
    lags = max(order + 1, min(_LAGS, min(map(len, records)) // 4))
    y_mean = np.mean(np.concatenate([record.y for record in records]), axis=0)
    u_mean = np.mean(np.concatenate([record.u for record in records]), axis=0)
    rows, goal, instruments = [], [], []
    for record in records:
        past, now = regression(record, order, y_mean, u_mean)
        dither, steps = record.dither, len(record)
        assert dither is not None
        drawn = [dither[lags - i : steps - i] for i in range(1, lags + 1)]
        instruments.append(np.concatenate([*drawn, np.ones((steps - lags, 1))], axis=1))
        rows.append(past[lags - order :])
        goal.append(now[lags - order :])
    z = np.concatenate(instruments)
    explained = z @ _solved(z, np.concatenate(rows))
    return _arx(_solved(explained, np.concatenate(goal)), order, y_mean, u_mean)


def _solved(rows: Vector, goal: Vector) -> Vector:
    """The weights of least squares, each column of `rows` scaled to its size."""
    scale = np.linalg.norm(rows, axis=0)
    scale[scale == 0.0] = 1.0
    weights, *_ = np.linalg.lstsq(rows / scale, goal, rcond=1e-10)
    return np.asarray(weights / scale[:, None], dtype=np.float64)


def _arx(solved: Vector, order: int, y_mean: Vector, u_mean: Vector) -> Arx:
    weights, p, m = solved.T, len(y_mean), len(u_mean)
    a = weights[:, : order * p].reshape(p, order, p).transpose(1, 0, 2)
    b = weights[:, order * p : -1].reshape(p, order, m).transpose(1, 0, 2)
    return Arx(a, b, y_mean, u_mean, weights[:, -1])


def one_step(model: Arx, record: Record) -> tuple[Vector, Vector]:
    """What the model says of each reading given all before it, and the readings (deviations)."""
    rows, goal = regression(record, model.order, model.y_mean, model.u_mean)
    weights = np.concatenate([*model.a, *model.b, model.constant[:, None]], axis=1)
    return rows @ weights.T, goal


def free_run(model: Arx, record: Record, horizon: int | None = None) -> tuple[Vector, Vector]:
    """The model run on its own readings from the actions alone, and the readings (deviations).

    It starts from the record's first n readings, and anew every `horizon` steps (None: never).
    """
    n = model.order
    y, u = record.y - model.y_mean, record.u - model.u_mean
    run = y.copy()
    with np.errstate(all="ignore"):
        for k in range(n, len(y)):
            since = k - n if horizon is None else (k - n) % horizon
            run[k] = model.constant + sum(
                model.a[i] @ (run if since > i else y)[k - 1 - i] + model.b[i] @ u[k - 1 - i]
                for i in range(n)
            )
    return run[n:], y[n:]


def fit_percent(predicted: Vector, measured: Vector) -> Vector:
    """100 (1 - |y - y'| / |y - mean y|) for each reading: 100 is perfect, 0 as good as the mean.

    The normalised root mean square error of Ljung's `compare`; -inf where the model diverges.
    """
    with np.errstate(all="ignore"):
        miss = np.linalg.norm(measured - predicted, axis=0)
        spread = np.linalg.norm(measured - measured.mean(axis=0), axis=0)
        fit: Vector = 100.0 * (1.0 - miss / spread)
    return np.where(np.isfinite(fit), fit, -np.inf)


def loss(model: Arx, records: Sequence[Record]) -> float:
    """The mean over records and readings of the one-step error's variance, relative to that of
    the readings' changes from step to step."""
    total, count = np.zeros(len(model.y_mean)), 0
    changes = np.zeros(len(model.y_mean))
    for record in records:
        predicted, measured = one_step(model, record)
        total += np.sum((predicted - measured) ** 2, axis=0)
        changes += np.sum(np.diff(record.y, axis=0)[model.order - 1 :] ** 2, axis=0)
        count += len(measured)
    with np.errstate(all="ignore"):
        return float(np.mean(np.where(changes > 0, total / changes, 0.0)))


@dataclass(frozen=True)
class Chosen:
    """The model, whether instruments made it, and (order, loss on the selection data) of all least
    squares models that were tried."""

    model: Arx
    instruments: bool
    losses: tuple[tuple[int, float], ...]


def choose(
    estimation: Sequence[Record], selection: Sequence[Record], most: int = MOST_ORDER
) -> Chosen:
    """The model of the order of least one-step loss on `selection`, by the one-standard-error rule.

    The smallest order whose loss is `SMALL`, or within one standard error (over the records of
    `selection`) of the least: higher ones fit the same noise (Breiman et al. 1984, section 3.4.3).
    The model of that order is then made of all records, by instruments where these are strong
    enough: its loss on `selection` must be within `_WEAK` times that of least squares.
    """
    models = [fit_arx(estimation, order) for order in range(1, most + 1)]
    by_record = np.array([[loss(model, [record]) for record in selection] for model in models])
    losses = by_record.mean(axis=1)
    best = int(np.argmin(losses))
    # Differences from the best, record by record: what all records share is not uncertainty.
    gaps = by_record - by_record[best]
    error = gaps.std(axis=1, ddof=1) / np.sqrt(len(selection)) if len(selection) > 1 else 0 * losses
    near = (gaps.mean(axis=1) <= np.maximum(error, 1e-12)) | (losses <= SMALL)
    first = int(np.argmax(near))
    order = first + 1
    tried = tuple((number, float(value)) for number, value in enumerate(losses, start=1))
    apart = fit_by_instruments(estimation, order)
    every = [*estimation, *selection]
    if apart is not None and loss(apart, selection) <= _WEAK * losses[first]:
        final = fit_by_instruments(every, order)
        if final is not None:
            return Chosen(final, True, tried)
    return Chosen(fit_arx(every, order), False, tried)
