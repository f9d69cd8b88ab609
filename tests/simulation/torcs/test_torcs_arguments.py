"""What a TORCS environment cannot be, in its exact words."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest

from pirlc.diagnostics import PirlcError, render
from pirlc.ir.policy import Environment
from pirlc.resources import explanations
from pirlc.simulation.environments import make, register_own
from pirlc.simulation.torcs import arguments

pytestmark = pytest.mark.usefixtures("torcs_installation")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"track": "alborg"},
            "error[E0527]: TORCS has no track called `alborg`\n  = help: did you mean `aalborg`?",
        ),
        (
            {"car": "car1_trb1"},
            "error[E0528]: TORCS has no car called `car1_trb1`\n"
            "  = help: did you mean `car1-trb1`?",
        ),
        (
            {"reward": "distance"},
            "error[E0529]: the TORCS environment has no reward called `distance`\n"
            "  = help: its rewards are `ndps`, `gym_torcs`, `progress`",
        ),
        (
            {"termination": "gymtorcs"},
            "error[E0529]: the TORCS environment has no termination called `gymtorcs`\n"
            "  = help: did you mean `gym_torcs`?",
        ),
        (
            {"blocked": "trackPos, RPM"},
            "error[E0530]: the TORCS environment has no reading called `RPM` to block\n"
            "  = help: did you mean `rpm`?",
        ),
        (
            {"blocked": "gear"},
            "error[E0530]: the TORCS environment has no reading called `gear` to block\n"
            "  = help: its readings are `speedX`, `angle`, `trackPos`, `speedY`, `speedZ`, `rpm`, "
            "`wheelSpinVel0`, `wheelSpinVel1`, `wheelSpinVel2`, `wheelSpinVel3` and 19 more",
        ),
        (
            {"block_probability": 1.5, "blocked": "rpm"},
            "error[E0531]: the TORCS environment's argument `block_probability` cannot be 1.5\n"
            "  = help: it is a number from 0 to 1",
        ),
        (
            {"grip_variation": 1},
            "error[E0531]: the TORCS environment's argument `grip_variation` cannot be 1\n"
            "  = help: it is a number from 0 to 1, less than 1",
        ),
        (
            {"noise": -0.5},
            "error[E0531]: the TORCS environment's argument `noise` cannot be -0.5\n"
            "  = help: it is a number from 0 on",
        ),
        (
            {"laps": 2.5},
            "error[E0531]: the TORCS environment's argument `laps` cannot be 2.5\n"
            "  = help: it is a whole number from 0 to 1,000",
        ),
        (
            {"brake": "yes"},
            "error[E0531]: the TORCS environment's argument `brake` cannot be 'yes'\n"
            "  = help: it is true or false",
        ),
        (
            {"gravity": 9.81},
            "error[E0503]: the environment `pirlc/Torcs-v0` does not take these arguments: "
            "`gravity`\n  = note: the environment says: TypeError: Torcs.__init__() got an "
            "unexpected keyword argument 'gravity'",
        ),
    ],
)
def test_messages(given: dict[str, Any], message: str) -> None:
    with pytest.raises(PirlcError) as caught:
        make(Environment("pirlc/Torcs-v0", tuple(given.items())))
    assert render(caught.value.diagnostics[0]) == message


@pytest.mark.parametrize(
    "given",
    [
        *({"laps": value} for value in (-1, True, "3", float("inf"), 10**9)),
        *({"noise": value} for value in (float("nan"), float("inf"), "much", True)),
        *({"block_probability": value} for value in (-1e-9, None, float("nan"))),
        *({"grip_variation": value} for value in (-0.1, 1.0, 2)),
        *({"track": value} for value in (7, "", None, "../aalborg", "Aalborg")),
        *({"blocked": value} for value in (3, ("rpm",), "rpm;trackPos")),
        *({"reward": value} for value in (0, "", "NDPS")),
    ],
)
def test_refused(given: dict[str, Any]) -> None:
    register_own()
    # Gymnasium's own users meet what they expect of a constructor.
    with pytest.raises(ValueError, match=r"^E05(27|28|29|30|31): "):
        gym.make("pirlc/Torcs-v0", **given)


def test_taken() -> None:
    for given in ({"laps": 0}, {"laps": 2.0}, {"noise": 1}, {"brake": 1}, {"blocked": " , "}):
        make(Environment("pirlc/Torcs-v0", tuple(given.items()))).close()


def test_every_code_has_a_page() -> None:
    codes = re.findall(r'"(E\d{4})"', Path(arguments.__file__).read_text(encoding="utf-8"))
    assert sorted(codes) == ["E0527", "E0528", "E0529", "E0530", "E0531"]
    for code in codes:
        page = (explanations() / f"{code}.md").read_text(encoding="utf-8")
        assert page.startswith(f"# {code}: ") and "## What to do" in page
