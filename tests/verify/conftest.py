"""The printed programs."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.verify.proving import program_of

PRINTED = Path(__file__).parents[2] / "examples" / "torcs" / "printed"


@pytest.fixture
def printed():
    return lambda name: program_of((PRINTED / f"{name}.pirl").read_text(encoding="utf-8"))
