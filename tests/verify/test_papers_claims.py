"""What the paper claims of its printed programs, and what is so."""

from __future__ import annotations

from itertools import pairwise

import pytest

from pirlc.verify.properties.prove import prove
from tests.verify.proving import PROVED, REFUTED, kinds, precision_of_replay

BY_ROUNDING = ("proved", "refuted", "refuted")

STATUS = {
    "aalborg": {
        "accel_smooth": PROVED,
        "steer_smooth": REFUTED,
        "accel_bounds": PROVED,
        "steer_bounds": BY_ROUNDING,
    },
    "g-track-1": {
        "accel_smooth": REFUTED,
        "steer_smooth": REFUTED,
        "accel_bounds": REFUTED,
        "steer_bounds": PROVED,
    },
}


@pytest.mark.parametrize("name", STATUS)
def test_the_status_of_the_papers_claims(printed, name):
    program = printed(name)
    findings = {finding.name: finding for finding in prove(program)}
    assert {name: kinds(finding) for name, finding in findings.items()} == STATUS[name]
    for finding in findings.values():
        # The bar is a second; a busy machine gets some more.
        assert finding.seconds < 5
        if finding.counterexample is not None:
            precision_of_replay(program, finding.counterexample)


def test_steering_that_does_not_hold_its_bound_is_seen_in_the_numbers(printed):
    finding = next(f for f in prove(printed("aalborg")) if f.name == "steer_smooth")
    readings = finding.counterexample.history.readings["trackPos"][-7:]
    changes = [abs(b - a) for a, b in pairwise(readings)]
    before, last = (step.raw["steer"] for step in finding.counterexample.steps[-2:])
    assert sum(changes) < 0.006
    assert abs(last - before) >= 0.11


def test_the_steerings_supremum_is_reached_in_floats_only(printed):
    finding = next(f for f in prove(printed("aalborg")) if f.name == "steer_bounds")
    assert abs(finding.counterexample.steps[0].raw["steer"]) >= 101.08
    assert finding.binary64.reason == "by rounding alone: it holds over the reals"
