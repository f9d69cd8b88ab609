"""The tables of docs/mutation.md, from the results and the list of equivalent mutants."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.mutation.mutants import Key

PLACE = Path(__file__).resolve().parents[2] / "docs" / "mutation.md"


def rates(results: Mapping[str, Any]) -> str:
    """A row for each part and one for all."""
    head = (
        "| part | emit nothing that compiles | equivalent | tried | survived | caught "
        "| caught with golden files |\n|---|---|---|---|---|---|---|\n"
    )
    return head + "".join(
        f"| {part} | {s['refused']} | {s['equivalent']} | {s['tried']} | {s['survived']} "
        f"| {s['caught']:.1%} | {s['caught_with_golden']:.1%} |\n"
        for part, s in results["summary"].items()
    )


def equivalent(listed: Mapping[Key, str]) -> str:
    """A row for each mutant that is listed as equivalent."""
    rows = []
    for (file, within, was, becomes, _), because in sorted(listed.items()):
        change = f"{_code(was)} becomes {_code(becomes)}" if becomes else f"{_code(was)} is lost"
        rows.append(f"| {Path(file).name}, {within or 'top'} | {change} | {because} |\n")
    return "| where | fault | why nothing can tell |\n|---|---|---|\n" + "".join(rows)


def _code(lines: str) -> str:
    text = " ".join(lines.split()).replace("|", "\\|")
    return f"`` {text} ``"


def survivors(results: Mapping[str, Any]) -> str:
    """A row for each mutant that no ordinary test tells from the original."""
    rows = [
        f"| {Path(row['file']).name}, {row['within'] or 'top'} | {_code(row['was'])} becomes "
        f"{_code(row['becomes'])} | {'yes' if row.get('golden') else 'no'} |\n"
        for row in results["mutants"]
        if row["verdict"] == "survived"
    ]
    head = "| where | fault | told by golden files |\n|---|---|---|\n"
    return head + "".join(rows) if rows else "None.\n"


def filled(text: str, tables: Mapping[str, str]) -> str:
    """The page with each table between its marks."""
    for name, table in tables.items():
        pattern = rf"(<!-- table: {name} -->\n).*?(<!-- end -->)"
        text, count = re.subn(pattern, lambda m, t=table: m[1] + t + m[2], text, flags=re.DOTALL)
        assert count == 1, name
    return text


def tables(results: Mapping[str, Any], listed: Mapping[Key, str]) -> dict[str, str]:
    return {
        "rates": rates(results),
        "survivors": survivors(results),
        "equivalent": equivalent(listed),
    }
