"""The study's records: what is written is read, what is foreign is named, one writer at a time."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

import pirlc
from benchmarks.study.records import (
    LOCK,
    RESULTS,
    ROOT,
    SCHEMA,
    TIMEOUT,
    Record,
    Return,
    as_json,
    finite,
    held,
    message,
    parse,
    read,
    writing,
)

RECORD = Record(
    suite="classic",
    method="NDPS-CasADi",
    environment="CartPole-v1",
    seed=2,
    command=("pirlc", "synth", "examples/cartpole/cartpole.pirl"),
    returns=Return(499.5, 499.25, 499.75, 1000, 1_000_000),
    size=16,
    core_seconds=12.5,
    wall_seconds=10.25,
    step_nanoseconds=14.0,
    code_bytes=512,
    provable="sketch's properties, bounds",
    distance=0.125,
    program="policy p\n",
    oracle="ab" * 32,
    figures={"calls": 12, "laps": [1.5, 2.5]},
)


def test_what_is_written_is_read(tmp_path: Path) -> None:
    other = replace(RECORD, method="peer: tree", returns=None, size=None, ending=TIMEOUT)
    with writing(tmp_path, "classic") as results:
        path = results.write(RECORD)
        results.write(other)
        assert results.read().records == (RECORD, other)
    assert path == tmp_path / "classic" / "NDPS-CasADi-CartPole-v1-2.json"
    assert (tmp_path / "classic" / "peer_tree-CartPole-v1-2.json").is_file()
    kept = read(tmp_path, "classic")
    assert kept.records == (RECORD, other)
    assert kept.left_out == ()
    assert message(kept.left_out) == ""
    assert sorted(p.name for p in (tmp_path / "classic").iterdir()) == [
        LOCK,
        "NDPS-CasADi-CartPole-v1-2.json",
        "peer_tree-CartPole-v1-2.json",
    ]


def test_a_record_takes_the_place_of_the_one_before(tmp_path: Path) -> None:
    with writing(tmp_path, "classic") as results:
        results.write(RECORD)
        results.write(replace(RECORD, size=15))
    assert [record.size for record in read(tmp_path, "classic").records] == [15]


def test_the_fields_are_those_agreed_on() -> None:
    data = json.loads(as_json(RECORD))
    assert list(data) == [
        *("schema", "pirlc", "suite", "method", "environment", "seed", "command", "return"),
        *("size", "core_seconds", "wall_seconds", "step_nanoseconds", "code_bytes", "provable"),
        *("distance", "ending", "program", "oracle", "figures"),
    ]
    assert data["schema"] == SCHEMA
    assert data["pirlc"] == pirlc.__version__
    assert data["return"] == {
        "mean": 499.5,
        "low": 499.25,
        "high": 499.75,
        "episodes": 1000,
        "first_seed": 1_000_000,
    }
    assert parse(as_json(RECORD)) == RECORD


def test_what_is_no_number_is_not_written() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        as_json(replace(RECORD, distance=float("nan")))
    assert finite(float("nan")) is None
    assert finite(float("-inf")) is None
    assert finite(None) is None
    assert finite(1234.56789, 6) == 1234.57


def test_a_suite_that_was_not_run_has_no_records(tmp_path: Path) -> None:
    kept = read(tmp_path, "classic")
    assert (kept.records, kept.left_out) == ((), ())


def test_others_in_the_folder_are_named_and_left_out(tmp_path: Path) -> None:
    with writing(tmp_path, "classic") as results:
        results.write(RECORD)
    place = tmp_path / "classic"
    data = json.loads(as_json(RECORD))
    without = {key: value for key, value in data.items() if key != "ending"}
    files = {
        "a.json": json.dumps({**data, "pirlc": "0.0.1"}),
        "b.json": json.dumps({**data, "schema": 0}),
        "c.json": "{",
        "d.json": json.dumps([1]),
        "e.json": json.dumps(without),
        "f.json": json.dumps({**data, "size": "16"}),
        "g.json": json.dumps({**data, "colour": "red"}),
        "h.json": json.dumps({**data, "return": {"mean": 1}}),
        "i.json": json.dumps(data),
        "j.txt": "notes",
        "k.json": json.dumps({**data, "distance": float("nan")}),
    }
    for name, text in files.items():
        (place / name).write_text(text, encoding="utf-8")
    (place / "l.json").write_bytes(b"\xff")
    kept = read(tmp_path, "classic")
    assert kept.records == (RECORD,)
    reasons = {each.path.name: each.reason for each in kept.left_out}
    assert reasons == {
        "a.json": f"made by pirlc 0.0.1; this is pirlc {pirlc.__version__}",
        "b.json": f"written in schema 0; this is schema {SCHEMA}",
        "c.json": "not JSON (Expecting property name enclosed in double quotes: line 1 column 2 "
        "(char 1))",
        "d.json": "not a record of the study",
        "e.json": "it has no `ending`",
        "f.json": 'its `size` is "16"',
        "g.json": "it has an unknown `colour`",
        "h.json": "its `return` has not the five numbers of one",
        "i.json": "it is of classic/NDPS-CasADi-CartPole-v1-2.json, which its place does not say",
        "j.txt": "not a record of the study",
        "k.json": "not JSON (NaN is no number in JSON)",
        "l.json": "'utf-8' codec can't decode byte 0xff in position 0: invalid start byte",
    }


def test_what_is_told_about_them(tmp_path: Path) -> None:
    place = tmp_path / "classic"
    place.mkdir()
    data = {**json.loads(as_json(RECORD)), "pirlc": "0.0.1"}
    (place / RECORD.name).write_text(json.dumps(data), encoding="utf-8")
    assert message(read(tmp_path, "classic").left_out) == (
        "left out of all tables:\n"
        f"  {place / RECORD.name}: made by pirlc 0.0.1; this is pirlc {pirlc.__version__}\n"
        "remove these files, or run their rows again, which replaces them"
    )


HOLDER = """
import sys, time
from pathlib import Path
from benchmarks.study.records import writing

with writing(Path(sys.argv[1]), "classic"):
    print("held", flush=True)
    time.sleep(60)
"""


def test_two_writers_in_one_folder_are_refused(tmp_path: Path) -> None:
    other = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(tmp_path)], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    try:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with pytest.raises(SystemExit) as refused, writing(tmp_path, "classic"):
            pass
        assert refused.value.code == (
            f"{tmp_path / 'classic'}: process {other.pid} (-c {tmp_path}) is writing into this "
            "folder; wait for it to end, or write into another folder"
        )
        with writing(tmp_path, "torcs"):  # another suite is another folder
            pass
        other.kill()
        other.wait()
        started = time.monotonic()
        with writing(tmp_path, "classic") as results:  # what died holds nothing
            results.write(RECORD)
        assert time.monotonic() - started < 5
    finally:
        other.kill()
        other.wait()
        if other.stdout is not None:
            other.stdout.close()


def test_the_same_process_cannot_hold_a_folder_twice(tmp_path: Path) -> None:
    with held(tmp_path), pytest.raises(SystemExit), held(tmp_path):
        pass


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(SystemExit) as refused, writing(tmp_path / "file", "classic"):
        pass
    assert refused.value.code == (
        f"{tmp_path / 'file' / 'classic'}: cannot be written (not a directory)"
    )


def test_a_record_of_another_suite_is_not_written_here(tmp_path: Path) -> None:
    with writing(tmp_path, "torcs") as results, pytest.raises(ValueError, match="of classic"):
        results.write(RECORD)


def test_stored_records_are_sound_and_name_no_machines_places() -> None:
    for suite in ("classic", "torcs", "peers"):
        found = read(RESULTS, suite)
        assert found.records and not found.left_out
        for record in found.records:
            assert not any(Path(word).is_absolute() for word in record.command), record.method
