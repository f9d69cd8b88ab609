"""The pages made of records: tables in Markdown, plots, and the same tables in docs/study.md."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from benchmarks.study import peers_tables, tables, torcs_tables
from benchmarks.study.plots import plots
from benchmarks.study.races import FINAL, IMITATED
from benchmarks.study.records import RESULTS, ROOT, Record, read
from benchmarks.study.rows import CLASSIC, TORCS
from benchmarks.torcs import paper as torcs_paper
from pirlc.backend.files import write_text

PEERS = "peers"
DOCUMENT = ROOT / "docs" / "study.md"

Section = tuple[str, str]
"""A title and a body; those that say nothing are left out."""


def classic_page(records: Sequence[Record]) -> str:
    return page(
        [
            ("Table openai, before refinement", tables.openai(records)),
            ("Bars", tables.bars(records)),
            ("The paper's ordering", tables.ordering(records)),
            ("Ablations, before refinement", tables.ablations(records, refined=False)),
            ("Ablations, refined on return", tables.ablations(records, refined=True)),
            ("`pirlc synth` with its defaults", tables.defaults(records)),
            ("The optimiser that `pirlc synth` chose", tables.choices(records)),
            ("Cost", tables.costs(records)),
            ("Does imitation predict return?", tables.imitation(records)),
            ("Timeouts", tables.timeouts(records)),
            ("Every run", tables.each(records)),
        ]
        if records
        else []
    )


def torcs_page(records: Sequence[Record]) -> str:
    sections: list[Section] = []
    for track in torcs_paper.TRAINING if records else ():
        title = torcs_paper.TITLES[track]
        sections.append((title, torcs_tables.performance(records, track)))
        for which, words in ((FINAL, "refined"), (IMITATED, "Algorithm 1 alone")):
            told = torcs_tables.ahead(records, track, which)
            sections.append((f"{title}: is NDPS ahead? ({words})", told))
    return page(sections)


def peers_page(classic: Sequence[Record], peers: Sequence[Record]) -> str:
    if not peers:
        return page([])
    sections = [
        (where, peers_tables.environment_table(classic, peers, where))
        for where in tables.ENVIRONMENTS
        if any(record.environment == where for record in peers)
    ]
    return page(
        [
            *sections,
            ("Against VIPER: pirlc's return is", peers_tables.verdict(classic, peers)),
            (
                "Each program against VIPER's best tree of at least as many nodes",
                peers_tables.against_viper(classic, peers, peers_tables.at_least),
            ),
            (
                "Each program against VIPER's best tree of at most as many nodes",
                peers_tables.against_viper(classic, peers, peers_tables.at_most),
            ),
        ]
    )


def page(sections: Sequence[Section]) -> str:
    filled = [(title, body) for title, body in sections if _says_something(body)]
    text = "\n".join(f"### {title}\n\n{body}" for title, body in filled)
    return text or "There are no records yet.\n"


def _says_something(body: str) -> bool:
    """Whether there is more than a table's head."""
    return len(body.splitlines()) > (2 if body.startswith("|") else 0)


def write_pages(results: Path) -> list[Path]:
    """Makes all pages anew from the records in a folder; returns the files written."""
    classic, torcs = read(results, CLASSIC).records, read(results, TORCS).records
    peers = read(results, PEERS).records
    texts = {
        CLASSIC: classic_page(classic),
        TORCS: torcs_page(torcs),
        PEERS: peers_page(classic, peers),
    }
    made = [write_text(results / f"{name}.md", text) for name, text in texts.items()]
    made += plots(classic, peers, results)
    if results.resolve() == RESULTS and DOCUMENT.is_file():
        made.append(write_text(DOCUMENT, with_tables(DOCUMENT.read_text("utf-8"), texts)))
    return made


def with_tables(document: str, texts: dict[str, str]) -> str:
    """A document whose parts between `<!-- NAME -->` and `<!-- end of NAME -->` are these texts.
    What stands outside of them is left as it is."""
    for name, text in texts.items():
        marks = f"<!-- {name} -->", f"<!-- end of {name} -->"
        between = re.compile(f"{re.escape(marks[0])}.*?{re.escape(marks[1])}", re.DOTALL)
        put = f"{marks[0]}\n\n{text}\n{marks[1]}"
        document = between.sub(lambda _, put=put: put, document)
    return document
