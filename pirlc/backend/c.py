"""Controllers as C99: a header and a source (design: the emitted controller's contract)."""

from __future__ import annotations

from dataclasses import dataclass

from pirlc.backend import c_expressions as print_c
from pirlc.backend.c_expressions import CScope, constant, is_ring
from pirlc.backend.costs import checking_operations, program_operations
from pirlc.backend.files import GeneratedFile, Provenance
from pirlc.backend.names import c_locals, c_members, file_stem
from pirlc.backend.numbers import LARGEST, RealType
from pirlc.backend.rendering import render, runtime_text
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
from pirlc.ir.operators import Operator
from pirlc.ir.policy import Choice, Continuous, Hold

_SIZES = {
    "double": 8,
    "float": 4,
    "int": 4,
    "long": 8,
    "long long": 8,
    "unsigned": 4,
    "unsigned long": 8,
    "unsigned long long": 8,
}
"""Bytes, and alignment, on the usual 64-bit machines; `unsigned char` takes 1."""


@dataclass(frozen=True)
class _Member:
    """A member of the state: `length` 0 for a scalar; `comment` says what it holds."""

    type: str
    name: str
    length: int
    comment: str

    @property
    def size(self) -> int:
        return _SIZES.get(self.type, 1) * max(1, self.length)


def c_files(
    controller: Controller, real: RealType, provenance: Provenance
) -> tuple[GeneratedFile, ...]:
    """`<name>.h` and `<name>.c`."""
    printer = CPrinter(controller, real)
    context = printer.context(provenance)
    stem = printer.stem
    return (
        GeneratedFile.of(f"{stem}.h", render("c", "controller.h.j2", context)),
        GeneratedFile.of(f"{stem}.c", render("c", "controller.c.j2", context)),
    )


def discrete_type(values: tuple[int, ...]) -> str:
    """The narrowest of int, long and long long that has the values in every C99."""
    largest = max((abs(value) for value in values), default=0)
    return "int" if largest < 2**15 else "long" if largest < 2**31 else "long long"


class CPrinter:
    """One controller's identifiers, and the lines made with them."""

    def __init__(self, controller: Controller, real: RealType) -> None:
        self.controller, self.real = controller, real
        self.stem = file_stem(controller.name)
        self.typedef = f"{self.stem}_real"
        channels, outputs = controller.channels, controller.outputs
        self.inputs = c_members().assign(channel.name for channel in channels)
        self.actions = c_members().assign(output.name for output in outputs)
        self.parameters = c_members().assign(name for name, _ in controller.parameters)
        state = c_members()
        self.buffers = state.assign(channel.name for channel in channels)
        self.flags = {c.name: state.fresh(f"{c.name}_flags") for c in channels}
        self.seen = {c.name: state.fresh(f"{c.name}_seen") for c in channels if c.awaits_first}
        self.counts = {c.name: state.fresh(f"{c.name}_missing") for c in channels if c.counted}
        self.previous = {
            output.name: state.fresh(f"previous_{output.name}")
            for output in outputs
            if output.keeps_previous
        }
        rings = sorted({channel.kept for channel in channels if is_ring(channel)})
        self.heads = {length: state.fresh(f"oldest_of_{length}") for length in rings}
        values = tuple(
            value
            for output in outputs
            if isinstance(output.domain, Choice)
            for value in (*output.domain.values, int(output.safe))
        )
        self.discrete = discrete_type(values)
        names = c_locals(("p", "s", "in", "out", "status", "failed", "k", self.stem))
        readings = names.assign(channel.name for channel in channels)
        local_names = names.assign(declared(controller.statements))
        self.count_locals = {name: names.fresh(f"{name}_missing") for name in self.counts}
        self.scope = CScope(
            real=real,
            channels={channel.name: channel for channel in channels},
            parameters=self.parameters,
            readings=readings,
            locals=local_names,
            members=self.buffers,
            previous=self.previous,
            discrete={Kind.REAL: real, Kind.BOOL: "_Bool", Kind.DISCRETE: self.discrete},
            heads={length: names.fresh(f"oldest_of_{length}") for length in rings},
            cursors={},
            names=names,
        )

    def context(self, provenance: Provenance) -> dict[str, object]:
        controller = self.controller
        members = self._state()
        step = self._step()
        reset = self._reset()
        text = "\n".join([*step, *reset, *self._defaults()])
        all_expressions = list(expressions(controller.statements))
        calls = {Operator.ABS, Operator.SQRT, Operator.EXP, Operator.TANH}
        needs_math = "HUGE_VAL" in text or any(
            isinstance(e, Operation) and e.operator in calls for e in all_expressions
        )
        return {
            "name": self.stem,
            "real": self.real,
            "version": provenance.version,
            "sha256": provenance.sha256,
            "program": comment_lines(provenance.text),
            "bytes": _struct_size([(m.type, m.size) for m in members]),
            "operations": program_operations(controller),
            "checks": checking_operations(controller),
            "observation": self._observation(),
            "action": self._action(),
            "params": [f"{self.typedef} {self.parameters[n]};" for n, _ in controller.parameters],
            "state": [
                f"{self.typedef if m.type == self.real else m.type} {m.name}"
                f"{f'[{m.length}]' if m.length else ''}; /* {m.comment} */"
                for m in members
            ],
            "defaults": self._defaults(),
            "reset": reset,
            "reset_counts": any(c.kept > 1 for c in controller.channels),
            "step": step,
            "uses_params": any(isinstance(e, Parameter) for e in all_expressions),
            "uses_state": bool(controller.channels or self.previous),
            "may_fail": controller.may_fail,
            "needs_math": needs_math,
            "ieee754": runtime_text("c", "ieee754.h"),
            "mantissa": 53 if self.real == "double" else 24,
            "max_exponent": 1024 if self.real == "double" else 128,
            "float_prefix": "DBL" if self.real == "double" else "FLT",
            "widest_method": 1 if self.real == "double" else 0,
        }

    def _observation(self) -> list[str]:
        lines = []
        for c in self.controller.channels:
            policy = "zero"
            if isinstance(c.missing, Hold):
                policy = "hold" if c.limit is None else f"hold {c.limit} then fail"
            about = f"[{c.lower!r}, {c.upper!r}], component {c.index}, missing {policy}"
            lines.append(f"{self.typedef} {self.inputs[c.name]}; /* {about} */")
        return lines

    def _action(self) -> list[str]:
        lines = []
        for output in self.controller.outputs:
            match output.domain:
                case Continuous(lower, upper):
                    type_, about = self.typedef, f"[{lower!r}, {upper!r}]"
                case Choice(values):
                    type_, about = self.discrete, "{" + ", ".join(map(str, values)) + "}"
            safe = self._safe(output)
            about = f"{about}, safe {safe}"
            if len(about) > 80:
                about = f"{about[:76]} ..."
            lines.append(f"{type_} {self.actions[output.name]}; /* {about} */")
        return lines

    def _safe(self, output: Output) -> str:
        if output.kind is Kind.DISCRETE:
            return print_c.discrete_constant(int(output.safe), self.discrete).code
        return constant(output.safe, self.real).code

    def _defaults(self) -> list[str]:
        values = [constant(v, self.real).code for _, v in self.controller.parameters]
        return [
            f"{value}{',' if i + 1 < len(values) else ''} /* {self.parameters[name]} */"
            for i, ((name, _), value) in enumerate(
                zip(self.controller.parameters, values, strict=True)
            )
        ]

    def _state(self) -> list[_Member]:
        """The members, the widest first, so that none needs padding before it."""
        members = []
        for c in self.controller.channels:
            if c.kept:
                about = "last good reading"
                if c.kept > 1:
                    order = "a ring" if is_ring(c) else "oldest first"
                    about = f"the last {c.kept} readings, {order}"
                length = c.kept if c.kept > 1 else 0
                members.append(_Member(self.real, self.buffers[c.name], length, about))
        for output in self.controller.outputs:
            if output.keeps_previous:
                type_ = self.scope.discrete[output.kind]
                about = "the action of the step before"
                members.append(_Member(type_, self.previous[output.name], 0, about))
        for length, head in self.heads.items():
            about = f"place of the oldest reading in rings of {length}"
            members.append(_Member("unsigned", head, 0, about))
        for c in self.controller.channels:
            if c.counted:
                assert c.limit is not None
                type_ = _count_type(c.limit)
                about = f"readings missing in a row, at most {c.limit}"
                members.append(_Member(type_, self.counts[c.name], 0, about))
        for name, member in self.seen.items():
            about = f"whether {self.inputs[name]} has had a good reading"
            members.append(_Member("unsigned char", member, 0, about))
        for name, member in self.flags.items():
            about = f"status bits of {self.inputs[name]} at the last step"
            members.append(_Member("unsigned char", member, 0, about))
        if not members:
            members.append(_Member("unsigned char", "unused", 0, "nothing is remembered"))
        return sorted(members, key=lambda m: -(_SIZES.get(m.type, 1)))

    def _reset(self) -> list[str]:
        lines = []
        for c in self.controller.channels:
            start = constant(c.initial, self.real).code
            buffer = f"s->{self.buffers[c.name]}"
            if c.kept > 1:
                lines += [f"for (k = 0u; k < {c.kept}u; k++) {{", f"    {buffer}[k] = {start};"]
                lines.append("}")
            elif c.kept:
                lines.append(f"{buffer} = {start};")
        for output in self.controller.outputs:
            if output.keeps_previous:
                lines.append(f"s->{self.previous[output.name]} = {self._safe(output)};")
        zeroed = [
            *self.heads.values(),
            *self.counts.values(),
            *self.seen.values(),
            *self.flags.values(),
        ]
        lines += [f"s->{member} = 0u;" for member in zeroed]
        return lines or ["s->unused = 0u;"]

    def _step(self) -> list[str]:
        controller = self.controller
        lines = [f"s->{flags} = 0u;" for flags in self.flags.values()]
        for channel in controller.channels:
            lines += ["", *self._take_in(channel)]
        for length, head in self.heads.items():
            name = self.scope.heads[length]
            lines.append(f"s->{head} = {name};")
        lines.append("")
        actions = print_c.statements(self.scope, controller.statements)
        for output in controller.outputs:
            actions += self._clip(output)
        if controller.may_fail:
            safe = [f"out->{self.actions[o.name]} = {self._safe(o)};" for o in controller.outputs]
            lines += [
                "if (failed != 0u) {",
                *indented([*safe, f"status |= {self.stem}_SAFE_USED;"]),
                "} else {",
                *indented(actions),
                "}",
            ]
        else:
            lines += actions
        for name, member in self.previous.items():
            lines.append(f"s->{member} = out->{self.actions[name]};")
        return lines

    def _take_in(self, c: Channel) -> list[str]:
        """Judges a reading, stands in for a missing one, and puts it into the buffer."""
        x = self.scope.readings[c.name]
        flags, missing = f"s->{self.flags[c.name]}", f"{self.stem}_MISSING"
        zero = constant(0.0, self.real).code
        low = constant(max(c.low, -LARGEST[self.real]), self.real).code
        high = constant(min(c.high, LARGEST[self.real]), self.real).code
        absent = [f"{flags} = {missing};"]
        lines = [f"{'' if c.depth else 'const '}{self.real} {x} = in->{self.inputs[c.name]};"]
        if c.counted:
            assert c.limit is not None
            count, local = f"s->{self.counts[c.name]}", self.count_locals[c.name]
            lines.append(f"{_count_type(c.limit)} {local} = 0u;")
            absent += [
                f"if ({count} < {c.limit}u) {{",
                f"    {local} = {count} + 1u;",
                "} else {",
                f"    {local} = {count};",
                "    failed = 1u;",
                "}",
            ]
        elif c.limit == 0:
            absent.append("failed = 1u;")
        if c.depth:
            absent.append(f"{x} = {self._stand_in(c)};")
        if c.kept > 1 and is_ring(c):
            head = self.scope.heads[c.kept]
            if c is next(o for o in self.controller.channels if o.kept == c.kept):
                lines.insert(0, f"unsigned {head} = s->{self.heads[c.kept]};")
        lines += [
            f"if (!(({x} >= {low}) && ({x} <= {high}))) {{",
            f"    if (({x} - {x}) != {zero}) {{ /* NaN or infinite */",
            *indented(absent, 2),
            "    } else {",
            f"        {flags} = {self.stem}_OUT_OF_RANGE;",
            "    }",
            f"    status |= {flags};",
            "}",
        ]
        if c.counted:
            lines.append(f"s->{self.counts[c.name]} = {self.count_locals[c.name]};")
        return lines + self._push(c)

    def _stand_in(self, c: Channel) -> str:
        """What replaces a missing reading, before this step's reading is put into the buffer."""
        buffer = f"s->{self.buffers[c.name]}"
        if isinstance(c.missing, Hold):
            if c.kept == 1:
                return buffer
            if not is_ring(c):
                return f"{buffer}[{c.kept - 1}]"
            head = self.scope.heads[c.kept]
            return f"{buffer}[({head} == 0u) ? {c.kept - 1}u : ({head} - 1u)]"
        zero = constant(0.0, self.real).code
        if not c.awaits_first:
            return zero
        start = constant(c.initial, self.real).code
        return zero if start == zero else f"(s->{self.seen[c.name]} != 0u) ? {zero} : {start}"

    def _push(self, c: Channel) -> list[str]:
        x, buffer = self.scope.readings[c.name], f"s->{self.buffers[c.name]}"
        lines = []
        if c.awaits_first:
            seen, flags = f"s->{self.seen[c.name]}", f"s->{self.flags[c.name]}"
            lines += [
                f"if (({seen} == 0u) && ({flags} != {self.stem}_MISSING)) {{",
                f"    {seen} = 1u; /* the first good reading */",
            ]
            if c.kept > 1:
                lines += [
                    f"    for (unsigned k = 0u; k < {c.kept}u; k++) {{",
                    f"        {buffer}[k] = {x};",
                    "    }",
                ]
            lines.append("}")
        if c.kept == 1:
            lines.append(f"{buffer} = {x};")
        elif is_ring(c):
            head = self.scope.heads[c.kept]
            lines.append(f"{buffer}[{head}] = {x};")
            if c is [o for o in self.controller.channels if o.kept == c.kept][-1]:
                lines.append(print_c.next_in_ring(head, c.kept))
        elif c.kept:
            lines += [f"{buffer}[{k}] = {buffer}[{k + 1}];" for k in range(c.kept - 1)]
            lines.append(f"{buffer}[{c.kept - 1}] = {x};")
        return lines

    def _clip(self, output: Output) -> list[str]:
        """The applied action. What is neither in, below nor above its range is NaN."""
        raw = self.scope.locals[output.raw.name]
        out = f"out->{self.actions[output.name]}"
        if isinstance(output.domain, Choice):
            return [f"{out} = {raw};"]
        low = constant(output.domain.lower, self.real).code
        high = constant(output.domain.upper, self.real).code
        return [
            f"if ({raw} >= {low}) {{",
            f"    {out} = ({raw} > {high}) ? {high} : {raw};",
            f"}} else if ({raw} < {low}) {{",
            f"    {out} = {low};",
            "} else { /* NaN */",
            f"    {out} = {self._safe(output)};",
            f"    status |= {self.stem}_SAFE_USED;",
            "}",
        ]


def _count_type(limit: int) -> str:
    """Of a counter up to `limit`: C99's unsigned int may have only 16 bits."""
    if limit < 2**16:
        return "unsigned"
    return "unsigned long" if limit < 2**32 else "unsigned long long"


def _struct_size(members: list[tuple[str, int]]) -> int:
    total = sum(size for _, size in members)
    alignment = max(_SIZES.get(type_, 1) for type_, _ in members)
    return -(-total // alignment) * alignment
