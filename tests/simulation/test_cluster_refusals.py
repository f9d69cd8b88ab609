"""What is said of clusters that are not there, or are not fit for work."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from pirlc.diagnostics import PirlcError, render
from pirlc.resources import explanations
from pirlc.simulation.cluster import problems
from pirlc.simulation.cluster.backend import RayBackend
from pirlc.simulation.cluster.problems import (
    ClusterLost,
    NoCluster,
    NodeDiffers,
    NodeUnusable,
    NotShipped,
    Problem,
    RayMissing,
    describe,
)
from pirlc.simulation.cluster.sameness import first_difference, traits
from tests.support.command_line import ROOT
from tests.support.ray_cluster import free_port


def refusal(address: str) -> str:
    with pytest.raises(PirlcError) as caught:
        RayBackend(address)
    (diagnostic,) = caught.value.diagnostics
    return render(diagnostic)


HOW_TO_START = (
    "  = help: start one with `ray start --head`, join this machine to one with "
    "`ray start --address=HOST:6379`, or leave `--backend ray` out\n"
)

INSTALL = (
    "  = help: install the same Python and packages on every machine: `pip install 'pirlc[ray]'`\n"
)

MESSAGES: list[tuple[Problem, str]] = [
    (
        RayMissing("there is no module called `ray`"),
        "error[E0545]: Ray is not installed\n"
        "  = note: there is no module called `ray`\n"
        "  = help: `pip install 'pirlc[ray]'`, or leave `--backend ray` out\n",
    ),
    (
        NoCluster("auto", "Could not find any running Ray instance"),
        "error[E0546]: there is no Ray cluster on this machine\n"
        "  = note: Could not find any running Ray instance\n" + HOW_TO_START,
    ),
    (
        NodeUnusable("10.0.0.2 (two)", "No module named 'pirlc'"),
        "error[E0547]: pirlc does not run on the node 10.0.0.2 (two) of the cluster\n"
        "  = note: No module named 'pirlc'\n" + INSTALL,
    ),
    (
        NodeDiffers("10.0.0.2 (two)", "numpy", "2.1.0", "1.26.4"),
        "error[E0547]: the node 10.0.0.2 (two) of the cluster has another numpy\n"
        "  = note: 2.1.0 here, 1.26.4 there; results could differ\n" + INSTALL,
    ),
    (
        ClusterLost("none of its nodes is left"),
        "error[E0548]: the cluster is gone\n"
        "  = note: none of its nodes is left\n"
        "  = help: what was finished is kept: the same command goes on from there, on a cluster or "
        "without `--backend ray`\n",
    ),
    (
        NotShipped("cannot pickle '_thread.lock' object"),
        "error[E0549]: this work cannot be sent to another machine\n"
        "  = note: cannot pickle '_thread.lock' object\n"
        "  = help: leave `--backend ray` out\n",
    ),
]


@pytest.mark.parametrize(("problem", "message"), MESSAGES)
def test_messages(problem: Problem, message: str) -> None:
    assert render(describe(problem)).rstrip("\n") == message.rstrip("\n")


def test_every_code_has_a_page() -> None:
    codes = set(re.findall(r'"(E\d{4})"', Path(problems.__file__).read_text(encoding="utf-8")))
    assert codes == {"E0545", "E0546", "E0547", "E0548", "E0549"}
    for code in codes:
        page = (explanations() / f"{code}.md").read_text(encoding="utf-8")
        assert page.startswith(f"# {code}: ") and "## What to do" in page


@pytest.mark.parametrize("address", ["localhost", "ray://localhost:10001", "host:http", ":", ""])
def test_addresses_of_no_form(address: str) -> None:
    pytest.importorskip("ray")
    assert refusal(address).startswith(
        f"error[E0546]: there is no Ray cluster at `{address}`\n"
        "  = note: an address has the form HOST:PORT, such as `10.0.0.1:6379`, or is `auto`\n"
    )


def test_nobody_at_the_address() -> None:
    pytest.importorskip("ray")
    address = f"127.0.0.1:{free_port()}"
    assert refusal(address).rstrip("\n") == (
        f"error[E0546]: there is no Ray cluster at `{address}`\n"
        "  = note: Connection refused\n" + HOW_TO_START.rstrip("\n")
    )
    assert refusal("127.0.0.1:123456").startswith("error[E0546]")


def test_ray_is_an_extra() -> None:
    script = (
        "import sys\n"
        "sys.modules['ray'] = None\n"  # what Python itself keeps of a module that is not there
        "from pirlc.diagnostics import PirlcError\n"
        "from pirlc.simulation.cluster.backend import RayBackend\n"
        "try:\n"
        "    RayBackend()\n"
        "except PirlcError as error:\n"
        "    print(error.diagnostics[0].code)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, cwd=ROOT
    )
    assert (done.stdout, done.stderr) == ("E0545\n", "")


def test_sameness() -> None:
    here = traits()
    assert first_difference(here, here) is None
    names = [name for name, _ in here]
    assert names[:3] == ["Python", "kind of machine", "pirlc"] and "numpy" in names
    other = tuple((name, "9.9" if name == "numpy" else value) for name, value in here)
    assert first_difference(here, other) == ("numpy", dict(here)["numpy"], "9.9")
    assert first_difference(here, ()) == ("Python", dict(here)["Python"], "none")
