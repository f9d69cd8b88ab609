"""A synthesis from end to end on CartPole: what it leaves, and that it can be repeated."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from pirlc.diagnostics import PirlcError
from pirlc.frontend import parse_sketch
from pirlc.ir.expansion import close
from pirlc.pipeline import NoResult, SynthesisResult, synthesize
from pirlc.report.request import OracleRequest, SynthesisRequest
from pirlc.search.settings import Progress, Settings
from pirlc.search.synthesis import Ending, Plan
from pirlc.simulation.workers import Workers
from pirlc.source import SourceText
from pirlc.tune.how import Optimizer
from tests.support.oracles import save_balancer

SKETCH = """policy pole
environment "CartPole-v1"
sensor Angle           : [-0.21, 0.21] = 2
sensor AngularVelocity : [-3.5, 3.5]   = 3
window 2
action Push : {0, 1} = if Guard then 1 else 0
rule Term(x) = ?k * peek(x, -1) | ?k * fold(+, x)
rule Guard = Term(Angle) > ?(c in [-1, 1]) | Term(Angle) + Term(AngularVelocity) > 0
"""

SMALL = Settings(
    create_episodes=3,
    update_episodes=2,
    histories=400,
    pool=6,
    neighbours=4,
    iterations=1,
    simulated=3,
    episodes=10,
    refined=2,
    refine_episodes=600,
    optimizer=Optimizer.CASADI,
)


@pytest.fixture(scope="module")
def oracle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_balancer(tmp_path_factory.mktemp("oracle") / "balancer")


def request_in(place: Path, oracle: Path) -> SynthesisRequest:
    return SynthesisRequest(
        source=SourceText("pole.pirl", SKETCH),
        folder=place / "run",
        cache=place / "cache",
        oracle=OracleRequest(str(oracle)),
        settings=SMALL,
        episodes=20,
    )


@pytest.fixture
def request_(tmp_path: Path, oracle: Path) -> SynthesisRequest:
    return request_in(tmp_path, oracle)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, oracle: Path) -> SynthesisResult:
    """A run from beginning to end, for all who only read it."""
    return run(request_in(tmp_path_factory.mktemp("whole"), oracle))


@pytest.fixture
def done(whole: SynthesisResult, request_: SynthesisRequest) -> SynthesisRequest:
    """The request of a run that is finished already, in a folder to go on in."""
    shutil.copytree(folder_of(whole), request_.folder)
    return request_


def folder_of(result: SynthesisResult) -> Path:
    return result.program_file.parent


def run(request: SynthesisRequest, stages: list[str] | None = None) -> SynthesisResult:
    def tell(progress: Progress) -> None:
        if stages is not None:
            stages.append(progress.stage)

    return synthesize(request, tell, lambda _: None)


def lines(path: Path) -> list[str]:
    return path.read_text().splitlines()


def test_what_a_run_leaves(whole: SynthesisResult) -> None:
    result, folder = whole, folder_of(whole)
    assert result.ending is Ending.FINISHED
    assert result.returns["program"].mean >= 450.0
    assert result.returns["program"] == result.returns["emitted C"]
    assert set(result.returns) == {"program", "emitted C", "oracle", "without refinement"}
    source = SourceText("pole.pirl", result.program_file.read_text())
    assert close(parse_sketch(source)) == result.program
    assert result.front is not None
    front = {f"front/{member['number']}.pirl" for member in result.front["members"]}
    assert {path.relative_to(folder).as_posix() for path in result.files} == front | {
        "front.json",
        "c/pole.c",
        "c/pole.h",
        "python/pole.py",
        "search.png",
        "verification.json",
        "analysis.json",
        "reading.json",
        "traces.json",
        "report.html",
        "report.json",
    }
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["state"] == "finished"
    assert manifest["program"]["size"] == result.program.size
    assert manifest["evaluation"]["returns"]["program"]["mean"] == result.returns["program"].mean
    assert manifest["evaluation"]["first_seed"] == 1_000_000
    assert manifest["oracle"]["algorithm"] == "written by hand"
    met = [json.loads(line) for line in lines(folder / "candidates.jsonl")]
    assert {"size", "loss", "mean_return", "values", "derivations"} <= met[0].keys()
    assert any(entry["stage"] == "refine" for entry in met)


def test_a_run_ends_with_what_is_known_of_the_program(whole: SynthesisResult) -> None:
    dossier, folder = whole.dossier, folder_of(whole)
    assert dossier is not None
    proofs = dossier.verification
    assert [str(found.evidence) for found in proofs.emitted] == ["proved", "proved"]
    assert [bound.action for bound in proofs.bounds] == ["Push"]
    assert dossier.analysis.plant is not None
    assert [relay.action for relay in dossier.analysis.relays] == ["Push"]
    stored = json.loads((folder / "verification.json").read_text())
    assert stored["emitted"][0]["evidence"]["kind"] == "proved"
    traces = json.loads((folder / "traces.json").read_text())
    assert traces["seed"] == 1_000_000 and len(traces["distance"]) == traces["steps"]
    assert "The program states no property to prove." in dossier.verdict


def test_the_same_command_again_only_reads_the_journal(
    whole: SynthesisResult, done: SynthesisRequest
) -> None:
    again = run(done)
    assert again.program_file != whole.program_file
    assert lines(done.folder / "journal.jsonl") == lines(folder_of(whole) / "journal.jsonl")
    assert again.program_file.read_bytes() == whole.program_file.read_bytes()
    assert again.returns == whole.returns


def test_cut_off_anywhere_it_resumes_to_the_same_result(
    whole: SynthesisResult, done: SynthesisRequest
) -> None:
    journal = lines(done.folder / "journal.jsonl")
    kept = "\n".join(journal[: len(journal) // 2]) + "\n" + journal[len(journal) // 2][:9]
    (done.folder / "journal.jsonl").write_text(kept)
    assert run(done).program_file.read_bytes() == whole.program_file.read_bytes()
    assert lines(done.folder / "journal.jsonl") == journal


def test_workers_change_nothing(whole: SynthesisResult, request_: SynthesisRequest) -> None:
    two = run(replace(request_, workers=Workers(2)))
    assert whole.program_file.read_bytes() == two.program_file.read_bytes()
    assert whole.returns == two.returns
    journals = [lines(folder_of(result) / "journal.jsonl") for result in (whole, two)]
    assert journals[0] == journals[1]


def test_a_run_stopped_by_time_is_repeated_by_its_calls(request_: SynthesisRequest) -> None:
    stopped = run(replace(request_, seconds=1.0))
    calls = json.loads((request_.folder / "manifest.json").read_text())["calls_of_search"]
    assert stopped.ending is Ending.BUDGET
    other = replace(request_, folder=request_.folder.parent / "again", calls=calls)
    assert run(other).program == stopped.program


def test_ctrl_c_leaves_a_program_and_resumes(
    whole: SynthesisResult, request_: SynthesisRequest
) -> None:
    def interrupt(progress: Progress) -> None:
        if progress.stage.startswith("refine (round 1"):
            raise KeyboardInterrupt

    cut = synthesize(request_, interrupt, lambda _: None)
    assert cut.ending is Ending.INTERRUPTED
    assert not cut.returns
    assert close(parse_sketch(SourceText("p", cut.program_file.read_text()))) == cut.program
    assert (request_.folder / "c" / "pole.c").is_file()
    assert json.loads((request_.folder / "manifest.json").read_text())["state"] == "interrupted"
    resumed = run(request_)
    assert resumed.program_file.read_bytes() == whole.program_file.read_bytes()


def test_ctrl_c_among_the_proofs_keeps_the_program(
    whole: SynthesisResult, request_: SynthesisRequest
) -> None:
    def interrupt(progress: Progress) -> None:
        if progress.stage == "analyze":
            raise KeyboardInterrupt

    shutil.copytree(folder_of(whole), request_.folder, dirs_exist_ok=True)
    cut = synthesize(request_, interrupt, lambda _: None)
    assert cut.ending is Ending.INTERRUPTED and cut.dossier is None
    assert cut.returns == whole.returns
    manifest = request_.folder / "manifest.json"
    assert json.loads(manifest.read_text())["state"] == "interrupted"
    assert run(request_).dossier is not None
    assert json.loads(manifest.read_text())["state"] == "finished"


def test_without_oracle_and_without_refinement(request_: SynthesisRequest) -> None:
    stages: list[str] = []
    result = run(replace(request_, oracle=None, plan=Plan(refine=False)), stages)
    assert set(result.returns) == {"program", "emitted C"}
    assert result.returns["program"].mean >= 100.0
    assert not any(stage.startswith("refine") for stage in stages)


def refused(request: SynthesisRequest) -> str:
    with pytest.raises(PirlcError) as caught:
        run(request)
    return caught.value.diagnostics[0].code


def test_folders_of_others_stay_as_they_are(done: SynthesisRequest, tmp_path: Path) -> None:
    before = {p: p.read_bytes() for p in done.folder.rglob("*") if p.is_file()}
    other = replace(done, settings=replace(SMALL, seed=1))
    assert refused(other) == "E0723"
    assert {p: p.read_bytes() for p in done.folder.rglob("*") if p.is_file()} == before
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("hello")
    assert refused(replace(done, folder=tmp_path / "mine")) == "E0722"
    (done.folder / "manifest.json").write_text("gibberish")
    assert refused(done) == "E0724"


def test_nothing_small_enough_and_no_time(request_: SynthesisRequest) -> None:
    assert refused(replace(request_, settings=replace(SMALL, largest=3))) == "E0726"
    early = replace(request_, folder=request_.folder.parent / "early", seconds=1e-9)
    nothing = synthesize(early, lambda _: None, lambda _: None)
    assert isinstance(nothing, NoResult) and nothing.ending is Ending.TIMEOUT
    assert json.loads((early.folder / "manifest.json").read_text())["state"] == "timeout"
    hardware = SKETCH.replace('environment "CartPole-v1"\n', "")
    assert refused(replace(request_, source=SourceText("pole.pirl", hardware))) == "E0721"
