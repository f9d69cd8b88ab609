"""gcc's static analyser, and clang-tidy with clang's."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

from benchmarks.assure import tools
from benchmarks.assure.deviations import TIDY_OFF, Report, allowed
from benchmarks.assure.outcome import Outcome
from benchmarks.assure.subjects import Subject
from pirlc.backend.toolchain import FLAGS

GROUPS = (
    "bugprone-*",
    "cert-*",
    "clang-analyzer-*",
    "misc-*",
    "performance-*",
    "portability-*",
    "readability-*",
)
_REPORT = re.compile(r"^(.*?):(\d+):(\d+): (?:warning|error): (.*) \[([\w.,-]+)\]$")


def gcc_analyzer(subject: Subject, work: Path) -> Outcome:
    answer = tools.run(
        [tools.GCC.command, *FLAGS, "-fanalyzer", "-c", subject.source, "-o", work / "o"]
    )
    said = answer.stderr.strip()
    return Outcome((said or "no object file",) if answer.returncode or said else ())


def clang_tidy(subject: Subject, work: Path) -> Outcome:
    del work
    checks = ",".join(["-*", *GROUPS, *(f"-{name}" for name, _ in TIDY_OFF)])
    answer = tools.run(
        [
            *(tools.CLANG_TIDY.command, "--quiet", f"--checks={checks}", "--header-filter=.*"),
            *("--config={}", subject.source, "--", *FLAGS),
        ]
    )
    findings, accepted = [], Counter[str]()
    for line in answer.stdout.splitlines():
        if not (found := _REPORT.match(line)):
            continue
        path, row, column, message, rules = found.groups()
        text = Path(path).read_text(encoding="utf-8").splitlines()[int(row) - 1]
        rule = rules.split(",")[0]
        deviation = allowed("clang-tidy", Report(rule, text, int(column)), subject.is_example)
        if deviation is None:
            findings.append(f"{Path(path).name}:{row}: {message} [{rules}]\n    {text.strip()}")
        else:
            accepted[f"clang-tidy {rule}"] += 1
    if answer.returncode and not findings and not accepted:
        findings.append(answer.stderr.strip())
    return Outcome(tuple(findings), accepted)
