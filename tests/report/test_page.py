"""The page of a run: what it says is what the JSON beside it says, whatever the run holds."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest

from pirlc import resources
from pirlc.diagnostics import PirlcError, render
from pirlc.report.page import write_report
from pirlc.report.problems import DamagedFile, NoRun, describe
from tests.support.pages import HOSTILE, SECTIONS, Page, agrees, figures_in, hostile, resolved


def sections(page: Page) -> list[str]:
    return [str(given["id"]) for tag, given in page.tags if tag == "section"]


def check_figures(page: Page, data: dict) -> int:
    """Every text with a figure in it is in the JSON; how many elements say so."""
    for text in page.stray:
        assert not figures_in(text), f"no place in the JSON: {text!r}"
    for shown in page.shown:
        value = resolved(data, shown.pointer)
        if shown.tag == "figure":
            assert isinstance(value, dict | list) and value
        elif shown.tag == "data":
            assert shown.value is not None and json.loads(shown.value) == value
            assert agrees(shown.text, value), (shown, value)
        elif value in ("inf", "-inf"):
            assert shown.text.startswith("unlimited")
        else:
            words = {None: "—", True: "yes", False: "no"}
            text = value.replace("`", "") if isinstance(value, str) else words[value]
            assert shown.text.replace("`", "") == text
    for shown in page.keys:
        resolved(data, shown.pointer)
        token = shown.pointer.rpartition("/")[2]
        assert token.replace("~1", "/").replace("~0", "~") == shown.text
    return len(page.shown)


def test_a_whole_page(shown):
    text, data, full = shown.text, shown.data, shown.page.parent
    page = Page(text)
    assert sections(page) == SECTIONS
    assert check_figures(page, data) > 150
    assert not data["missing"] and "not complete" not in text
    manifest = json.loads((full / "manifest.json").read_text())
    returns = {subject["name"]: subject for subject in data["returns"]["subjects"]}
    assert set(returns) == {"program", "emitted C", "oracle", "without refinement"}
    assert returns["program"]["mean"] == manifest["evaluation"]["returns"]["program"]["mean"]
    assert data["program"]["text"] == manifest["program"]["text"]
    texts = {found.pointer: found.text for found in page.shown}
    assert texts["/program/text"] == manifest["program"]["text"]
    assert texts["/sketch"] == (full / "sketch.pirl").read_text()
    assert texts["/head/environment"] == '"CartPole-v1"'


def test_a_run_by_itself(run, reported):
    text, data = reported(run)
    page = Page(text)
    check_figures(page, data)
    assert sections(page) == [
        "program", "reading", "returns", "front", "search", "resources", "sketch"
    ]  # fmt: skip
    assert [line.split(":")[0] for line in data["missing"]] == [
        "There are no action traces",
        "Nothing is proved here",
        "No control-theory figures",
    ]


def test_how_it_was_found(run, reported):
    _, data = reported(run)
    entries = [json.loads(line) for line in (run / "candidates.jsonl").read_text().splitlines()]
    search = data["search"]
    assert search["tuned"] == sum(e["stage"].startswith("tune") for e in entries)
    assert len(search["points"]) == search["simulated"]
    tuned = [e["loss"] for e in entries if e["stage"] == "tune (initialize)"]
    first = search["iterations"][0]
    assert (first["stage"], first["tuned"]) == ("initialize", len(tuned))
    assert first["closest"] == min(tuned) == first["distances"][0]
    chosen = max((e for e in entries if e["stage"] == "initialize"), key=lambda e: e["mean_return"])
    assert first["chosen_return"] == chosen["mean_return"]
    means = [record["mean_return"] for record in search["records"]]
    sizes = [record["size"] for record in search["records"]]
    assert means == sorted(means) and sizes == sorted(set(sizes))
    assert all(record["program"].startswith("action Push = ") for record in search["records"])
    assert {row["size"] for row in search["by_size"]} == {e["size"] for e in entries}


def test_which_optimiser_found_the_parameters(run, reported):
    manifest = json.loads((run / "manifest.json").read_text())
    assert manifest["optimizer"]["why"] == "asked for"
    page, data = reported(run)
    assert data["search"]["optimizer"] == {
        "chosen": "casadi",
        "why": "asked for",
        "distances": [],
    }
    assert "Parameters were found by casadi: asked for." in _words(page)
    manifest["optimizer"]["why"] = "the closest"
    manifest["optimizer"]["mean_distances"] = {"casadi": 0.12, "bayes": 0.145, "smt": 0.131}
    (run / "manifest.json").write_text(json.dumps(manifest))
    page, _ = reported(run)
    distances = "casadi 0.12, smt 0.131, bayes 0.145"
    assert f"(mean distance to the oracle on a few templates: {distances})." in _words(page)


def _words(page: str) -> str:
    """What a page says, its marks and breaks left out."""
    return " ".join(re.sub(r"<[^>]*>", "", page).split())


def test_resources_are_those_of_the_emitted_code(run, reported):
    _, data = reported(run)
    header = (run / "c" / "pole.h").read_text()
    found = data["resources"]
    assert f"State: {found['state_bytes']} bytes" in header
    assert f"step: {found['operations']} operations" in header
    assert {file["path"]: file["bytes"] for file in found["files"]} == {
        path: (run / path).stat().st_size for path in ("c/pole.c", "c/pole.h", "python/pole.py")
    }
    manifest = json.loads((run / "manifest.json").read_text())
    assert found["search_calls"] == manifest["calls_of_search"]


def test_the_verdict(shown):
    returns, proofs, emitted, loops = shown.data["head"]["verdict"]
    assert returns["mark"] == "plain" and returns["text"].startswith("Return over 10 unseen")
    assert proofs == {
        "about": "proofs",
        "mark": "bad",
        "text": "Properties proved: 1 of 3 in real arithmetic, 1 in binary64, 1 in binary32. "
        "Refuted: smooth.",
    }
    assert emitted["mark"] == "bad" and "proved for double, refuted for float" in emitted["text"]
    assert loops == {
        "about": "loops",
        "mark": "linear",
        "text": "Linearised loops in force at the operating point: 1 of 1 stable; smallest "
        "margins: gain unlimited, phase 47.2 degrees, delay 5.4 samples. Of leaves that are not "
        "taken there: 0 of 1 stable.",
    }


def test_loops_around_a_model_that_explains_little(full, reported):
    path = full / "analysis.json"
    analysis = json.loads(path.read_text())
    analysis["plant"]["fit"] = {"Side": 12.0}
    path.write_text(json.dumps(analysis))
    _, data = reported(full)
    loops = data["head"]["verdict"][-1]
    assert loops["mark"] == "open"
    assert loops["text"].endswith("The identified plant explains as little as 12 % of a reading.")


def test_what_is_refuted_is_plotted(shown):
    text = shown.text
    figures = [found.pointer for found in Page(text).shown if found.tag == "figure"]
    assert "/verification/found/properties/1/counterexample" in figures
    assert "/verification/found/properties/1/obligations/1/counterexample" in figures
    titles = re.findall(r"<title id=\"[^\"]*\">([^<]*)</title>", text)
    assert "Counterexample to smooth, with a missing reading" in titles
    assert len(titles) == text.count("<svg ") == text.count('role="img"')


def test_ids_are_the_pages_own(shown):
    text = shown.text
    page = Page(text)
    ids = [given["id"] for _, given in page.tags if given.get("id")]
    assert len(ids) == len(set(ids))
    used = set(re.findall(r"url\(#([^)]*)\)", text)) | set(re.findall(r'href="#([^"]*)"', text))
    assert used <= set(ids)


def test_the_same_folder_gives_the_same_bytes(shown, full):
    first = [shown.page.read_bytes(), shown.page.with_name("report.json").read_bytes()]
    assert full != shown.page.parent
    assert [place.read_bytes() for place in write_report(full)] == first


def test_the_page_holds_all_that_it_needs(shown):
    text = shown.text
    for tag, given in Page(text).tags:
        assert tag not in ("script", "iframe", "object", "embed", "img", "form", "base")
        for name, value in given.items():
            assert not name.startswith("on")
            if name in ("src", "href", "xlink:href"):
                assert value is not None and value.startswith(("#", "data:,"))
    assert "@import" not in text and "url(http" not in text


# Texts that nobody should trust.


def test_texts_stay_texts(full, reported):
    for name in ("verification.json", "analysis.json", "traces.json"):
        (full / name).write_text(json.dumps(hostile(json.loads((full / name).read_text()))))
    manifest = json.loads((full / "manifest.json").read_text())
    manifest["program"]["text"] += HOSTILE
    manifest["environment"] = {"id": HOSTILE, "arguments": {"track": HOSTILE}}
    manifest["oracle_from"] = HOSTILE
    manifest["versions"]["pirlc"] = HOSTILE
    (full / "manifest.json").write_text(json.dumps(manifest))
    (full / "sketch.pirl").write_text(HOSTILE + (full / "sketch.pirl").read_text())
    text, data = reported(full)
    page = Page(text)
    check_figures(page, data)
    assert sections(page) == SECTIONS
    assert not {"script", "img"} & {tag for tag, _ in page.tags}
    assert not any(name.startswith("on") for _, given in page.tags for name in given)
    # It is there, as text.
    plain = HOSTILE.replace("`", "")
    assert sum(plain in found.text.replace("`", "") for found in page.shown) > 100


# What is not there, and what is not as it should be.


def test_a_run_that_was_broken_off(run, reported):
    manifest = json.loads((run / "manifest.json").read_text())
    asked = {"asked": manifest["asked"], "state": "running"}
    (run / "manifest.json").write_text(json.dumps(asked))
    (run / "pole.pirl").unlink()
    shutil.rmtree(run / "c")
    # In the middle of a line.
    lines = (run / "candidates.jsonl").read_text().splitlines(keepends=True)
    (run / "candidates.jsonl").write_text("".join(lines[:3]) + lines[3][:20])
    text, data = reported(run)
    page = Page(text)
    check_figures(page, data)
    assert data["head"]["policy"] == "pole" and data["head"]["environment"] == '"CartPole-v1"'
    assert "goes on from here" in data["head"]["state_words"]
    assert data["head"]["verdict"] == [
        {"about": "program", "mark": "open", "text": "No program has been found yet."}
    ]
    assert data["search"]["tuned"] == 3
    assert sections(page) == ["search", "resources", "sketch"]


def test_a_run_that_has_only_begun(tmp_path, reported, run):
    folder = tmp_path / "begun"
    folder.mkdir()
    asked = json.loads((run / "manifest.json").read_text())["asked"]
    (folder / "manifest.json").write_text(json.dumps({"asked": asked, "state": "running"}))
    text, data = reported(folder)
    page = Page(text)
    check_figures(page, data)
    assert (data["head"]["policy"], data["head"]["environment"]) == ("begun", None)
    assert len(data["missing"]) == 6


def test_an_interrupted_run_says_what_was_not_measured(interrupted, reported):
    text, data = reported(interrupted)
    page = Page(text)
    check_figures(page, data)
    assert [line.split(":")[0] for line in data["missing"]] == [
        "Returns were not measured",
        "There are no action traces",
        "Nothing is proved here",
        "The program is not told in words",
        "No control-theory figures",
    ]
    assert sections(page) == ["program", "search", "resources", "sketch"]
    assert "The run was interrupted" in text
    assert data["head"]["verdict"][0]["mark"] == "open"


def test_findings_about_another_program_are_not_shown(full, reported):
    found = json.loads((full / "verification.json").read_text())
    (full / "verification.json").write_text(json.dumps(found | {"program_sha256": "0" * 64}))
    text, data = reported(full)
    assert sections(Page(text)) == [name for name in SECTIONS if name != "proofs"]
    assert data["missing"] == [
        "Nothing is proved here: `verification.json` is about another program, which this run had "
        "before. `pirlc verify` proves the properties of a program by itself."
    ]
    assert "verification has not been run" in text


def test_the_program_in_words(shown):
    (head, sensors, push) = shown.data["reading"]["sections"]
    assert head["title"] == "pole"
    assert sensors["parts"][0]["headings"][0] == "sensor"
    assert push["title"] == "Push one of {0, 1}"
    texts = {found.pointer: found.text for found in Page(shown.text).shown}
    assert texts["/reading/sections/2/parts/0/rows/0/1"] == "push right"
    assert texts["/reading/sections/2/parts/0/rows/1/2"] == "otherwise"


def test_the_programs_to_choose_from(shown, synthesised):
    stored = json.loads((shown.page.parent / "front.json").read_text())
    members = shown.data["front"]["members"]
    assert [m["size"] for m in members] == [m["size"] for m in stored["members"]]
    assert stored["program_sha256"] == shown.data["program"]["sha256"]
    page = Page(shown.text)
    assert any(s.tag == "figure" and s.pointer == "/front/members" for s in page.shown)
    assert {m["mark"] for m in members} <= {"", "the search's own"}
    assert shown.data["front"]["episodes"] == synthesised.front["episodes"] == 10


def test_traces_of_many_steps_and_without_an_oracle(full, reported):
    traces = json.loads((full / "traces.json").read_text())
    (push,) = traces["actions"]
    push["program"] = [1.0, 0.0] * 600
    push["oracle"] = None
    traces |= dict.fromkeys(("distance", "mean_distance", "largest_distance")) | {"steps": 1200}
    (full / "traces.json").write_text(json.dumps(traces))
    text, data = reported(full)
    check_figures(Page(text), data)
    assert data["limits"] == {"trace_steps": 1000, "traces_cut": True}
    assert "the first <data" in text and "the oracle was asked" not in text


def test_without_an_oracle_there_is_no_distance(run, reported):
    manifest = json.loads((run / "manifest.json").read_text())
    manifest["asked"]["oracle"] = manifest["oracle"] = manifest["oracle_from"] = None
    (run / "manifest.json").write_text(json.dumps(manifest))
    text, data = reported(run)
    check_figures(Page(text), data)
    assert data["search"]["iterations"] == [] and data["program"]["distance"] is None
    assert data["head"]["oracle"] == "none: the search went by simulated return alone"


def test_one_episode_has_no_interval(run, reported):
    manifest = json.loads((run / "manifest.json").read_text())
    found = manifest["evaluation"]["returns"]
    found["program"] |= {"episodes": 1, "low": float("-inf"), "high": float("inf")}
    found["oracle"] |= {"episodes": 1, "low": 3.0, "high": 3.0, "mean": 3.0}
    (run / "manifest.json").write_text(json.dumps(manifest))
    text, data = reported(run)
    check_figures(Page(text), data)
    subjects = {subject["name"]: subject for subject in data["returns"]["subjects"]}
    assert subjects["program"]["interval"] == "one episode, no interval"
    assert subjects["program"]["low"] is None
    assert subjects["oracle"]["interval"] == "exact: the environment is deterministic"


def refused(folder: Path) -> str:
    before = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else None
    with pytest.raises(PirlcError) as caught:
        write_report(folder)
    after = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else None
    assert before == after
    (diagnostic,) = caught.value.diagnostics
    return f"{diagnostic.code}: {diagnostic.message}"


def test_folders_that_hold_no_run(tmp_path):
    nowhere, empty, file = tmp_path / "nowhere", tmp_path / "empty", tmp_path / "file"
    empty.mkdir()
    file.write_text("hello")
    assert refused(nowhere).endswith("holds no run of `pirlc synth`: there is no such folder")
    assert refused(empty).endswith("holds no run of `pirlc synth`: it has no `manifest.json`")
    assert refused(file).endswith("holds no run of `pirlc synth`: it is a file")


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("manifest.json", "gibberish", "it is not JSON"),
        ("manifest.json", "[]", "it does not hold a JSON object"),
        ("manifest.json", "{}", "it lacks 'asked'"),
        ("manifest.json", '{"asked": 3, "state": "running"}', "it is not as pirlc writes it"),
        ("candidates.jsonl", "1\n", "not every line of it holds a JSON object"),
        ("candidates.jsonl", '{"stage": "tune"}\n', "it lacks 'mean_return'"),
        ("verification.json", "{", "it is not JSON"),
        ("verification.json", "{}", "it lacks 'program_sha256'"),
        ("verification.json", '{"program_sha256": "SHA"}', "it lacks 'properties'"),
        (
            "analysis.json",
            '{"program_sha256": "SHA", "leaves": [], "loops": [{}]}',
            "it lacks 'leaf'",
        ),
        ("traces.json", '{"program_sha256": "SHA"}', "it lacks 'steps'"),
        ("sketch.pirl", b"\xff\xfe", "it is not UTF-8 text"),
        ("verification.json", "[" * 100_000, "it is nested too deeply"),
    ],
)
def test_damaged_files(full, name, content, reason):
    digest = json.loads((full / "manifest.json").read_text())["program"]["sha256"]
    damaged = content if isinstance(content, bytes) else content.encode()
    (full / name).write_bytes(damaged.replace(b"SHA", digest.encode()))
    assert refused(full).startswith(f"E0741: the run's file `{name}` cannot be used: {reason}")


@pytest.mark.parametrize(
    ("name", "part", "lacks"),
    [
        ("verification.json", "bounds", "raw_lower"),
        ("verification.json", "remarks", "evidence"),
        ("analysis.json", "leaves", "text"),
        ("analysis.json", "loops", "checks"),
    ],
)
def test_findings_that_lack_something(full, name, part, lacks):
    found = json.loads((full / name).read_text())
    del found[part][0][lacks]
    (full / name).write_text(json.dumps(found))
    message = refused(full)
    assert message.startswith("E0741: ") and name in message and lacks in message


SAMPLES = [
    (
        NoRun("docs", "it has no `manifest.json`"),
        "error[E0740]: `docs` holds no run of `pirlc synth`: it has no `manifest.json`\n"
        "  = help: name the folder that was given to `pirlc synth` with `-o`",
    ),
    (
        DamagedFile("traces.json", "it lacks 'steps'"),
        "error[E0741]: the run's file `traces.json` cannot be used: it lacks 'steps'\n"
        "  = help: repeat the run's command, which makes the file again; or move the file away, "
        "and the page says that it is missing",
    ),
]


@pytest.mark.parametrize(("problem", "text"), SAMPLES, ids=lambda s: type(s).__name__)
def test_messages(problem, text):
    diagnostic = describe(problem)
    assert render(diagnostic) == text
    page = resources.explanations() / f"{diagnostic.code}.md"
    assert page.read_text().startswith(f"# {diagnostic.code}: ")
