"""One command over the C of every example and of random programs; exit 1 on any finding."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.assure import (
    analyzers,
    compilers,
    functions,
    misra,
    neural,
    page,
    resources,
    sanitizers,
    targets,
    tools,
)
from benchmarks.assure.outcome import Outcome
from benchmarks.assure.subjects import (
    REPOSITORY,
    Subject,
    emitted,
    example_programs,
    random_programs,
)
from benchmarks.assure.tools import Tool

RESULTS = REPOSITORY / "benchmarks" / "results" / "assurance.json"
PAGE = REPOSITORY / "docs" / "assurance.md"
SHOWN = 20


@dataclass(frozen=True)
class Check:
    """One of every subject's C."""

    run: Callable[[Subject, Path], Outcome]
    tools: tuple[Tool, ...]


CHECKS = {
    "warnings": Check(compilers.check, compilers.TOOLS),
    "gcc-analyzer": Check(analyzers.gcc_analyzer, (tools.GCC,)),
    "clang-tidy": Check(analyzers.clang_tidy, (tools.CLANG_TIDY,)),
    "cppcheck": Check(misra.check, (tools.CPPCHECK,)),
    "sanitizers": Check(sanitizers.check, sanitizers.TOOLS),
    "targets": Check(targets.check, targets.TOOLS),
}
MEASUREMENTS: dict[str, tuple[Tool, ...]] = {
    "functions": functions.TOOLS,
    "resources": resources.TOOLS,
    "step-time": (tools.GCC,),
}


def main(arguments: Sequence[str] | None = None) -> int:
    options = _options(arguments)
    names = options.only or [*CHECKS, *MEASUREMENTS]
    needed = {name: CHECKS[name].tools if name in CHECKS else MEASUREMENTS[name] for name in names}
    missing = sorted({t for tools_ in needed.values() for t in tools_ if not t.installed}, key=str)
    if missing:
        packages = " ".join(dict.fromkeys(tool.package for tool in missing))
        what = ", ".join(tool.command for tool in missing)
        print(f"not installed: {what}\n  apt install {packages}", file=sys.stderr)
        if not options.skip_missing or os.environ.get("CI"):
            return 2
        names = [name for name in names if not any(tool in missing for tool in needed[name])]
    used = dict.fromkeys(tool for name in names for tool in needed[name])
    record: dict[str, Any] = {
        "versions": {tool.command: tools.version(tool) for tool in used},
        "programs": {},
        "checks": {},
    }
    say: Callable[[str], None] = (lambda _: None) if options.json else print
    start, used_before = time.perf_counter(), sum(os.times()[:4])
    with tempfile.TemporaryDirectory(prefix="pirlc-assure-") as place:
        work = Path(place)
        examples = emitted(example_programs(), work / "examples", is_example=True)
        others = emitted(random_programs(options.random), work / "random", is_example=False)
        record["programs"] = {"examples": len(examples) // 2, "random": len(others) // 2}
        programs = "{examples} examples and {random} random programs".format(**record["programs"])
        say(f"{programs}, each in double and in float")
        for name in names:
            begun = time.perf_counter()
            if name in CHECKS:
                entry = _check(CHECKS[name], [*examples, *others], work / name, options.jobs)
            else:
                entry = _measure(name, examples, work / name, options.jobs)
            entry["seconds"] = round(time.perf_counter() - begun, 1)
            record["checks"][name] = entry
            say(_line(name, entry))
    record["seconds"] = round(time.perf_counter() - start, 1)
    record["core_seconds"] = round(sum(os.times()[:4]) - used_before, 1)
    findings = sum(len(entry["findings"]) for entry in record["checks"].values())
    spent = f"{record['seconds']:.0f} s ({record['core_seconds']:.0f} s of processors)"
    say(f"{findings or 'no'} findings, {spent}")
    if options.json:
        print(json.dumps(record, indent=1))
    if options.write:
        if options.only:
            record = _merged(json.loads(RESULTS.read_text(encoding="utf-8")), record)
        RESULTS.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
        text = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(page.filled(text, record), encoding="utf-8")
    return 1 if findings else 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.assure")
    parser.add_argument(
        "--only", action="append", choices=[*CHECKS, *MEASUREMENTS], help="this one; repeatable"
    )
    parser.add_argument("--random", type=int, default=200, help="random programs (200)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="at a time")
    parser.add_argument("--json", action="store_true", help="print the results as JSON")
    parser.add_argument(
        "--write", action="store_true", help="write the tables of docs/assurance.md"
    )
    parser.add_argument(
        "--skip-missing", action="store_true", help="leave out what is not installed (not in CI)"
    )
    options = parser.parse_args(arguments)
    if options.write and options.only and not RESULTS.is_file():
        parser.error("--write with --only needs the record of a whole run")
    return options


def _merged(stored: dict[str, Any], record: dict[str, Any]) -> dict[str, Any]:
    """The stored record with the checks that were run again."""
    return {
        **stored,
        "versions": {**stored["versions"], **record["versions"]},
        "checks": {**stored["checks"], **record["checks"]},
    }


def _check(check: Check, subjects: Sequence[Subject], work: Path, jobs: int) -> dict[str, Any]:
    def one(subject: Subject) -> Outcome:
        place = work / subject.real / subject.label
        place.mkdir(parents=True)
        try:
            return check.run(subject, place)
        except tools.ToolFailed as failure:
            return Outcome((str(failure),))
        finally:
            shutil.rmtree(place)

    with ThreadPoolExecutor(jobs) as pool:
        outcomes = list(pool.map(one, subjects))
    accepted: dict[str, Counter[str]] = {"examples": Counter(), "random": Counter()}
    counts: dict[str, Counter[str]] = {"examples": Counter(), "random": Counter()}
    findings = []
    for subject, outcome in zip(subjects, outcomes, strict=True):
        kind = "examples" if subject.is_example else "random"
        accepted[kind].update(outcome.accepted)
        counts[kind].update(outcome.counts)
        findings += [f"{subject.name}: {finding}" for finding in outcome.findings]
    return {
        "controllers": len(subjects),
        "findings": findings,
        "accepted": {kind: dict(sorted(c.items())) for kind, c in accepted.items() if c},
        "counts": {kind: dict(c) for kind, c in counts.items() if c},
    }


def _measure(name: str, examples: Sequence[Subject], work: Path, jobs: int) -> dict[str, Any]:
    if name == "functions":
        distances, findings = functions.check(work)
        return {"findings": findings, "rows": [asdict(d) for d in distances]}
    measure: Callable[[Subject, Path], tuple[Any, list[str]]] = resources.measure
    if name == "step-time":
        # One after another: what runs beside it would be measured too.
        measure, jobs = neural.measure, 1
        examples = [subject for subject in examples if subject.real == "double"]

    def one(subject: Subject) -> tuple[Any, list[str]]:
        place = work / subject.real / subject.label
        place.mkdir(parents=True)
        try:
            return measure(subject, place)
        except tools.ToolFailed as failure:
            return None, [f"{subject.name}: {failure}"]

    with ThreadPoolExecutor(jobs) as pool:
        measured = list(pool.map(one, examples))
    return {
        "findings": [finding for _, found in measured for finding in found],
        "rows": [asdict(row) for row, _ in measured if row is not None],
    }


def _line(name: str, entry: dict[str, Any]) -> str:
    findings = entry["findings"]
    what = (
        f"{entry['controllers']} files" if "controllers" in entry else f"{len(entry['rows'])} rows"
    )
    result = f"{len(findings)} findings" if findings else "clean"
    steps = sum(count.get("steps", 0) for count in entry.get("counts", {}).values())
    more = f", {steps:,} steps" if steps else ""
    lines = [f"{name:<14}{what:<12}{result:<14}{entry['seconds']:>7.1f} s{more}"]
    lines += [f"  {finding}" for finding in findings[:SHOWN]]
    if len(findings) > SHOWN:
        lines.append(f"  ... and {len(findings) - SHOWN} more")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
