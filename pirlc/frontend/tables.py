"""lark's parser for the language, its tables cached in the user's cache folder.

Building the tables takes longer than all else that `pirlc check` does; loading them does not. The
cache file is named by the grammar's content and the versions that its format depends on. It is
written beside its place and moved there in one step, so other processes see it whole or not at
all; whatever is wrong with it (or with the folder), the tables are built afresh.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from functools import cache
from pathlib import Path

import lark

from pirlc import resources


@cache
def parser() -> lark.Lark:
    """The parser; the same object at every call of the process."""
    grammar = resources.grammar("pirl.lark").read_text(encoding="utf-8")
    key = "\n".join([lark.__version__, sys.version, grammar])
    digest = hashlib.sha256(key.encode()).hexdigest()[:20]
    return cached_parser(grammar, resources.user_cache() / f"parser-{digest}")


def cached_parser(grammar: str, file: Path) -> lark.Lark:
    """The parser of `grammar`, read from `file` or else built and, where possible, stored there."""
    try:
        with file.open("rb") as stream:
            return lark.Lark.load(stream)
    except Exception:
        # A damaged pickle can raise anything, and none of it matters: the tables are rebuilt.
        built = lark.Lark(grammar, parser="lalr", lexer="basic", propagate_positions=True)
        _store(built, file)
        return built


def _store(built: lark.Lark, file: Path) -> None:
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=file.parent, prefix=file.name)
    except OSError:
        return
    temporary = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream:
            built.save(stream)
        temporary.replace(file)
    except OSError:
        temporary.unlink(missing_ok=True)
