"""How large a step in a parameter should be: one that moves a guard or an action noticeably."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pirlc.ir.policy import Continuous, ProgramTemplate
from pirlc.semantics.histories import HistorySet
from pirlc.symbolic.casadi_form import casadi_form


def natural_scales(
    template: ProgramTemplate, values: Mapping[str, float], histories: HistorySet
) -> NDArray[np.float64]:
    """For each free parameter (P,) the step that matters on these histories, around `values`.

    Such a step moves some guard's margin by the margin's spread, or some action's raw result by
    its range, in root mean square; the smallest such step counts. A parameter that moves nothing
    gets its own size, at least 1 % of its range.
    """
    form = casadi_form(template, len(histories))
    ranges = [
        spec.domain.upper - spec.domain.lower if isinstance(spec.domain, Continuous) else np.inf
        for spec in template.interface.actions
    ]

    def rows(at: Mapping[str, float]) -> NDArray[np.float64]:
        raw, margins = form.run(at, histories)
        return np.concatenate([margins, raw.T])

    # Far from sensible values a template may overflow; what is not finite is left out.
    with np.errstate(all="ignore"):
        here = rows(values)
        guards = len(here) - len(ranges)
        typical = np.concatenate([here[:guards].std(axis=1), ranges])
        scales = []
        for parameter in template.free:
            value = values[parameter.name]
            step = 1e-5 * max(abs(value), 1e-2 * (parameter.upper - parameter.lower), 1e-6)
            moved = (rows({**values, parameter.name: value + step}) - here) / step
            effect = np.sqrt(np.mean(moved**2, axis=1))
            needed = typical / effect
            useful = needed[np.isfinite(needed) & (needed > 0.0)]
            default = max(abs(value), 1e-2 * (parameter.upper - parameter.lower))
            found = float(useful.min()) if useful.size else default
            scales.append(min(found, (parameter.upper - parameter.lower) / 2 or 1.0))
    return np.array(scales)
