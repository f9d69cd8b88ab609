"""What is known of a program beyond its return, into the run's folder: proofs, analysis, an episode
beside the oracle, and the page that shows it all.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pirlc.analyze.findings import Analysis
from pirlc.analyze.reading.program import read_program
from pirlc.backend.files import write_text
from pirlc.diagnostics import Diagnostic, PirlcError
from pirlc.ir.policy import Environment, Program
from pirlc.oracle.network import Oracle
from pirlc.report.data import as_data
from pirlc.report.manifest import sha256_of
from pirlc.report.page import write_report
from pirlc.report.reading_words import sections
from pirlc.report.run import ANALYSIS, READING, VERIFICATION
from pirlc.report.traces import trace_episode, write_traces
from pirlc.verify.findings import Verification
from pirlc.verify.properties.asking import DEFAULT_LIMITS, Limits
from pirlc.verify.verification import verify


@dataclass(frozen=True)
class Dossier:
    """`verdict` is what the page says at its head, but for the returns; `files` are in the run's
    folder; `seconds` is what it all took."""

    verification: Verification
    analysis: Analysis
    verdict: tuple[str, ...]
    files: tuple[Path, ...]
    seconds: float


STAGES = ("prove", "analyze", "trace", "report")


def write_dossier(
    folder: Path,
    program: Program,
    environment: Environment,
    oracle: Oracle | None,
    seed: int,
    tell: Callable[[str], None],
    *,
    limits: Limits = DEFAULT_LIMITS,
    trust: bool = False,
) -> Dossier:
    """Find out what there is to know of the program, and write it.

    `seed` is that of the episode to be traced; `tell` hears each of `STAGES` as it begins.
    """
    start = time.perf_counter()
    tell("prove")
    verification = verify(program, limits)
    files = [_write(folder / VERIFICATION, verification, program)]
    tell("analyze")
    analysis = analysis_in(program, environment, trust=trust)
    files.append(_write(folder / ANALYSIS, analysis, program))
    reading = read_program(program, analysis)
    said = {"sections": sections(reading), "found": reading}
    files.append(_write(folder / READING, said, program))
    tell("trace")
    traces = trace_episode(program, environment, oracle, seed, trust=trust)
    files.append(write_traces(traces, folder))
    tell("report")
    page, data = write_report(folder)
    lines = json.loads(data.read_text(encoding="utf-8"))["head"]["verdict"]
    verdict = tuple(line["text"] for line in lines if line["about"] != "returns")
    seconds = time.perf_counter() - start
    return Dossier(verification, analysis, verdict, (*files, page, data), seconds)


def analysis_in(program: Program, environment: Environment, *, trust: bool = False) -> Analysis:
    """The analysis with the plant that can be had from the environment.

    Without one, or where two ways to one of its margins disagree (E0921), the program is analysed
    alone, and the notes say why.
    """
    from pirlc.analyze.analysis import analyze
    from pirlc.analyze.plants.find import find_plant

    try:
        plant = find_plant(program, environment, trust=trust)
        return analyze(program, plant, simulator=environment, trust=trust)
    except PirlcError as error:
        alone = analyze(program)
        return replace(alone, notes=(*alone.notes, *map(_in_words, error.diagnostics)))


def _in_words(diagnostic: Diagnostic) -> str:
    return "; ".join((diagnostic.message, *diagnostic.notes))


def _write(path: Path, finding: Any, program: Program) -> Path:
    """The finding, with the hash of the program that it is about."""
    data = {"program_sha256": sha256_of(program), **as_data(finding)}
    return write_text(path, json.dumps(data, indent=1, allow_nan=False) + "\n")
