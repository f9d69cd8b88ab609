"""Runs to make pages of: small real ones."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from pirlc.pipeline import SynthesisResult, synthesize
from pirlc.report.data import as_data
from pirlc.report.page import write_report
from pirlc.report.request import OracleRequest, SynthesisRequest
from pirlc.report.traces import trace_episode, write_traces
from pirlc.search.settings import Progress, Settings
from pirlc.search.synthesis import Ending
from pirlc.source import SourceText
from pirlc.tune.how import Optimizer
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
    optimizer=Optimizer.CASADI,
)


def request_in(place: Path) -> SynthesisRequest:
    return SynthesisRequest(
        source=SourceText("pole.pirl", SKETCH),
        folder=place / "run",
        cache=place / "cache",
        oracle=OracleRequest(str(save_balancer(place / "oracle"))),
        settings=SETTINGS,
        episodes=10,
    )


@pytest.fixture(scope="session")
def synthesised(tmp_path_factory: pytest.TempPathFactory) -> SynthesisResult:
    """A real run of a second or two; nobody writes into its folder."""
    return synthesize(request_in(tmp_path_factory.mktemp("report")), lambda _: None, lambda _: None)


@pytest.fixture
def interrupted(tmp_path: Path) -> Path:
    """The folder of such a run that somebody stopped with Ctrl-C."""

    def interrupt(progress: Progress) -> None:
        if progress.stage.startswith("refine"):
            raise KeyboardInterrupt

    request = request_in(tmp_path)
    assert synthesize(request, interrupt, lambda _: None).ending is Ending.INTERRUPTED
    return request.folder


@pytest.fixture(scope="session")
def traced(synthesised: SynthesisResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of that run with findings of every kind; nobody writes into it either."""
    folder = tmp_path_factory.mktemp("traced") / "pole"
    shutil.copytree(synthesised.program_file.parent, folder)
    add_findings(folder)
    program = synthesised.program
    environment = program.interface.environment
    assert environment is not None
    write_traces(trace_episode(program, environment, balancer(), 1_000_000), folder)
    return folder


@dataclass(frozen=True)
class Made:
    """A page that was made, and what it and the JSON beside it say."""

    page: Path
    text: str
    data: dict


@pytest.fixture(scope="session")
def shown(traced: Path, tmp_path_factory: pytest.TempPathFactory) -> Made:
    """The page of a run on which nothing is missing."""
    folder = shutil.copytree(traced, tmp_path_factory.mktemp("shown") / "pole")
    return Made(folder / "report.html", *make_report(folder))


@pytest.fixture
def full(traced: Path, tmp_path: Path) -> Path:
    """The same folder, to do something to."""
    return shutil.copytree(traced, tmp_path / "pole")


@pytest.fixture
def run(full: Path) -> Path:
    """The folder without proofs, analysis and traces."""
    for name in ("verification.json", "analysis.json", "traces.json", "report.html", "report.json"):
        (full / name).unlink(missing_ok=True)
    return full


def add_findings(run: Path) -> None:
    about = {"program_sha256": json.loads((run / "manifest.json").read_text())["program"]["sha256"]}
    (run / "verification.json").write_text(json.dumps(about | as_data(verification())))
    (run / "analysis.json").write_text(json.dumps(about | as_data(analysis())))


Reported = Callable[[Path], tuple[str, dict]]


@pytest.fixture
def reported() -> Reported:
    """Makes the page of a folder: its HTML and its data."""
    return make_report


def make_report(folder: Path) -> tuple[str, dict]:
    page, data = write_report(folder)
    assert (page, data) == (folder / "report.html", folder / "report.json")

    def no_constant(name: str) -> None:
        raise AssertionError(f"{name} is no JSON")

    return page.read_text(), json.loads(data.read_text(), parse_constant=no_constant)
