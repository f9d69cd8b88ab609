"""`--pick`: a program of the front in place of the search's own, also after the fact."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from pirlc.diagnostics import PirlcError
from pirlc.frontend import parse_sketch
from pirlc.ir.expansion import close
from pirlc.ir.policy import Program
from pirlc.pipeline import SynthesisResult, synthesize
from pirlc.report.front_table import table
from pirlc.report.problems import NotOnTheFront, describe
from pirlc.report.request import OracleRequest, SynthesisRequest
from pirlc.search.settings import Progress, Settings
from pirlc.search.synthesis import Ending
from pirlc.source import SourceText
from pirlc.tune.how import Optimizer
from tests.support.oracles import save_balancer

SKETCH = """policy pole
environment "CartPole-v1" { max_episode_steps = 60 }
sensor Angle           : [-0.21, 0.21] = 2
sensor AngularVelocity : [-3.5, 3.5]   = 3
action Push : {0, 1} = Law
rule Law = 1 | if Guard then 1 else 0
rule Term(x) = ?k * peek(x, -1)
rule Guard = Term(Angle) > ?(c in [-1, 1]) | Term(Angle) + Term(AngularVelocity) > 0
"""
"""Always 1 falls at once, the angle alone soon; with its velocity the pole stands."""

SMALL = Settings(
    create_episodes=3,
    update_episodes=2,
    histories=300,
    pool=3,
    neighbours=3,
    iterations=1,
    simulated=3,
    episodes=10,
    refined=1,
    refine_episodes=200,
    optimizer=Optimizer.CASADI,
)


def run(request: SynthesisRequest) -> SynthesisResult:
    result = synthesize(request, lambda _: None, lambda _: None)
    assert isinstance(result, SynthesisResult)
    return result


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[SynthesisRequest, SynthesisResult]:
    """A run without a pick; nobody writes into its folder."""
    place = tmp_path_factory.mktemp("pick")
    request = SynthesisRequest(
        source=SourceText("pole.pirl", SKETCH),
        folder=place / "run",
        cache=place / "cache",
        oracle=OracleRequest(str(save_balancer(place / "oracle"))),
        settings=SMALL,
        episodes=15,
    )
    return request, run(request)


@pytest.fixture
def request_(whole: tuple[SynthesisRequest, SynthesisResult], tmp_path: Path) -> SynthesisRequest:
    """The request of the same run in a folder to go on in, where it is finished."""
    request = replace(whole[0], folder=tmp_path / "run")
    shutil.copytree(whole[0].folder, request.folder)
    return request


def program_in(path: Path) -> Program | None:
    return close(parse_sketch(SourceText(path.name, path.read_text())))


def stored(folder: Path, name: str) -> dict:
    return json.loads((folder / name).read_text())


def journal(folder: Path) -> list[str]:
    return [json.loads(line)["key"] for line in (folder / "journal.jsonl").read_text().splitlines()]


def test_the_front_is_written(whole: tuple[SynthesisRequest, SynthesisResult]) -> None:
    request, result = whole
    front = stored(request.folder, "front.json")
    assert front == result.front
    members = front["members"]
    assert len(members) >= 2
    assert [m["number"] for m in members] == list(range(1, len(members) + 1))
    assert members[-1]["size"] == 1
    assert members[0]["return"]["mean"] == 60.0 and members[-1]["return"]["mean"] < 15.0
    assert [m["loss"]["mean"] for m in members] == [
        pytest.approx(60.0 - m["return"]["mean"]) for m in members
    ]
    assert {m["return"]["episodes"] for m in members} == {front["episodes"]} == {20}
    assert (front["picked"], front["program_sha256"]) == (
        None,
        stored(request.folder, "manifest.json")["program"]["sha256"],
    )
    for member in members:
        path = request.folder / "front" / f"{member['number']}.pirl"
        assert path in result.files
        program = program_in(path)
        assert program is not None and program.size == member["size"]
    assert stored(request.folder, "manifest.json")["picked"] is None
    chosen = front["chosen"]
    assert chosen is None or program_in(request.folder / f"front/{chosen}.pirl") == result.program


def test_a_program_picked_after_the_fact(
    whole: tuple[SynthesisRequest, SynthesisResult], request_: SynthesisRequest
) -> None:
    before = journal(request_.folder)
    assert whole[1].front is not None
    last = len(whole[1].front["members"])
    picked = run(replace(request_, pick=last))
    assert picked.program.size == 1 != whole[1].program.size
    assert picked.program == program_in(request_.folder / "front" / f"{last}.pirl")
    assert picked.program == program_in(picked.program_file)
    # Nothing is searched again: only the picked program and its C are new, in the evaluation.
    after = journal(request_.folder)
    assert after[: len(before)] == before
    assert [key.partition(":")[0] for key in after[len(before) :]] == ["evaluate", "evaluate"]
    assert picked.returns["program"] == picked.returns["emitted C"]
    assert picked.returns["program"].mean < 15.0
    assert picked.returns["oracle"] == whole[1].returns["oracle"]
    # Everything in the folder is about that program.
    manifest = stored(request_.folder, "manifest.json")
    assert (manifest["picked"], manifest["program"]["size"]) == (last, 1)
    digest = manifest["program"]["sha256"]
    about = ("verification.json", "analysis.json", "reading.json", "front.json", "traces.json")
    assert {stored(request_.folder, name)["program_sha256"] for name in about} == {digest}
    page = stored(request_.folder, "report.json")
    assert page["program"]["sha256"] == digest and page["front"]["members"][-1]["mark"] == "picked"
    # And without the option it is the search's own again, to the byte.
    again = run(request_)
    assert again.program_file.read_bytes() == whole[1].program_file.read_bytes()
    assert journal(request_.folder) == after
    assert stored(request_.folder, "manifest.json")["picked"] is None


def test_a_number_that_the_front_lacks(
    whole: tuple[SynthesisRequest, SynthesisResult], request_: SynthesisRequest
) -> None:
    before = journal(request_.folder)
    assert whole[1].front is not None
    with pytest.raises(PirlcError) as caught:
        run(replace(request_, pick=9))
    (diagnostic,) = caught.value.diagnostics
    members = whole[1].front["members"]
    assert diagnostic.code == "E0745"
    assert diagnostic.notes == tuple(table(members))
    assert journal(request_.folder) == before


def test_the_message() -> None:
    shown = describe(NotOnTheFront(3, ("   nodes  return", "1     14  500.00", "2      1    9.31")))
    assert (shown.message, shown.notes, shown.help) == (
        "there is no program 3 to pick: the front has 2 programs, numbered from 1",
        ("   nodes  return", "1     14  500.00", "2      1    9.31"),
        "the same command with another `--pick` takes another one; the search is not done again",
    )
    assert describe(NotOnTheFront(2, ("", "1"))).message.endswith("the front has one program")


def test_an_interrupted_search_has_no_front(request_: SynthesisRequest) -> None:
    def interrupt(progress: Progress) -> None:
        if progress.stage.startswith("refine"):
            raise KeyboardInterrupt

    cut = synthesize(replace(request_, pick=2), interrupt, lambda _: None)
    assert isinstance(cut, SynthesisResult)
    assert (cut.ending, cut.front) == (Ending.INTERRUPTED, None)
    assert not (request_.folder / "front.json").exists()
    assert not (request_.folder / "front").exists()
    assert stored(request_.folder, "manifest.json")["picked"] is None


def test_ctrl_c_while_the_front_is_measured(request_: SynthesisRequest) -> None:
    def interrupt(progress: Progress) -> None:
        if progress.stage.startswith("simulate (front"):
            raise KeyboardInterrupt

    cut = synthesize(request_, interrupt, lambda _: None)
    assert isinstance(cut, SynthesisResult)
    assert (cut.ending, cut.front, dict(cut.returns)) == (Ending.INTERRUPTED, None, {})
    assert run(request_).front is not None


def test_a_budget_that_is_used_up_has_the_front_of_what_is_known(
    request_: SynthesisRequest, tmp_path: Path
) -> None:
    short = replace(request_, folder=tmp_path / "short", calls=12)
    result = run(short)
    assert result.ending is Ending.BUDGET
    assert result.front is not None and result.front["members"]
    assert stored(short.folder, "manifest.json")["calls_of_search"] == 12
