"""Emitted C as a compiler sees it after preprocessing, on a platform that is written down here.

The headers that emitted C includes are replaced by the few lines of them that matter, so that
neither a compiler nor a system's headers are needed. Whether the source refuses (`#error`) the
platforms and options on which it would mean something else is found out the same way.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING

from pirlc.backend.numbers import RealType
from pirlc.verify.emitted.nodes import NotUnderstood

if TYPE_CHECKING:
    from pcpp import Preprocessor

FLOAT_H = {
    "FLT_EVAL_METHOD": "0",
    "FLT_RADIX": "2",
    "FLT_MANT_DIG": "24",
    "FLT_MAX_EXP": "128",
    "DBL_MANT_DIG": "53",
    "DBL_MAX_EXP": "1024",
}
"""<float.h> of the platform: binary32 and binary64, each evaluated to its own precision."""

MATH_H = """
extern const double HUGE_VAL;
extern const float HUGE_VALF;
double fabs(double); double sqrt(double); double exp(double); double tanh(double);
float fabsf(float); float sqrtf(float); float expf(float); float tanhf(float);
"""

CONTRACTION: tuple[tuple[Mapping[str, str], str], ...] = (
    ({}, "STDC FP_CONTRACT OFF"),
    ({"__GNUC__": "14", "__clang__": "1"}, "STDC FP_CONTRACT OFF"),
    ({"__GNUC__": "14"}, 'GCC optimize("fp-contract=off")'),
)
"""Compilers, and the pragma that keeps each from fusing operations. (gcc -std=c99 does not.)"""

_OPTIONS: tuple[Mapping[str, str], ...] = (
    {"__FAST_MATH__": "1"},
    {"_M_FP_FAST": "1"},
    {"__RECIPROCAL_MATH__": "1"},
    {"__ASSOCIATIVE_MATH__": "1"},
    {"__NO_SIGNED_ZEROS__": "1"},
    {"__FINITE_MATH_ONLY__": "1"},
)

ADMITTED: dict[RealType, tuple[Mapping[str, str], ...]] = {
    "double": tuple({"FLT_EVAL_METHOD": m} for m in ("0", "1", "16")),
    "float": tuple({"FLT_EVAL_METHOD": m} for m in ("0", "16")),
}

REFUSED: dict[RealType, tuple[Mapping[str, str], ...]] = {
    "double": (
        *_OPTIONS,
        *({"FLT_EVAL_METHOD": m} for m in ("2", "-1", "")),
        {"FLT_RADIX": "10"},
        {"DBL_MANT_DIG": "24"},
        {"DBL_MAX_EXP": "128"},
    ),
    "float": (
        *_OPTIONS,
        *({"FLT_EVAL_METHOD": m} for m in ("1", "2", "-1", "")),
        {"FLT_RADIX": "10"},
        {"FLT_MANT_DIG": "11"},
        {"FLT_MAX_EXP": "16"},
    ),
}
"""Platforms on which the C would not be the program; empty: the macro is not defined."""


class _Refused(Exception):
    """The source stopped with #error."""


def preprocessed(header: str, source: str, stem: str) -> str:
    """The translation unit on the platform, comments and directives gone, pragmas left."""
    try:
        return _run(source, {f"{stem}.h": header}, {})
    except _Refused as refusal:
        raise NotUnderstood(f"the source refuses the platform: {refusal}") from None


def guard_faults(source: str, stem: str, real: RealType) -> list[str]:
    """What the source's head lets through and should not, or refuses and should not."""
    lines = source.split("\n")
    last = max((i for i, line in enumerate(lines) if "#error" in line), default=0)
    end = next((i for i in range(last, len(lines)) if lines[i].startswith("#endif")), last)
    return list(_head_faults("\n".join(lines[: end + 1]) + "\n", stem, real))


@lru_cache(maxsize=64)
def _head_faults(head: str, stem: str, real: RealType) -> tuple[str, ...]:
    headers = {f"{stem}.h": ""}
    faults = [
        f"refuses {_told(macros)}, where it means the same"
        for macros in ADMITTED[real]
        if _refuses(head, headers, macros)
    ]
    faults += [
        f"does not refuse {_told(macros)}, where it means something else"
        for macros in REFUSED[real]
        if not _refuses(head, headers, macros)
    ]
    for macros, pragma in CONTRACTION:
        try:
            text = _run(head, headers, macros)
        except _Refused:
            text = ""
        if f"#pragma {pragma}" not in [" ".join(line.split()) for line in text.split("\n")]:
            name = _told(macros) or "other compilers"
            faults.append(f"lets {name} fuse operations: no #pragma {pragma}")
    return tuple(faults)


def _told(macros: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {value}".rstrip() for name, value in macros.items())


def _refuses(head: str, headers: Mapping[str, str], macros: Mapping[str, str]) -> bool:
    try:
        _run(head, headers, macros)
    except _Refused:
        return True
    return False


def _run(source: str, headers: Mapping[str, str], macros: Mapping[str, str]) -> str:
    preprocessor = _preprocessor(headers, macros)
    preprocessor.parse(source)
    text = io.StringIO()
    preprocessor.write(text)
    return text.getvalue()


def _preprocessor(headers: Mapping[str, str], macros: Mapping[str, str]) -> Preprocessor:
    from pcpp import Preprocessor

    limits = {**FLOAT_H, **{k: v for k, v in macros.items() if k in FLOAT_H}}
    files = {
        "float.h": "\n".join(f"#define {k} {v}" for k, v in limits.items() if v) + "\n",
        "math.h": MATH_H,
        **headers,
    }

    class Platform(Preprocessor):  # type: ignore[misc]
        def on_file_open(self, _: bool, path: str) -> io.StringIO:
            name = path.replace("\\", "/").rpartition("/")[2]
            if name not in files:
                raise OSError(name)
            return io.StringIO(files[name])

        def on_error(self, _: str, line: int, words: str) -> None:
            raise NotUnderstood(f"line {line}: {words}")

        def on_directive_unknown(
            self, directive: object, tokens: list[object], _: object, __: object
        ) -> bool | None:
            kind = getattr(directive, "value", "")
            if kind == "error":
                raise _Refused("".join(getattr(token, "value", "") for token in tokens))
            if kind != "pragma":
                raise NotUnderstood(f"#{kind}")
            return None

    preprocessor = Platform()
    preprocessor.line_directive = None
    for name, value in macros.items():
        if name not in FLOAT_H:
            preprocessor.define(f"{name} {value}")
    return preprocessor
