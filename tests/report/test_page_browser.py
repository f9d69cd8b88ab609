"""The page in a real browser: it renders, it prints, and it fetches and runs nothing."""

from __future__ import annotations

import json
import re

import pytest

from pirlc.report.page import write_report
from tests.support.browser import Browser, browser
from tests.support.pages import SECTIONS, agrees, figures_in, hostile, resolved


@pytest.fixture(scope="module")
def chromium(tmp_path_factory) -> Browser:
    with browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened


_SHOWN = """
return [...document.querySelectorAll("[data-json]")].map(element => [
    element.dataset.json, element.tagName.toLowerCase(), element.getAttribute("value"),
    element.textContent, element.getBoundingClientRect().width]);
"""

_STRAY = """
const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
const found = [];
while (walker.nextNode())
    if (!walker.currentNode.parentElement.closest("[data-json], [data-json-key]"))
        found.push(walker.currentNode.textContent);
return found;
"""

_SECTIONS = """
return [...document.querySelectorAll("section")].map(section => [
    section.id, section.getBoundingClientRect().height, section.scrollWidth <= section.clientWidth
]);
"""


def test_it_renders_and_every_figure_on_it_is_in_the_json(shown, chromium):
    page, data = shown.page, shown.data
    console, asked = chromium.open(page)
    assert console == []
    assert asked == [page.as_uri()] or set(asked) == {page.as_uri(), "data:,"}
    assert chromium.driver.title == "pole: what pirlc found"
    sections = chromium.run(_SECTIONS)
    assert [name for name, _, _ in sections] == SECTIONS
    assert all(height > 80 and fits for _, height, fits in sections)
    elements = chromium.run(_SHOWN)
    assert len(elements) > 150
    for pointer, tag, value, text, width in elements:
        found = resolved(data, pointer)
        if tag == "data":
            assert json.loads(value) == found and agrees(text, found)
        elif tag == "figure":
            assert found and width > 300
        elif isinstance(found, str) and found not in ("inf", "-inf"):
            assert text.replace("`", "") == found.replace("`", "")
    assert not [text for text in chromium.run(_STRAY) if figures_in(text)]


def test_plots_are_drawn_and_have_titles(shown, chromium):
    chromium.open(shown.page)
    plots = chromium.run(
        """return [...document.querySelectorAll("figure > svg")].map(svg => [
            document.getElementById(svg.getAttribute("aria-labelledby")).textContent,
            svg.getBoundingClientRect().height, svg.querySelectorAll("path").length,
            svg.querySelectorAll("text").length])"""
    )
    assert len(plots) >= 6
    for title, height, paths, texts in plots:
        assert len(title) > 10 and height > 60 and paths > 4 and texts > 3


def test_it_prints_whole(shown, chromium):
    chromium.open(shown.page)
    headings = chromium.run(
        'return [...document.querySelectorAll("h1, h2, h3")].map(h => h.textContent)'
    )
    printed = chromium.printed()
    outline = re.findall(rb"/Title (?:\(([^)]*)\)|<([0-9A-F]*)>)", printed)
    titles = [
        bytes.fromhex(coded.decode()).decode("utf-16") if coded else plain.decode()
        for plain, coded in outline
    ]
    assert set(headings) <= set(titles)
    assert printed.count(b"/Type /Page\n") > 3
    assert re.search(rb"/MediaBox \[0 0 59[45][.\d]* 84[12][.\d]*\]", printed)


def test_texts_of_the_run_cannot_run(full, chromium):
    for name in ("verification.json", "analysis.json", "traces.json"):
        (full / name).write_text(json.dumps(hostile(json.loads((full / name).read_text()))))
    page, _ = write_report(full)
    console, asked = chromium.open(page)
    assert console == []
    assert set(asked) <= {page.as_uri(), "data:,"}
    assert chromium.run('return document.querySelectorAll("script, img, [onerror]").length') == 0
    assert chromium.run('return document.querySelectorAll("section").length') == len(SECTIONS)
