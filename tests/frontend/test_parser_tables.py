"""The cache of the parser's tables: used, rebuilt when damaged, never in the way."""

from __future__ import annotations

import multiprocessing
import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from pirlc import resources
from pirlc.frontend.tables import cached_parser

GRAMMAR = resources.grammar("pirl.lark").read_text(encoding="utf-8")
TEXT = "policy p action A : [0, 1] = 1"


def reads(file: Path) -> bool:
    return bool(cached_parser(GRAMMAR, file).parse(TEXT).children)


def test_written_once_and_used(tmp_path: Path) -> None:
    file = tmp_path / "sub" / "parser"
    assert reads(file)
    written = file.stat().st_mtime_ns
    assert reads(file)
    assert file.stat().st_mtime_ns == written
    assert list(file.parent.iterdir()) == [file]


@pytest.mark.parametrize(
    "content",
    [b"", b"garbage", pickle.dumps({"data": {}}), pickle.dumps(42), b"\x80\x05\x95\xff\xff"],
    ids=["empty", "garbage", "other pickle", "number", "cut"],
)
def test_damaged_file_is_rebuilt(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "parser"
    file.write_bytes(content)
    assert reads(file)
    assert file.stat().st_size > 1_000
    assert reads(file)


def test_truncated_file_is_rebuilt(tmp_path: Path) -> None:
    file = tmp_path / "parser"
    assert reads(file)
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    assert reads(file)
    assert file.stat().st_size > len(whole) // 2


def test_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    assert reads(tmp_path / "file" / "parser")
    assert reads(Path("/proc/nowhere/parser"))


def test_two_processes_at_once(tmp_path: Path) -> None:
    file = tmp_path / "parser"
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        assert all(pool.map(reads, [file] * 6))
    assert list(tmp_path.iterdir()) == [file]


def test_checking_loads_nothing_heavy(tmp_path: Path) -> None:
    sample = tmp_path / "sample.pirl"
    sample.write_text(TEXT)
    code = (
        "import sys; from pirlc.frontend import check; from pirlc.source import SourceText\n"
        f"check(SourceText('s', open({str(sample)!r}).read()))\n"
        "heavy = {'numpy', 'torch', 'casadi', 'z3', 'gymnasium', 'jinja2', 'rich'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
