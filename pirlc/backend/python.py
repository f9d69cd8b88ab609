"""Controllers as one Python file that needs the standard library alone."""

from __future__ import annotations

from dataclasses import dataclass

from pirlc.backend import python_expressions as print_python
from pirlc.backend.files import GeneratedFile, Provenance
from pirlc.backend.names import file_stem, python_locals
from pirlc.backend.numbers import LARGEST, PRECISIONS, RealType
from pirlc.backend.python_expressions import PythonScope, constant, is_unpacked
from pirlc.backend.rendering import python_helpers, render
from pirlc.backend.text import comment_lines, indented
from pirlc.ir.controller import (
    Channel,
    Controller,
    Kind,
    Operation,
    Output,
    Parameter,
    declared,
    expressions,
)
from pirlc.ir.policy import Continuous, Hold

_TAKEN = ("observation", "values", "flags", "status", "failed", "INFINITY", "NAN", "PARAMS")


def python_files(
    controller: Controller, real: RealType, provenance: Provenance
) -> tuple[GeneratedFile, ...]:
    """`<name>.py`, with its class `Controller`."""
    return (
        GeneratedFile.of(
            f"{file_stem(controller.name)}.py", python_text(controller, real, provenance)
        ),
    )


def python_text(controller: Controller, real: RealType, provenance: Provenance) -> str:
    context = _Printer(controller, real).context(provenance)
    return render("python", "controller.py.j2", context)


def gives_int(controller: Controller) -> bool:
    """Whether a step returns one int, as environments with one discrete action take it."""
    outputs = controller.outputs
    return len(outputs) == 1 and outputs[0].kind is Kind.DISCRETE


@dataclass(frozen=True)
class _Item:
    """A part of the state tuple: how a step takes it apart, what it leaves, what reset gives."""

    before: str
    after: str
    start: str


class _Printer:
    """One controller's identifiers, and the lines made with them."""

    def __init__(self, controller: Controller, real: RealType) -> None:
        self.controller, self.real = controller, real
        everything = list(expressions(controller.statements))
        self.used = {e.name for e in everything if isinstance(e, Parameter)}
        self.operators = {e.operator for e in everything if isinstance(e, Operation)}
        names = python_locals(_TAKEN)
        sensors = [channel.name for channel in controller.channels]
        parameters = [name for name, _ in controller.parameters]
        newest = names.assign(sensors)
        parameter_names = names.assign(parameters)
        local_names = names.assign(declared(controller.statements))
        readings = {}
        for channel in controller.channels:
            older: tuple[str, ...] = ()
            if is_unpacked(channel):
                older = tuple(names.fresh(f"{channel.name}_{k}") for k in range(1, channel.depth))
            readings[channel.name] = (newest[channel.name], *older)
        kept = [channel for channel in controller.channels if channel.kept]
        self.last = {c.name: names.fresh(f"{c.name}_last") for c in kept if c.kept == 1}
        self.seen = {
            c.name: names.fresh(f"{c.name}_seen") for c in controller.channels if c.awaits_first
        }
        self.counts = {
            c.name: names.fresh(f"{c.name}_missing") for c in controller.channels if c.counted
        }
        # Clipping writes over what was computed: nothing reads that afterwards.
        self.applied = {o.name: local_names[o.raw.name] for o in controller.outputs}
        self.scope = PythonScope(
            real=real,
            channels={channel.name: channel for channel in controller.channels},
            parameters=parameter_names,
            locals=local_names,
            readings=readings,
            windows={c.name: names.fresh(f"{c.name}_window") for c in kept if c.kept > 1},
            previous={
                o.name: names.fresh(f"previous_{o.name}")
                for o in controller.outputs
                if o.keeps_previous
            },
        )

    def context(self, provenance: Provenance) -> dict[str, object]:
        controller = self.controller
        items = self._items()
        bits = range(len(controller.channels))
        return {
            "name": file_stem(controller.name),
            "version": provenance.version,
            "sha256": provenance.sha256,
            "program": comment_lines(provenance.text),
            "real": self.real,
            "precision": PRECISIONS[self.real].value,
            "parameters": [
                f'"{name}": {constant(value, self.real).code},'
                for name, value in controller.parameters
            ],
            "used": [name for name, _ in controller.parameters if name in self.used],
            "used_locals": _unpacking(
                [self.scope.parameters[n] for n, _ in controller.parameters if n in self.used]
            ),
            "sensors": [f'"{c.name}": {c.index},' for c in controller.channels],
            "actions": [f'"{o.name}",' for o in controller.outputs],
            "start": _tuple([item.start for item in items]),
            "before": _unpacking([item.before for item in items]),
            "after": _tuple([item.after for item in items]) if items else "",
            "missing_bits": sum(1 << 2 * k for k in bits),
            "outside_bits": sum(2 << 2 * k for k in bits),
            "take_in": [
                line for k, c in enumerate(controller.channels) for line in self._take_in(k, c)
            ],
            "may_fail": controller.may_fail,
            "act": self._act(),
            "result": self._result(),
            "discrete": all(o.kind is Kind.DISCRETE for o in controller.outputs),
            "single": gives_int(self.controller),
            "helpers": self._helpers(),
        }

    def _helpers(self) -> list[str]:
        """The text of the support functions that the step calls."""
        code = "\n".join(self._act())
        needed = {name for name in python_helpers() if f"{name}(" in code}
        if self.real == "float":
            needed.add("_round")
        return [text for name, text in python_helpers().items() if name in needed]

    def _items(self) -> list[_Item]:
        items = []
        scope = self.scope
        for c in self.controller.channels:
            start = constant(c.initial, self.real).code
            if c.kept == 1:
                items.append(_Item(self.last[c.name], scope.readings[c.name][0], start))
            elif c.kept and is_unpacked(c):
                # The newest of the step before is one step old in this one.
                older = list(reversed(scope.readings[c.name][1:]))
                before = ", ".join(["_", *older])
                items.append(_Item(f"({before})", scope.windows[c.name], f"({start},) * {c.kept}"))
            elif c.kept:
                window = scope.windows[c.name]
                items.append(_Item(window, window, f"({start},) * {c.kept}"))
        items += [_Item(name, name, "False") for name in self.seen.values()]
        items += [_Item(name, name, "0") for name in self.counts.values()]
        for o in self.controller.outputs:
            if o.keeps_previous:
                name = self.applied[o.name]
                items.append(_Item(scope.previous[o.name], name, self._safe(o)))
        return items

    def _safe(self, output: Output) -> str:
        if output.kind is Kind.DISCRETE:
            return repr(int(output.safe))
        return constant(output.safe, self.real).code

    def _take_in(self, place: int, c: Channel) -> list[str]:
        """Judges a reading, stands in for a missing one, and puts it into the buffer."""
        x = self.scope.readings[c.name][0]
        low = constant(max(c.low, -LARGEST[self.real]), self.real).code
        high = constant(min(c.high, LARGEST[self.real]), self.real).code
        read = f"float(values[{c.index}])"
        missing, outside = 1 << 2 * place, 2 << 2 * place
        absent = [f"flags |= {missing}"]
        outer = []
        if c.counted:
            count = self.counts[c.name]
            absent += [
                f"if {count} < {c.limit}:",
                f"    {count} += 1",
                "else:",
                "    failed = True",
            ]
        elif c.limit == 0:
            absent.append("failed = True")
        if c.depth:
            absent.append(f"{x} = {self._stand_in(c)}")
        present = [f"flags |= {outside}"]
        if c.counted:
            present.append(f"{self.counts[c.name]} = 0")
            outer = ["else:", f"    {self.counts[c.name]} = 0"]
        lines = [
            f"{x} = {f'_round({read})' if self.real == 'float' else read}",
            f"if not {low} <= {x} <= {high}:",
            "    # NaN or infinite?",
            f"    if {x} - {x} != 0.0:",
            *indented(absent, 2),
            "    else:",
            *indented(present, 2),
            *outer,
        ]
        return lines + self._push(c, missing)

    def _stand_in(self, c: Channel) -> str:
        scope = self.scope
        if isinstance(c.missing, Hold):
            if c.kept == 1:
                return self.last[c.name]
            if is_unpacked(c):
                return scope.readings[c.name][1]
            return f"{scope.windows[c.name]}[-1]"
        if not c.awaits_first:
            return "0.0"
        start = constant(c.initial, self.real).code
        return start if start == "0.0" else f"0.0 if {self.seen[c.name]} else {start}"

    def _push(self, c: Channel, missing: int) -> list[str]:
        scope = self.scope
        lines = []
        if c.awaits_first:
            seen = self.seen[c.name]
            lines += [f"if not {seen} and not flags & {missing}:", f"    {seen} = True"]
            if c.kept > 1 and is_unpacked(c):
                newest, *older = scope.readings[c.name]
                lines += [f"    {name} = {newest}" for name in older]
            elif c.kept > 1:
                lines.append(
                    f"    {scope.windows[c.name]} = ({scope.readings[c.name][0]},) * {c.kept}"
                )
        if c.kept > 1:
            window, x = scope.windows[c.name], scope.readings[c.name][0]
            if is_unpacked(c):
                lines.append(f"{window} = ({', '.join(reversed(scope.readings[c.name]))})")
            else:
                lines.append(f"{window} = (*{window}[1:], {x})")
        return lines

    def _act(self) -> list[str]:
        """The actions; indented under `else` where missing readings may stand in their way."""
        lines = print_python.statements(self.scope, self.controller.statements)
        for output in self.controller.outputs:
            lines += self._clip(output)
        if not self.controller.may_fail:
            return lines
        safe = [f"{self.applied[o.name]} = {self._safe(o)}" for o in self.controller.outputs]
        return [
            "if failed:",
            *indented([*safe, "status |= SAFE_USED"]),
            "else:",
            *indented(lines),
        ]

    def _clip(self, output: Output) -> list[str]:
        name = self.applied[output.name]
        if not isinstance(output.domain, Continuous):
            return []
        low = constant(output.domain.lower, self.real).code
        high = constant(output.domain.upper, self.real).code
        return [
            f"if {name} < {low}:",
            f"    {name} = {low}",
            f"elif {name} > {high}:",
            f"    {name} = {high}",
            f"elif {name} != {name}:",
            "    # NaN",
            f"    {name} = {self._safe(output)}",
            "    status |= SAFE_USED",
        ]

    def _result(self) -> str:
        ordered = sorted(self.controller.outputs, key=lambda o: o.component)
        names = [self.applied[o.name] for o in ordered]
        return names[0] if gives_int(self.controller) else _tuple(names)


def _tuple(items: list[str]) -> str:
    return f"({', '.join(items)}{',' if len(items) == 1 else ''})"


def _unpacking(items: list[str]) -> str:
    """What stands left of `=` to take a tuple apart; empty for nothing."""
    return ", ".join(items) + ("," if len(items) == 1 else "")
