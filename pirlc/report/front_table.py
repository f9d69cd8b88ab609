"""The front of a run as a table: for the terminal, and for the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pirlc.report.words import number

Row = Mapping[str, Any]


def table(rows: Sequence[Row], marks: Mapping[int, str] | None = None) -> list[str]:
    """The front's rows as lines of text, with a heading; `marks` stand behind rows by number."""
    cells = [
        ("", "nodes", "return", "95 % interval", "less than the best by"),
        *(
            (
                str(row["number"]),
                str(row["size"]),
                number(row["return"]["mean"]),
                span(row["return"]),
                less(row),
            )
            for row in rows
        ),
    ]
    widths = [max(len(line[i]) for line in cells) for i in range(5)]
    lines = []
    for place, line in enumerate(cells):
        right = [text.rjust(width) for text, width in zip(line[:3], widths, strict=False)]
        left = [text.ljust(width) for text, width in zip(line[3:], widths[3:], strict=True)]
        mark = (marks or {}).get(place, "") if place else ""
        lines.append("  ".join([*right, *left, mark]).rstrip())
    return lines


def front_page(front: Mapping[str, Any]) -> dict[str, Any]:
    """The front as the page shows it, from `front.json`."""
    members = [
        {
            "number": row["number"],
            "size": row["size"],
            "mean": row["return"]["mean"],
            "low": row["return"]["low"],
            "high": row["return"]["high"],
            "interval": span(row["return"]),
            "loss": less(row),
            "mark": _mark(front, row["number"]),
        }
        for row in front["members"]
    ]
    outside = front["outside"]
    return {
        "episodes": front["episodes"],
        "members": members,
        "outside": outside and {"size": outside["size"], "mean": outside["return"]["mean"]},
    }


def _mark(front: Mapping[str, Any], number: int) -> str:
    if number == front["picked"]:
        return "picked"
    return "the search's own" if number == front["chosen"] else ""


def span(found: Mapping[str, Any]) -> str:
    """An interval, or why there is none."""
    if found["low"] is None:
        return "-"
    exact = found["low"] == found["high"] and found["episodes"] == 1
    return "exact" if exact else f"[{number(found['low'])}, {number(found['high'])}]"


def less(row: Row) -> str:
    """What a member loses against the best, with the interval of the paired difference."""
    if row["number"] == 1:
        return "-"
    loss = row["loss"]
    half = None if loss["low"] is None else loss["mean"] - loss["low"]
    return number(loss["mean"]) if not half else f"{number(loss['mean'])} +- {number(half)}"
