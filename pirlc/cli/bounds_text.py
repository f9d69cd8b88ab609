"""What `pirlc verify` prints for people about bounds, remarks and guards."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import assert_never

from pirlc.ir.evidence import PROVED, Kind
from pirlc.source import NOWHERE, SourceText, Span
from pirlc.verify.findings import (
    ActionBounds,
    AsComputed,
    ChoiceBounds,
    Extreme,
    GuardRounding,
    Remark,
)


def bounds_texts(found: Sequence[ActionBounds | ChoiceBounds]) -> Iterator[str]:
    """A table: a line for each bound, as a decimal, and exactly."""
    rows: list[tuple[str, str, str, str]] = []
    for one in found:
        match one:
            case ActionBounds():
                rows.extend(_action_rows(one))
            case ChoiceBounds():
                rows.append(_choice_row(one))
            case _:
                assert_never(one)
    widths = [max(len(row[i]) for row in rows) for i in range(3)]
    yield "bounds"
    for name, decimal, attained, exactly in rows:
        line = f"  {name:{widths[0]}}  {decimal:>{widths[1]}}  {attained:{widths[2]}}  {exactly}"
        yield line.rstrip()


def _action_rows(found: ActionBounds) -> Iterator[tuple[str, str, str, str]]:
    name = found.action
    for words, extreme in (
        (f"raw({name}) least", found.raw_lower),
        (f"raw({name}) most", found.raw_upper),
        (f"raw({name}) change in a step", found.raw_change),
        (f"{name} least", found.applied_lower),
        (f"{name} most", found.applied_upper),
        (f"{name} change in a step", found.applied_change),
    ):
        yield (words, *_extreme(extreme))
    for precision, computed, off in (
        ("binary64", found.binary64, found.rounding64),
        ("binary32", found.binary32, found.rounding32),
    ):
        yield f"raw({name}) in {precision}", "", "", _computed(computed, off)


def _computed(found: AsComputed | None, off: float | None) -> str:
    words = []
    if found is not None and not (found.raw_lower is None and found.raw_upper is None):
        words.append(f"{_end(found.raw_lower)} to {_end(found.raw_upper)}")
        if found.raw_change is not None:
            words.append(f"changing by at most {found.raw_change!r}")
    if off:
        words.append(f"off by at most {off:.2g} beside guards that it turns")
    elif off is not None:
        words.append("exact beside guards")
    return ", ".join(words) or "no bound: its ranges meet an overflow or an undefined operation"


def _end(x: float | None) -> str:
    return "no bound" if x is None else repr(x)


def _extreme(found: Extreme) -> tuple[str, str, str]:
    if found.value is None:
        return str(found.evidence.kind.value), "", found.evidence.reason
    attained = "attained" if found.attained else "not attained"
    decimal = f"{float(found.value):.12g}"
    if found.evidence != PROVED:
        return decimal, found.evidence.reason, ""
    return decimal, attained, f"= {found.value}" if str(found.value) != decimal else ""


def _choice_row(found: ChoiceBounds) -> tuple[str, str, str, str]:
    values = ", ".join(map(str, found.values)) or "none"
    never = ", ".join(map(str, found.unreachable))
    words = f"never {never}" if never else ""
    if found.evidence.kind is not Kind.PROVED:
        words += f" {found.evidence}"
    return found.action, values, words.strip(), ""


def remark_texts(source: SourceText, found: Sequence[Remark]) -> Iterator[str]:
    """A line each: first what is worth a look, then what was proved not to happen."""
    for title, group in (
        ("remarks", [remark for remark in found if not remark.clear]),
        ("cannot happen", [remark for remark in found if remark.clear]),
    ):
        if not group:
            continue
        yield title
        places = [_place(source, remark.span) for remark in group]
        width = max(map(len, places))
        for place, remark in zip(places, group, strict=True):
            yield f"  {place:{width}}  {remark.text} ({remark.evidence})"


def guard_texts(source: SourceText, found: Sequence[GuardRounding]) -> Iterator[str]:
    """A line for each guard: how near its sides must be for rounding to turn it."""
    if not found:
        return
    yield "guards that rounding turns only where their sides are closer than"
    rows = [
        (_place(source, guard.span), _margin(guard.margin64), _margin(guard.margin32), guard.text)
        for guard in found
    ]
    head = ("", "binary64", "binary32", "")
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(3)]
    for place, double, single, text in (head, *rows):
        line = f"  {place:{widths[0]}}  {double:>{widths[1]}}  {single:>{widths[2]}}  {text}"
        yield line.rstrip()


def _margin(margin: float | None) -> str:
    if margin is None:
        return "no bound"
    return f"{margin:.2g}" if margin else "never"


def _place(source: SourceText, span: Span) -> str:
    if span == NOWHERE:
        return ""
    line, column = source.position(span.start)
    return f"{line}:{column}"


def placed(source: SourceText, span: Span) -> dict[str, int]:
    """Line and column for JSON, where there are any."""
    if span == NOWHERE:
        return {}
    line, column = source.position(span.start)
    return {"line": line, "column": column}
