"""cppcheck and its MISRA C:2012 add-on."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from benchmarks.assure import tools
from benchmarks.assure.deviations import Report, allowed
from benchmarks.assure.outcome import Outcome
from benchmarks.assure.subjects import Subject

DEFINED = {
    "__GNUC__": 12,
    "__STRICT_ANSI__": 1,
    "FLT_EVAL_METHOD": 0,
    "FLT_RADIX": 2,
    "DBL_MANT_DIG": 53,
    "DBL_MAX_EXP": 1024,
    "FLT_MANT_DIG": 24,
    "FLT_MAX_EXP": 128,
}
"""What a compiler says of itself, and <float.h>, which cppcheck does not read."""

_TEMPLATE = "{file}\\t{line}\\t{column}\\t{severity}\\t{id}\\t{message}"
_PREFIX = "misra-c2012-"


def check(subject: Subject, work: Path) -> Outcome:
    command: list[str | Path] = [
        tools.CPPCHECK.command,
        "--quiet",
        "--std=c99",
        "--platform=unix64",
    ]
    command += ["--enable=warning,style,performance,portability", "--inconclusive"]
    command += ["--addon=misra", f"--template={_TEMPLATE}", "--error-exitcode=0"]
    command += [f"-D{name}={value}" for name, value in DEFINED.items()]
    answer = tools.run([*command, subject.source], work)
    findings, accepted = [], Counter[str]()
    if answer.returncode:
        findings.append(f"cppcheck ended with {answer.returncode}: {answer.stdout[-500:]}")
    for line in answer.stderr.splitlines():
        parts = line.split("\t")
        if len(parts) != 6:
            if line.strip() and not line.startswith("^"):
                findings.append(line)
            continue
        path, row, column, severity, rule, message = parts
        text, statement = _place(Path(path), int(row))
        tool = "cppcheck MISRA" if rule.startswith(_PREFIX) else "cppcheck"
        rule = rule.removeprefix(_PREFIX)
        report = Report(rule, text, int(column), statement)
        if allowed(tool, report, subject.is_example):
            accepted[f"{tool} {rule}"] += 1
        else:
            said = "" if tool == "cppcheck MISRA" else f" {severity}: {message}"
            findings.append(
                f"{Path(path).name}:{row}:{column}: {tool} {rule}{said}\n    {text.strip()}"
            )
    return Outcome(tuple(findings), accepted)


def _place(path: Path, row: int) -> tuple[str, str]:
    """The line, and the text from it to the next semicolon."""
    if not path.is_file() or row < 1:
        return "", ""
    lines = path.read_text(encoding="utf-8").splitlines()[row - 1 :]
    return lines[0], "\n".join(lines).partition(";")[0] + ";"
