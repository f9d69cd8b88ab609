"""Plots from an analysis's JSON."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from pirlc.analyze.analysis import analyze
from pirlc.report.analysis_plots import plots, write_plots
from pirlc.report.data import as_data
from tests.support.analysis import plant_of, program_of
from tests.support.pages import resolved


@pytest.fixture(scope="module")
def data():
    program = program_of(
        "policy p\nsensor X : [-1, 1] = 0\nwindow 3\nsample_time 0.1\n"
        "action U : [-1, 1] safe 0 = if peek(X, -1) > 0\n"
        "  then 0.5 * peek(0.25 - X, -1) + 0.125 * fold(+, 0.25 - X) else 9 * peek(X, -1)\n"
    )
    plant = plant_of([[0.9, 0.1], [0.0, 1.0]], [[0.0], [0.2]], [[1, 0]], ["U"], ["X"], 0.1)
    return json.loads(json.dumps(as_data(analyze(program, plant))))


def test_each_loop_has_its_plots(data):
    found = plots(data)
    # An unstable loop has no step response.
    assert [loop["stable"] for loop in data["loops"]] == [True, False]
    assert list(found) == [
        "U-1-bode", "U-1-nyquist", "U-1-step", "U-1-poles", "U-2-bode", "U-2-nyquist", "U-2-poles",
    ]  # fmt: skip
    assert found == plots(data)


def test_they_stand_inline_on_one_page(data):
    ids = []
    for pointer, text in plots(data).values():
        assert resolved(data, pointer)
        root = ET.fromstring(text)
        assert root.tag.endswith("svg")
        assert "<?xml" not in text and "metadata" not in text
        own = [element.get("id") for element in root.iter() if element.get("id")]
        assert len(own) == len(set(own))
        ids += own
        used = {value[5:-1] for e in root.iter() for value in e.attrib.values() if "url(#" in value}
        assert used <= set(own)
        links = {e.get("{http://www.w3.org/1999/xlink}href", "#")[1:] for e in root.iter()} - {""}
        assert links <= set(own)
    assert len(ids) == len(set(ids))


def test_png_files(data, tmp_path: Path):
    paths = write_plots(data, tmp_path / "plots")
    assert [path.stem for path in paths] == list(plots(data))
    before = [path.read_bytes() for path in paths]
    assert [path.read_bytes() for path in write_plots(data, tmp_path / "plots")] == before


def test_of_many_loops_those_in_force_are_drawn(data):
    assert {name.rpartition("-")[0] for name in plots(data, most_loops=1)} == {
        leaf["name"].replace(" ", "-") for leaf in data["leaves"] if leaf["active"]
    }
