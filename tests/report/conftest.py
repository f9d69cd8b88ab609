"""Runs to make pages of: small real ones."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from pirlc.pipeline import SynthesisResult, synthesize
from pirlc.report.data import as_data
from pirlc.report.page import write_report
from pirlc.report.request import OracleRequest, SynthesisRequest
from pirlc.report.traces import trace_episode, write_traces
from pirlc.search.settings import Settings
from pirlc.source import SourceText
from tests.support.findings import analysis, verification
from tests.support.oracles import balancer, save_balancer

SKETCH = """# A <script>alert("comment")</script> & more
policy pole
environment "CartPole-v1"
sensor Angle : [-0.21, 0.21] = 2
sensor Speed : [-3.5, 3.5]   = 3
window 2
action Push : {0, 1} = if Guard then 1 else 0
rule Term(x) = ?k * peek(x, -1) | ?k * fold(+, x)
rule Guard = Term(Angle) > ?(c in [-1, 1]) | Term(Angle) + Term(Speed) > 0
property answers = Push == 0 or Push == 1
"""

SETTINGS = Settings(
    create_episodes=2,
    update_episodes=1,
    histories=200,
    pool=4,
    neighbours=3,
    iterations=1,
    simulated=2,
    episodes=5,
    refined=1,
    refine_episodes=100,
)


@pytest.fixture(scope="session")
def synthesised(tmp_path_factory: pytest.TempPathFactory) -> SynthesisResult:
    """A real run of a second or two; nobody writes into its folder."""
    place = tmp_path_factory.mktemp("report")
    request = SynthesisRequest(
        source=SourceText("pole.pirl", SKETCH),
        folder=place / "run",
        cache=place / "cache",
        oracle=OracleRequest(str(save_balancer(place / "oracle"))),
        settings=SETTINGS,
        episodes=10,
        workers=1,
    )
    return synthesize(request, lambda _: None, lambda _: None)


@pytest.fixture
def run(synthesised: SynthesisResult, tmp_path: Path) -> Path:
    """The folder of that run, copied, without what proofs and analysis may have left."""
    folder = tmp_path / "pole"
    shutil.copytree(synthesised.program_file.parent, folder)
    for name in ("verification.json", "analysis.json", "traces.json", "report.html", "report.json"):
        (folder / name).unlink(missing_ok=True)
    return folder


@pytest.fixture
def full(run: Path, synthesised: SynthesisResult) -> Path:
    """The run with its traces, and with findings of every kind."""
    add_findings(run)
    program = synthesised.program
    environment = program.interface.environment
    assert environment is not None
    write_traces(trace_episode(program, environment, balancer(), 1_000_000), run)
    return run


def add_findings(run: Path) -> None:
    (run / "verification.json").write_text(json.dumps(as_data(verification())))
    (run / "analysis.json").write_text(json.dumps(as_data(analysis())))


Reported = Callable[[Path], tuple[str, dict]]


@pytest.fixture
def reported() -> Reported:
    """Makes the page of a folder: its HTML and its data."""

    def report(folder: Path) -> tuple[str, dict]:
        page, data = write_report(folder)
        assert (page, data) == (folder / "report.html", folder / "report.json")

        def no_constant(name: str) -> None:
            raise AssertionError(f"{name} is no JSON")

        return page.read_text(), json.loads(data.read_text(), parse_constant=no_constant)

    return report
