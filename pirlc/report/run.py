"""A run's folder: what it is a run of, its journal, its candidates, its manifest.

::

    DIR/manifest.json       what was asked for, what it was made with, and, at the end, the results
    DIR/sketch.pirl         the sketch that is searched
    DIR/sketch.given.pirl   the sketch as it was read, where an ablation searches another
    DIR/journal.jsonl       every tuning and simulation of the search; what resuming reads
    DIR/candidates.jsonl    every program met: size, distance, return, parameters, choices
    DIR/<name>.pirl         the program
    DIR/front.json          the programs to choose from, with what each loses; DIR/front/<k>.pirl
    DIR/c/, DIR/python/     the controllers made from it
    DIR/search.png          return against size over the search
    DIR/traces.json         the program beside the oracle over one unseen episode
    DIR/verification.json   what was proved, refuted, tested
    DIR/analysis.json       control-theory figures
    DIR/reading.json        the program in words and small tables
    DIR/report.html         the page of the run; DIR/report.json has all that it shows
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pirlc.backend.files import write_text
from pirlc.report.problems import DamagedRun, ForeignFolder, OtherRun, error

MANIFEST = "manifest.json"
SKETCH, GIVEN = "sketch.pirl", "sketch.given.pirl"
TRACES, VERIFICATION, ANALYSIS = "traces.json", "verification.json", "analysis.json"
READING, FRONT = "reading.json", "front.json"
PAGE, PAGE_DATA = "report.html", "report.json"


@dataclass(frozen=True)
class Run:
    """A folder, and what is asked for in it (`asked`: plain data that survives JSON)."""

    folder: Path
    asked: Mapping[str, Any]

    @property
    def journal(self) -> Path:
        return self.folder / "journal.jsonl"

    @property
    def candidates(self) -> Path:
        return self.folder / "candidates.jsonl"

    def write_manifest(self, more: Mapping[str, Any]) -> Path:
        text = json.dumps({"asked": self.asked, **more}, indent=2) + "\n"
        return write_text(self.folder / MANIFEST, text)


def open_run(folder: Path, asked: Mapping[str, Any]) -> Run:
    """The folder for a run, made if need be, or taken up again if it is of the same run.

    Raises PirlcError E0711, E0712, E0722 to E0724; then nothing in the folder was changed.
    """
    run = Run(folder, asked)
    manifest = folder / MANIFEST
    if manifest.is_file():
        known = _asked(manifest)
        wanted = json.loads(json.dumps(dict(asked)))
        if known != wanted:
            names = sorted(k for k in known.keys() | wanted.keys() if known.get(k) != wanted.get(k))
            raise error(OtherRun(str(folder), tuple(names)))
        return run
    if folder.is_dir():
        found = next(iter(sorted(p.name for p in folder.iterdir())), None)
        if found is not None:
            raise error(ForeignFolder(str(folder), found))
    run.write_manifest({"state": "running"})
    return run


def _asked(manifest: Path) -> dict[str, Any]:
    folder = str(manifest.parent)
    try:
        asked = json.loads(manifest.read_text(encoding="utf-8"))["asked"]
    except (OSError, ValueError, KeyError, TypeError) as e:
        raise error(DamagedRun(folder, type(e).__name__)) from None
    if not isinstance(asked, dict):
        raise error(DamagedRun(folder, "no record of what was asked for"))
    return asked
