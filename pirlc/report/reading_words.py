"""A reading of a program as titles, sentences and small tables: for the terminal and the page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from pirlc.analyze.reading.findings import (
    ActionReading,
    Branch,
    Gain,
    Kind,
    Law,
    Limit,
    ProgramReading,
    SensorUse,
    Settling,
)
from pirlc.analyze.reading.wording import number
from pirlc.report.words import counted


@dataclass(frozen=True)
class Table:
    """The cells of a row are as many as the headings; `right`: columns whose numbers align."""

    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    right: tuple[int, ...] = ()


@dataclass(frozen=True)
class Section:
    """`parts` in order; `level` 1 is a part of the program, 2 a branch of an action."""

    title: str
    parts: tuple[str | Table, ...]
    level: int = 1


def sections(reading: ProgramReading) -> tuple[Section, ...]:
    """All that is said of a program, in reading order."""
    found = [_head(reading), _sensors(reading)]
    for action in reading.actions:
        found += _action(action, reading)
    if reading.notes:
        found.append(Section("notes", reading.notes))
    return tuple(found)


def _head(reading: ProgramReading) -> Section:
    steps = "times in steps" if reading.sample_time is None else f"{reading.sample_time:g} s a step"
    late = (
        "no latency"
        if not reading.latency
        else f"readings are {counted(reading.latency, 'step')} old"
    )
    where = f", for {reading.environment}" if reading.environment else ""
    lines = [f"{counted(reading.size, 'node')}{where}", f"{steps}, {late}"]
    if reading.window > 1:
        used = f"it uses the last {reading.needed}" if reading.needed > 1 else "it uses the newest"
        span = _seconds(reading.needed, reading.sample_time) if reading.needed > 1 else ""
        lines.append(f"of each sensor's window of {reading.window} readings {used}{span}")
    if reading.plant:
        lines.append(f"how it settles is told for the plant {reading.plant}, linearised")
    if reading.simulated is not None:
        shares = reading.simulated
        lines.append(
            f"shares of branches are of {shares.steps:,} simulated steps "
            f"({counted(shares.episodes, 'episode')} from seed {shares.first_seed})"
        )
    return Section(reading.program, tuple(lines))


def _seconds(steps: int, sample_time: float | None) -> str:
    return "" if sample_time is None else f" ({steps * sample_time:g} s)"


# Sensors


def _sensors(reading: ProgramReading) -> Section:
    rows = tuple(_sensor(sensor) for sensor in reading.sensors)
    headings = ("sensor", "range", "readings used", "decides in", "part of", "missing")
    idle = [sensor.name for sensor in reading.sensors if not sensor.readings]
    lines: list[str | Table] = [Table(headings, rows)]
    if idle:
        is_ = "is" if len(idle) == 1 else "are"
        lines.append(f"{', '.join(idle)} {is_} not used")
    lines.append(f"warm-up: {reading.warm_up}")
    return Section("sensors", tuple(lines))


def _sensor(sensor: SensorUse) -> tuple[str, ...]:
    ages = sensor.readings
    if not ages:
        used = "none"
    elif ages == (0,):
        used = "the newest"
    elif ages == tuple(range(len(ages))):
        used = f"the last {len(ages)}"
    else:
        used = ", ".join("newest" if not age else f"k-{age}" for age in ages)
    return (
        sensor.name, f"[{number(sensor.lower)}, {number(sensor.upper)}]", used,
        ", ".join(sensor.guards) or "-", ", ".join(sensor.laws) or "-", sensor.missing,
    )  # fmt: skip


# Actions


def _action(action: ActionReading, reading: ProgramReading) -> Iterator[Section]:
    kind = "one of" if action.discrete else "in"
    reached = [branch for branch in action.branches if not branch.never]
    constants = all(branch.law.kind is Kind.CONSTANT for branch in action.branches)
    table = action.discrete and constants
    count = counted(len(action.branches), "branch", "branches")
    title = f"{action.name} {kind} {action.domain}" + ("" if table else f": {count}")
    parts: list[str | Table] = []
    if table:
        parts += _decisions(action)
    parts += action.previous
    parts += action.notes
    if action.switches is not None and len(reached) > 1:
        unit = "step" if reading.sample_time is None else "second"
        parts.append(f"changes its branch {action.switches:.3g} times a {unit}")
    if not action.discrete and any(branch.law.clipped for branch in reached):
        parts.append("what comes out beyond its range is clipped to it")
    yield Section(title, tuple(parts))
    if not table:
        for branch in action.branches:
            yield _branch(branch, action, reading)


def _decisions(action: ActionReading) -> Iterator[str | Table]:
    taken = {branch.number: branch.taken for branch in action.branches}
    measured = any(share is not None for share in taken.values())
    named = any(choice.meaning for choice in action.choices)
    more = (("that is",) if named else ()) + (("of the steps",) if measured else ())
    headings = ("value", *more, "when")
    rows = []
    # What is otherwise comes last, as in the text.
    ordered = sorted(action.choices, key=lambda choice: choice.when == "otherwise")
    for choice in ordered:
        share = sum(taken[k] or 0.0 for k in choice.branches)
        cells = ((choice.meaning,) if named else ()) + ((_percent(share),) if measured else ())
        rows.append((str(choice.value), *cells, choice.when))
    yield Table(headings, tuple(rows), (0, 1 + named) if measured else (0,))
    shown = [b for choice in ordered[:1] for b in action.branches if b.number in choice.branches]
    solved = tuple(dict.fromkeys(pair for branch in shown for pair in branch.boundaries))
    if solved:
        yield Table(("boundary", "that is"), solved)
    for branch in action.branches:
        if branch.never:
            yield f"branch {branch.number} is never taken: {branch.never}"


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} %"


def _branch(branch: Branch, action: ActionReading, reading: ProgramReading) -> Section:
    if branch.never:
        when = "never taken"
    elif not branch.when:
        when = "always"
    else:
        when = "if " + " and ".join(
            f"({text})" if " or " in text and len(branch.when) > 1 else text for text in branch.when
        )
    share = "" if branch.taken is None else f" ({_percent(branch.taken)} of the steps)"
    title = f"{action.name} {branch.number}, {when}{share}"
    parts: list[str | Table] = [branch.never] if branch.never else []
    if branch.boundaries:
        parts.append(Table(("boundary", "that is"), branch.boundaries))
    parts += _law(branch.law)
    if branch.settling is not None:
        parts += _settling(branch.settling, branch.law, reading.sample_time)
    return Section(title, tuple(parts), level=2)


# Laws


def _law(law: Law) -> Iterator[str | Table]:
    if law.kind is Kind.CONSTANT:
        yield f"the constant {law.text}"
        return
    about_error = bool(law.setpoint_text) and len(law.gains) == 1
    if about_error:
        yield from _pid(law, law.gains[0])
    else:
        yield law.text
        if len(law.gains) > 0:
            yield _feedback(law)
    yield from law.notes
    low, high = (number(end) for end in law.range)
    if math.isfinite(law.range[0]) and math.isfinite(law.range[1]):
        clipped = "" if law.clipped else ": it is never clipped"
        yield f"while readings are in range it is in [{low}, {high}]{clipped}"
    elif law.rest:
        yield "no bound is seen on it by itself: clipping bounds it"


def _pid(law: Law, gain: Gain) -> Iterator[str | Table]:
    error = f"e = {_operand(law.setpoint_text)} - {gain.sensor}"
    forms = [n for n, v in (("P", gain.kp), ("I", gain.ki), ("D", gain.kd)) if v]
    moving = "" if law.setpoint is not None else ", a setpoint that moves"
    yield f"{''.join(forms)} on {gain.sensor}: {error}{moving}"
    limits = {limit.what: limit for limit in law.limits}
    rows = []
    for name, value, acts, key in (
        ("P", gain.kp, "e", "error"),
        ("I", gain.ki, f"the sum of the last {gain.window} e", f"mean of {gain.window} errors"),
        ("D", gain.kd, "the change of e in a step", "change of the error in one step"),
    ):
        if value:
            rows.append((name, number(value), acts, _limit(limits.get(key), name)))
    yield Table(("", "gain", "acts on", "alone at the limits from"), tuple(rows), (1,))
    if law.at_rest:
        yield f"at rest: {law.at_rest}"
    if (gain.kp or 0.0) < 0.0 and gain.at_rest < 0.0:
        yield "its gains are negative: it answers a reading above the setpoint with more"


def _operand(text: str) -> str:
    return f"({text})" if " " in text and not text.endswith(")") else text


def _limit(limit: Limit | None, part: str) -> str:
    if limit is None:
        return "-"
    name = {"P": "e", "I": "a mean e", "D": "a change"}[part]
    ends = [end for end in (limit.lower, limit.upper) if end is not None]
    if len(ends) == 2 and ends[0] == -ends[1]:
        at = f"{name} of +-{_short(abs(ends[0]))}"
    else:
        at = f"{name} of {' and '.join(_short(end) for end in ends)}"
    return at if limit.reachable else f"{at}: out of range"


def _short(value: float) -> str:
    return f"{value:.4g}"


def _feedback(law: Law) -> Table:
    """Weights of the readings, or of their window's sum and change."""
    windows = any(len(gain.weights) > 1 for gain in law.gains)
    limits = {limit.what: limit for limit in law.limits}
    headings = ("sensor", "gain", *(("sum", "change", "at rest") if windows else ()),
                "alone at the limits from")  # fmt: skip
    rows = []
    for gain in law.gains:
        plain = gain.kp is None
        shown = "see above" if plain else number(-(gain.kp or 0.0))
        more: tuple[str, ...] = ()
        if windows:
            more = (
                "-" if not gain.ki else f"{number(-gain.ki)} (of {gain.window})",
                "-" if not gain.kd else number(-gain.kd),
                number(-gain.at_rest),
            )
        rows.append((gain.sensor, shown, *more, _alone(limits.get(gain.sensor))))
    return Table(headings, tuple(rows), tuple(range(1, 5 if windows else 2)))


def _alone(limit: Limit | None) -> str:
    if limit is None:
        return "-"
    ends = [end for end in (limit.lower, limit.upper) if end is not None]
    at = (
        f"+-{_short(abs(ends[0]))}"
        if len(ends) == 2 and ends[0] == -ends[1]
        else " and ".join(map(_short, ends))
    )
    return at if limit.reachable else f"{at}: out of range"


# Settling


def _settling(found: Settling, law: Law, sample_time: float | None) -> Iterator[str]:
    span = _seconds(found.memory, sample_time)
    if found.kept is None:
        reading = "the newest reading alone" if found.memory == 1 else (
            f"the last {found.memory} readings{span}, and nothing older"
        )  # fmt: skip
        yield f"by itself it answers to {reading}"
    if found.stable is None:
        why = f"how its loop settles: {found.why}" if found.why else ""
        if why and not law.rest:
            yield why
        return
    unit = "steps" if sample_time is None else "s"
    if not found.stable:
        yield (
            f"in the loop: UNSTABLE by itself (slowest pole of magnitude {found.slowest_pole:.4g})"
        )
        return
    words = [f"in the loop: stable, slowest pole of magnitude {found.slowest_pole:.4g}"]
    if found.settling_time is not None:
        words.append(f"settles to 2 % in {found.settling_time:.3g} {unit}")
    if found.overshoot is not None:
        words.append(f"overshoot {found.overshoot:.3g} %")
    if found.gain_margin is not None:
        words += [
            f"gain margin {_times(found.gain_margin)}",
            f"phase margin {_amount(found.phase_margin, 'degrees')}",
            f"delay margin {_amount(found.delay_margin, 'steps')}",
        ]
    yield ", ".join(words)


def _times(value: float) -> str:
    return f"x {value:.3g}" if math.isfinite(value) else "unlimited"


def _amount(value: float | None, unit: str) -> str:
    if value is None:
        return "not known"
    return f"{value:.3g} {unit}" if math.isfinite(value) else "unlimited"


# Text


def as_text(found: Sequence[Section], width: int = 98) -> str:
    """Sections for a terminal, in lines of at most `width` where tables allow it."""
    blocks = []
    for section in found:
        indent = "  " * section.level
        lines = list(_wrapped(section.title, "  " * (section.level - 1), width))
        for part in section.parts:
            if isinstance(part, Table):
                lines += _table_lines(part, indent, width)
            else:
                lines += _wrapped(part, indent, width)
        blocks.append("\n".join(lines))
    return "\n\n".join(blocks)


def _wrapped(text: str, indent: str, width: int) -> list[str]:
    import textwrap

    return textwrap.wrap(
        text, width, initial_indent=indent, subsequent_indent=indent + "  ",
        break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip


def _table_lines(table: Table, indent: str, width: int) -> Iterator[str]:
    """The last column is wrapped where a row is too long."""
    import textwrap

    rows = (table.headings, *table.rows)
    widths = [max(len(row[i]) for row in rows) for i in range(len(table.headings))]
    before = len(indent) + 2 + sum(widths[:-1]) + 2 * (len(widths) - 1)
    for row in rows:
        cells = [
            cell.rjust(size) if i in table.right else cell.ljust(size)
            for i, (cell, size) in enumerate(zip(row[:-1], widths, strict=False))
        ]
        room = max(24, width - before)
        last = textwrap.wrap(row[-1], room, break_long_words=False) or [""]
        yield (
            "  ".join([f"{indent}  " + cells[0], *cells[1:], last[0]]).rstrip()
            if cells
            else last[0]
        )
        for more in last[1:]:
            yield " " * (before + 2) + more
