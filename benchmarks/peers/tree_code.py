"""Trees as C, by m2cgen and by emlearn.

emlearn is given `dtype="float"`; its default, int16_t, makes integers of thresholds and readings,
which asks for readings that its user has scaled.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers.footprint import CSource, footprint
from benchmarks.peers.tasks import Array
from benchmarks.peers.trees import predict

_DECLARED = "void peer_reset(void);\nvoid peer_step(const double *r, double *a);\n"
_NO_STATE = "void peer_reset(void)\n{\n}\n"


@dataclass(frozen=True)
class TreeCode:
    """`disagreements`: how many of the `observations` it answers otherwise than scikit-learn; for
    reals, by more than 1e-6 of the value or of 1. `at_thresholds`: the same for `probes`, where a
    reading is one of the three binary32 numbers nearest to a threshold that it is compared with."""

    code_bytes: int
    step_nanoseconds: float
    disagreements: int
    observations: int
    at_thresholds: int
    probes: int


def by_m2cgen(fitted: Any) -> CSource:
    """`score`, in double: class shares, of which the adapter takes the largest, or the value."""
    import m2cgen

    text = m2cgen.export_to_c(fitted)
    classes = getattr(fitted, "classes_", None)
    if classes is None:
        adapter = (
            f"double score(double *input);\n{_DECLARED}{_NO_STATE}"
            "void peer_step(const double *r, double *a)\n{\n    a[0] = score((double *)r);\n}\n"
        )
        return CSource({"tree.c": text}, "tree.c", adapter, ("score",))
    if len(classes) == 2 and "double * output" not in text:
        raise SystemExit("m2cgen gives one number for two classes: its C is not what was expected")
    adapter = (
        f"void score(double *input, double *output);\n{_DECLARED}{_NO_STATE}"
        f"static const double values[] = {{{', '.join(map(str, map(float, classes)))}}};\n"
        "void peer_step(const double *r, double *a)\n{\n"
        f"    double shares[{len(classes)}];\n    int best = 0, k;\n"
        "    score((double *)r, shares);\n"
        f"    for (k = 1; k < {len(classes)}; k++) {{\n"
        "        if (shares[k] > shares[best]) {\n            best = k;\n        }\n    }\n"
        "    a[0] = values[best];\n}\n"
    )
    return CSource({"tree.c": text}, "tree.c", adapter, ("score",))


def by_emlearn(fitted: Any) -> CSource:
    """`tree_predict`, in float, with the nodes as code (`inline`)."""
    # Its import makes numpy raise on every underflow, in the whole process.
    with warnings.catch_warnings(), np.errstate():
        warnings.simplefilter("ignore")
        import emlearn

        text = emlearn.convert(fitted, method="inline", dtype="float").save(name="tree", format="c")
    width = int(fitted.n_features_in_)
    classes = getattr(fitted, "classes_", None)
    kind = "float" if classes is None else "int32_t"
    answer = "(double)found" if classes is None else "values[found]"
    known = (
        ""
        if classes is None
        else f"static const double values[] = {{{', '.join(map(str, map(float, classes)))}}};\n"
    )
    adapter = (
        "#include <stdint.h>\n"
        f"{kind} tree_predict(const float *features, int32_t length);\n"
        f"{_DECLARED}{_NO_STATE}{known}"
        "void peer_step(const double *r, double *a)\n{\n"
        f"    float features[{width}];\n    {kind} found;\n    int k;\n"
        f"    for (k = 0; k < {width}; k++) {{\n        features[k] = (float)r[k];\n    }}\n"
        f"    found = tree_predict(features, {width});\n    a[0] = {answer};\n}}\n"
    )
    include = (Path(emlearn.includedir),)
    return CSource({"tree.c": text}, "tree.c", adapter, ("tree_predict",), include)


def measured(source: CSource, fitted: Any, observations: Array) -> TreeCode:
    """Bytes and time over the observations, and how far the code is the tree."""
    near = probes(fitted, observations)
    found = footprint(source, observations, 1)
    at_thresholds = _apart(footprint(source, near, 1).actions, predict(fitted, near))
    apart = _apart(found.actions, predict(fitted, observations))
    taken = found.code_bytes, found.step_nanoseconds
    return TreeCode(*taken, apart, len(observations), at_thresholds, len(near))


def _apart(ours: Array, theirs: Array) -> int:
    return int((np.abs(ours - theirs) > 1e-6 * np.maximum(1.0, np.abs(theirs))).sum())


def probes(fitted: Any, observations: Array) -> Array:
    """For each comparison three observations that reach it, at its threshold and beside it."""
    tree = fitted.tree_
    reached = fitted.decision_path(observations.astype(np.float32)).toarray().astype(bool)
    rows = []
    for node in range(tree.node_count):
        there = np.flatnonzero(reached[:, node])
        if tree.children_left[node] < 0 or not len(there):
            continue
        at = np.float32(tree.threshold[node])
        for reading in (
            np.nextafter(at, np.float32(-np.inf)),
            at,
            np.nextafter(at, np.float32(np.inf)),
        ):
            row = observations[there[0]].copy()
            row[tree.feature[node]] = reading
            rows.append(row)
    return np.array(rows) if rows else observations[:1]
