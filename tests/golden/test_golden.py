"""Emitted files, byte for byte. PIRLC_UPDATE=1 writes them anew: read the difference then."""

from __future__ import annotations

from pathlib import Path

import pytest

from pirlc.backend.emit import emit
from tests.backend.helpers import NAMES, UPDATE, load_program

FOLDER = Path(__file__).parent / "emitted"


@pytest.mark.parametrize("name", NAMES)
def test_emitted_files_are_the_golden_ones(name):
    files = [("", file) for file in emit(load_program(name))]
    if name in ("functions", "long_window"):
        files += [("float-", file) for file in emit(load_program(name), real="float")]
    for prefix, file in files:
        place = FOLDER / name / f"{prefix}{file.path}.golden"
        if UPDATE:
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(file.text.encode())
        assert file.text.encode() == place.read_bytes(), f"{place.name} differs"


def test_no_golden_file_is_left_over():
    folders = {path.name for path in FOLDER.iterdir()}
    assert folders == set(NAMES)
