"""An analysis as text for the terminal."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Iterator
from fractions import Fraction

from pirlc.analyze.findings import (
    Analysis,
    Filter,
    Leaf,
    LoopFinding,
    Margins,
    Plant,
    Pole,
    RelayFinding,
    ResponseFinding,
    SwitchingFinding,
)

_WIDTH = 98
_MOST_SHOWN = 10
"""Poles, and values of an operating point."""


def in_words(found: Analysis) -> str:
    """All of it but the samples, in lines of at most 98 characters where words allow it."""
    blocks = [_head(found)]
    loops = {loop.leaf: loop for loop in found.loops}
    relays = {relay.action for relay in found.relays}
    blocks += [
        [*_leaf(leaf), *_loop(loops.get(leaf.name), found)]
        for leaf in found.leaves
        if leaf.action not in relays
    ]
    blocks += [list(_relay(relay, found)) for relay in found.relays]
    blocks += [list(_switching(switching)) for switching in found.switching]
    blocks += [list(_response(response)) for response in found.responses]
    blocks.append([line for note in found.notes for line in _wrapped(f"note: {note}", 6)])
    return "\n\n".join("\n".join(block) for block in blocks if block)


def _head(found: Analysis) -> list[str]:
    time = "times in steps" if found.sample_time is None else f"{found.sample_time:g} s a step"
    steps = "step" if found.latency == 1 else "steps"
    late = f"readings {found.latency} {steps} late" if found.latency else "no latency"
    lines = [f"{found.program}: {time}, {late}"]
    return lines if found.plant is None else [*lines, *_plant(found.plant)]


def _plant(plant: Plant) -> Iterator[str]:
    yield from _row("plant", f"{plant.name}: {plant.origin.value}, {len(plant.a)} states")
    yield from _row("from, to", f"{', '.join(plant.inputs)} -> {', '.join(plant.outputs)}")
    # Of many states only those are shown that are somewhere.
    few = len(plant.operating) <= _MOST_SHOWN
    at = [f"{k} {_number(v)}" for k, v in plant.operating.items() if v or few]
    if at:
        yield from _row("at", ", ".join(at))
    if plant.fit:
        fit = ", ".join(f"{name} {value:.1f} %" for name, value in plant.fit.items())
        yield from _row("fit", f"{fit} (on rollouts that it was not made from)")
    yield from _row("evidence", str(plant.evidence))
    for note in plant.notes:
        yield from _row("", note)


def _leaf(leaf: Leaf) -> Iterator[str]:
    yield from _wrapped(leaf.name + (f": if {' and '.join(leaf.path)}" if leaf.path else ""), 4)
    if not leaf.active:
        yield "  (not taken at the operating point)"
    if leaf.filters or leaf.recalls or leaf.linear:
        yield from _row("law", law(leaf.filters, leaf))
    yield from _row("evidence", str(leaf.evidence))
    for form in leaf.pids:
        setpoint = "" if form.setpoint is None else f", setpoint {_number(form.setpoint)}"
        yield from _row(
            f"PID on {form.sensor}",
            f"kp {_number(form.kp)}, ki {_number(form.ki)}, kd {_number(form.kd)}{setpoint}",
        )
        yield from _row("at rest", form.steady_state)
    for note in leaf.notes:
        yield from _row("note", note)


def law(filters: Iterable[Filter], leaf: Leaf | None = None, offset: Fraction | None = None) -> str:
    """The law as a sum: ``-24 Side(k) - 5 Speed(k) + 1``."""
    terms = [
        (weight, f"{filter_.sensor}({'k' if not age else f'k-{age}'})")
        for filter_ in filters
        for age, weight in enumerate(filter_.coefficients)
        if weight
    ]
    if leaf is not None:
        terms += [(recall.coefficient, f"{recall.action}(k-1)") for recall in leaf.recalls]
        offset = leaf.offset
    if offset or not terms:
        terms.append((offset or Fraction(0), ""))
    text = ""
    for weight, name in terms:
        sign = "-" if weight < 0 else "+"
        part = f"{_number(abs(weight))} {name}".strip()
        text += f" {sign} {part}" if text else f"{'-' if weight < 0 else ''}{part}"
    return text


def _loop(loop: LoopFinding | None, found: Analysis) -> Iterator[str]:
    if loop is None:
        return
    unit = "rad/step" if found.sample_time is None else "rad/s"
    yield from _row("loop", f"{'stable' if loop.stable else 'UNSTABLE'}: {loop.evidence}")
    if len(loop.others) > 0:
        ways = ", ".join(
            f"{action} {f'closed by {name}' if name != action else 'closed'}"
            if name
            else f"{action} held"
            for action, name in loop.others.items()
        )
        yield from _row("other actions", ways)
    yield from _row("poles", _poles(loop.poles))
    if loop.margins is not None:
        yield from _margins(loop.margins, unit)
        worst = max((check.difference for check in loop.checks), default=0.0)
        yield from _row(
            "checked", f"{len(loop.checks)} figures, each in two ways: they differ by {worst:.1g}"
        )
    if loop.step is not None:
        clock = "steps" if found.sample_time is None else "s"
        step = loop.step
        settled = (
            ""
            if step.settling_time is None
            else f", settled (2 %) at {step.settling_time:.4g} {clock}"
        )
        over = "" if step.overshoot is None else f", overshoot {step.overshoot:.3g} %"
        final = 0.0 if step.final is None else step.final
        yield from _row("step", f"of {step.what}: {step.sensor} goes to {final:.4g}{settled}{over}")
    for note in loop.notes:
        yield from _row("note", note)


def _margins(margins: Margins, unit: str) -> Iterator[str]:
    def at(frequency: float | None) -> str:
        return "" if frequency is None else f" at {frequency:.4g} {unit}"

    up = (
        "no upper one"
        if math.isinf(margins.gain_up)
        else (
            f"x {margins.gain_up:.4g} ({_decibel(margins.gain_up)}){at(margins.gain_up_frequency)}"
        )
    )
    down = (
        "no lower one"
        if margins.gain_down == 0.0
        else (
            f"x {margins.gain_down:.4g} ({_decibel(margins.gain_down)})"
            f"{at(margins.gain_down_frequency)}"
        )
    )
    yield from _row("gain margin", f"{up}; {down}")
    if math.isinf(margins.phase):
        yield from _row("phase margin", "none needed: the loop gain is nowhere 1")
    else:
        yield from _row("phase margin", f"{margins.phase:.4g} degrees{at(margins.phase_frequency)}")
    if math.isinf(margins.delay_samples):
        yield from _row("delay margin", "any delay")
    else:
        seconds = "" if margins.delay_seconds is None else f" ({margins.delay_seconds:.4g} s)"
        yield from _row("delay margin", f"{margins.delay_samples:.4g} steps{seconds}")
    low, high = margins.disk_gain
    yield from _row(
        "disk margin",
        f"{margins.disk:.4g}: gain x {low:.4g} to x {high:.4g}, phase {margins.disk_phase:.4g} "
        f"degrees{at(margins.disk_frequency)}",
    )
    yield from _row(
        "peaks",
        f"sensitivity {margins.sensitivity_peak:.4g}{at(margins.sensitivity_frequency)}, "
        f"complementary {margins.complementary_peak:.4g}{at(margins.complementary_frequency)}",
    )


def _relay(relay: RelayFinding, found: Analysis) -> Iterator[str]:
    unit = "rad/step" if found.sample_time is None else "rad/s"
    yield from _wrapped(
        f"{relay.action}: {_number(relay.high)} if {relay.text}, else {_number(relay.low)}", 4
    )
    if relay.filters:
        yield from _row("s", law(relay.filters, offset=relay.offset))
    yield from _row("evidence", str(relay.evidence))
    if relay.sliding_poles is not None:
        how = "stable" if relay.sliding_stable else "not asymptotically stable"
        yield from _row("on s = 0", f"{how}: poles {_poles(relay.sliding_poles)}")
    for cycle in relay.cycles:
        kind = "stable" if cycle.stable else "unstable"
        yield from _row(
            "limit cycle",
            f"{kind}, {cycle.frequency:.4g} {unit} (a period of {cycle.period:.4g} steps), s "
            f"swings by {cycle.amplitude:.4g}",
        )
    for note in relay.notes:
        yield from _row("note", note)


def _switching(switching: SwitchingFinding) -> Iterator[str]:
    yield f"switching between {', '.join(switching.modes)}"
    yield from _row("evidence", str(switching.evidence))
    if switching.decay is not None:
        yield from _row("decay", f"V falls below {float(switching.decay):.6g} of itself each step")
    for tried in switching.tried:
        yield from _row("tried", tried)
    for note in switching.notes:
        yield from _row("note", note)


def _response(response: ResponseFinding) -> Iterator[str]:
    yield from _wrapped(f"{response.leaf} in the simulator: {response.what or 'not shown'}", 4)
    for name, error in response.error.items():
        yield from _row(name, f"differs by at most {error:.2%} of the largest deviation predicted")
    yield from _row("evidence", str(response.evidence))
    for note in response.notes:
        yield from _row("note", note)


def _poles(poles: tuple[Pole, ...]) -> str:
    shown: list[str] = []
    for pole in poles:
        if pole.magnitude < 1e-6 or pole.imaginary < -1e-12:
            continue
        damping = "" if pole.damping is None else f", damping {pole.damping:.3g}"
        if pole.imaginary > 1e-12:
            shown.append(
                f"{pole.real:.4g} +- {pole.imaginary:.4g}i (size {pole.magnitude:.4g}{damping})"
            )
        else:
            shown.append(f"{pole.real:.4g}")
    zeros = sum(pole.magnitude < 1e-6 for pole in poles)
    if zeros:
        shown.append(f"0 ({zeros} times)" if zeros > 1 else "0")
    if len(shown) > _MOST_SHOWN:
        shown[_MOST_SHOWN:] = [f"and {len(shown) - _MOST_SHOWN} more, which die away faster"]
    return ", ".join(shown) or "none"


def _decibel(factor: float) -> str:
    return f"{20.0 * math.log10(factor):.3g} dB"


def _number(value: float | Fraction) -> str:
    return f"{float(value):.6g}"


def _row(name: str, text: str) -> list[str]:
    """A name in a column, its text beside it."""
    return textwrap.wrap(
        text, _WIDTH, initial_indent=f"  {name:<16}", subsequent_indent=" " * 18,
        break_long_words=False, break_on_hyphens=False,
    ) or [f"  {name}"]  # fmt: skip


def _wrapped(text: str, indent: int) -> list[str]:
    return textwrap.wrap(
        text, _WIDTH, subsequent_indent=" " * indent, break_long_words=False,
        break_on_hyphens=False,
    )  # fmt: skip
